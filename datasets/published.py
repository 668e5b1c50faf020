"""Published facts about the five cloths of the paper: names, areal densities, training samples.

The data themselves have no licence and are never shipped. A folder is recognised as the public release by the
SHA-256 of one silhouette per fabric, so that another laboratory's `Fabric 2` never gets these densities.

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024.
"""

from dataclasses import dataclass

CITATION = "Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024"
HOME = "https://github.com/realcrane/Bayesian-Differentiable-Physics-for-Cloth-Digitalization"  # named in the paper


@dataclass(frozen=True)
class PublishedCloth:
    """A cloth of the paper.

    Attributes:
        source: The fabric's set in the release that the named images are (nearly) taken from.
        training_sample: The sample that the paper trains on; the other eleven are held out.
        areal_density: [kg/m2]
    """

    source: str
    training_sample: int
    areal_density: float


CLOTHS = {
    "cotton_blue": PublishedCloth("fabric_2", 2, 0.192),
    "cotton_pink": PublishedCloth("fabric_4", 4, 0.114),
    "cotton_white": PublishedCloth("fabric_1_observations", 5, 0.059),
    "viscose_white": PublishedCloth("fabric_3", 1, 0.213),
    "wool_red": PublishedCloth("fabric_5", 2, 0.274),
}

# SHA-256 of a silhouette of each of these fabrics -> the cloth that it is.
FINGERPRINTS = {
    "ba186aa73f4db07c8aa2f9cd27a5dc39c2a1acb322f9a61ec40c09a76d50f829": "cotton_white",
    "04324ad32ed64d59d624995535c6b9623a60eca819c423dd4d55080b48d8f08b": "cotton_white",
    "0ca07698af70cd2decb8d93d5cb4ea114bb0b78bd0e7e1c4188dbfa4f41692cb": "cotton_blue",
    "828275c4c094fd70ae8a4611f4fa6f092d9ddbf758add570f4a291cb74efdba5": "viscose_white",
    "178aa54edfc501b2e2d8d55c4961ebc290ec7fc7c25670facb198cf3d9428cca": "cotton_pink",
    "1776e7e95e800df87d2f03579c2735a697b18e9e1530b84ed7c8ec9819c27e30": "wool_red",
}
