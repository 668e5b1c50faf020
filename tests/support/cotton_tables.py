"""A cotton of the paper, roughly, as published tables: every entry differs, so that a swapped index shows."""

import numpy as np

STRETCH = np.column_stack([
    [150.1, 189.2, 51.3, 36.7, 58.9, 207.3], [0.35, 2.37, 4.94, 6.39, 5.15, 2.22],
    [150.5, 200.7, 60.3, 32.7, 49.9, 193.5], [10.2, 20.9, 25.4, 30.5, 25.1, 20.7],
])  # fmt: skip
"""Samples by (c11, c12, c22, c33) [N/m]."""
BENDING = 1e-5 * np.array([
    [1.07, 2.91, 9.29, 9.50, 8.14], [2.75, 4.84, 3.84, 7.40, 6.98], [2.46, 10.3, 12.3, 10.0, 10.2],
])  # fmt: skip
"""Directions by curvatures [N m]."""
