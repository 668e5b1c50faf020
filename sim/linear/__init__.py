"""Sparse symmetric systems of 3 x 3 blocks with one fixed pattern, factorised again and again.

interface: `BlockPattern`, `LinearSolver`, `solver`; multifrontal: the default solver, with its parts dissection
(elimination order), elimination (symbolic analysis) and dense (BLAS inside kernels); backends: other packages.
"""
