"""What other programs can read: benchmarks, data sets, materials.

Each of them is a module of its own, which writes a folder or a file.
"""
