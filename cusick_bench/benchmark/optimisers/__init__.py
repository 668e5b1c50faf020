"""The gradient-free solvers on published test functions.

functions: the test functions; runs: one solver on one of them; table: finished runs, and what is made of them.
"""
