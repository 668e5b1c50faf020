"""From positions to pictures: cameras and differentiable silhouettes.

camera: `ParallelCamera`, `PinholeCamera`; silhouette: `render`; coverage, outline: exact pixel coverage;
soft_mask: the paper's renderer (DIB-R).
"""

NUMERICS_VERSION = 1  # raised when a silhouette's numbers change: see runner/numerics.py
