"""Nominal values of the Cusick drape test and of the public release; only defaults, since every laboratory has its own.

References:
    ISO 9073-9 / BS 5058 (sizes of sample and plate).
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024 (gravity, size of the images).
"""

from typing import Literal

CLOTH_RADIUS = 0.15  # [m], ISO 9073-9: sample of 30 cm
PLATE_RADIUS = 0.09  # [m], ISO 9073-9: plate of 18 cm
GRAVITY = 9.8  # [m/s2], the published program's
IMAGE_SIZE = 256  # [px], side of an image of the public release
IMAGE_CENTRE = (127.5, 127.5)  # [px], column and row of the plate's axis there; pixel centres are integers
LIGHTEST_CLOTH = 0.005  # [kg/m2], half of the sheerest silk's; smaller values are in another unit
HEAVIEST_CLOTH = 5.0  # [kg/m2], ten times a heavy denim's; larger values are in another unit, such as g/m2
THINNEST_CLOTH = 1e-5  # [m], a thread of silk; smaller values are in another unit
THICKEST_CLOTH = 0.02  # [m], ten times a blanket; larger values are in another unit, such as mm
PIXELS_PER_METRE = 723.0  # [px/m], the scale at which the release's meshes match its silhouettes in parallel projection
FIELD_OF_VIEW = 0.5  # [rad], of the published scripts' camera
EYE_HEIGHT = 0.7  # [m], of the published scripts' camera
FIELD_LENGTH = 0.02  # [m], correlation length of stiffness over a cloth, assumed: some ten yarn repeats

Law = Literal["plate", "paper", "published"]
"""Material laws."""

DEFAULT_LAW: Law = "plate"
"""Default material law of commands that predict or fit: the law that converges with the mesh.
`DrapeSettings` has law `paper` for its default; every record names its law."""

# Vertices of the cloth's mesh by purpose. Errors are those of law `plate` on its own meshes, in points of drape
# coefficient, against the reference drapes of an ideal plate (`cusick-bench convergence --reference FILE --law plate`);
# samples of one cloth differ by 2 to 3 points. Law `paper` errs by 2 to 10 points on any of them.
VERTICES_TO_FIT = 600
"""Of fits by law `plate`, as in `make bench`: within .6 points down to ln(B / (rho g R^3)) = -5.8, 1.3 too high at
-6.6, where folds are hardly wider than the mesh; random cloths that cover less than half of the overhang 2 points too
high in the mean at 480 vertices, and half a point at 700 (`cusick-bench mesh-error`)."""
VERTICES_OF_TRUTH = 1205
"""Of drapes by law `plate` that are held for true, as in the set `synthetic`, or are looked at: within .15 points;
random limp cloths within half a point in the mean."""
VERTICES_OF_POPULATION = 480
"""Of the cloths that the priors of `bdp-field` are derived from, some 3500 drapes in all."""
VERTICES_OF_PAPER = 2699
"""Of the published experiments, and of fits and drapes by the laws of hinges."""
