"""Samples of the stiffness tables C (6 x 4) and B (3 x 5), and numbers of the two laws with hinges.

Stretch samples: 0 at rest; 1 to 5 at a largest principal stretch of 1 + 1/6, whose direction is 0, 22.5, 45, 67.5 and
90 degrees from the warp. Bending samples: curvature 0, 10, 20, 30 and 40 per metre.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 3.3.1.
    Wang, O'Brien, Ramamoorthi. Data-driven elastic models for cloth. ACM Transactions on Graphics 30(4), 2011.
"""

STRAIN_SAMPLE = ((1 + 1 / 6) ** 2 - 1) / 2  # Green strain at a stretch of 1 + 1/6
CURVATURE_STEP = 10.0  # [1/m] between bending samples

PUBLISHED = 0
PAPER = 1
"""Numbers of the laws with hinges in the kernels: see the modules `published` and `paper`."""
