"""What is irregular in a folder of drapes.

audit: `audit`, `Audit`; irregularity: every kind that can be found; files, images, meshes: the checks.
"""
