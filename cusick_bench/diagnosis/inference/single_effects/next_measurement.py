"""What to measure next: by how much each measurement is expected to lower the uncertainty about the cause.

A measurement decides, for each of the causes that it speaks about, whether that cause acts; it says nothing of the
others. With probabilities p of the causes, the expected drop of entropy is that of the partition it makes:
H(p) - sum_cells p(cell) H(p | cell) = H(cells). Which of its look-alikes acts in the place of a laboratory's effect is
taken to be independent of what acts in the fabric, so that these entropies add up.

References:
    Lindley. On a measure of the information provided by an experiment. Annals of Mathematical Statistics 27(4), 1956.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cusick_bench.diagnosis.inference.single_effects.evidence import NONE


@dataclass(frozen=True)
class Measurement:
    """Something that a laboratory can do.

    Attributes:
        name: Short name.
        what: What to do, in a sentence.
        decides: Causes that it tells apart from all others, each in a cell of its own.
        groups: Causes that it tells from all others, but not from each other.
    """

    name: str
    what: str
    decides: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()


TURN_OVER = "turn over"
"""Name of the measurement that a data set with both faces holds already."""

MEASUREMENTS: tuple[Measurement, ...] = (
    Measurement("weigh", "Weigh a cut piece of known area again.", ("density-bias", "local-mass-patch")),
    Measurement(
        "photograph a ruler",
        "Photograph a ruler, or a metal disc of 30 cm, on the plate: it shows the camera's scale, place and edge.",
        ("camera-scale", "camera-offset", "camera-tilt", "threshold"),
    ),
    Measurement("measure the sample", "Measure the diameter of the flat samples at several angles.", ("cut-size",)),
    Measurement("measure the plate", "Measure the plate's diameter and level it.", ("plate-radius", "plate-tilt")),
    Measurement(
        "rotate by 90 degrees",
        "Drape samples turned by 90 degrees on the plate: what belongs to the cloth turns with it.",
        (),
        (
            ("off-centre", "plate-tilt", "camera-offset", "camera-tilt"),
            ("local-stiff-patch", "local-mass-patch", "rest-curvature", "grain-skew"),
        ),
    ),
    Measurement(
        TURN_OVER,
        "Drape each sample on its other face as well.",
        (),
        (("rest-curvature", "face-asymmetry"),),
    ),
    Measurement(
        "wait and repeat", "Photograph one drape at once, after one and after ten minutes, untouched.", ("creep",)
    ),
    Measurement(
        "load and unload",
        "Bend a strip there and back in a bending tester (Kawabata), shear one likewise.",
        ("bending-friction", "shear-friction", "face-asymmetry", "rest-curvature"),
    ),
    Measurement(
        "side view", "Take a picture from the side: it shows how low the rim hangs and how the sample lies.",
        ("perspective", "off-centre", "plate-slip", "camera-tilt"),
    ),
    Measurement(
        "smaller sample",
        "Cut samples down by a fifth and drape them on a plate a fifth smaller (24 cm on 14.4 cm instead of 30 cm on "
        "18 cm; a diagnosis knows this ratio only): what sits at the rim goes with it, what is in the cloth stays.",
        ("rim-stiffening", "self-contact"),
        (("cut-size", "plate-radius"),),
    ),
    Measurement(
        "look at the sample", "Hold the samples against the light and feel for stains, seams, folds and stiff edges.",
        ("local-stiff-patch", "local-mass-patch", "rim-stiffening"),
    ),
    Measurement(
        "more samples", "Cut and drape four times as many samples: noise falls by half.", ("stiffness-field", NONE)
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Advice:
    """A measurement and its expected information for a fabric.

    Attributes:
        measurement: What to do.
        bits: Expected drop of entropy.
        about: Causes that it speaks about, with their probability.
    """

    measurement: Measurement
    bits: float
    about: tuple[str, ...]


def advise(
    probability: Mapping[str, float],
    *,
    shared: Mapping[str, Mapping[str, float]] | None = None,
    made: Collection[str] = (),
    most: int = 3,
    least: float = 0.05,
) -> list[Advice]:
    """The measurements that lower the entropy of the causes most.

    Args:
        probability: Probability of every cause, `none` and `unknown` included; an effect of the laboratory counts as
            `none`.
        shared: For each effect of the laboratory the probability that it acts, and that each of its look-alikes does
            instead.
        made: Names of measurements that have been made already.
        most: Largest number of measurements to name.
        least: Least expected drop of entropy of a measurement that is named [bit].

    Returns:
        The most informative first.
    """
    laboratory = shared or {}
    own = {name: p for name, p in probability.items() if name not in laboratory}
    own[NONE] = own.get(NONE, 0.0) + sum(probability.get(name, 0.0) for name in laboratory)
    questions, advice = [own, *laboratory.values()], []
    for one in (measurement for measurement in MEASUREMENTS if measurement.name not in made):
        cells = [(name,) for name in one.decides] + list(one.groups)
        about = tuple(name for cell in cells for name in cell if any(p.get(name, 0.0) > 0.02 for p in questions))
        advice.append(Advice(one, sum(_entropy(cells, p) for p in questions), about))
    return [one for one in sorted(advice, key=lambda a: -a.bits) if one.bits >= least][:most]


def _entropy(cells: Sequence[tuple[str, ...]], probability: Mapping[str, float]) -> float:
    """Entropy of the partition into these cells and all the rest [bit]."""
    share = np.array([sum(probability.get(name, 0.0) for name in cell) for cell in cells])
    p = np.append(share, max(0.0, 1 - float(share.sum())))
    p = p[p > 0]
    return float(-(p * np.log2(p)).sum())
