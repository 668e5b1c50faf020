"""Confidence of an outline: a score between 0 and 1 from several kinds of evidence.

The expected error of an outline has three parts: one from the network that reads it, one from the camera's place and
one from the calibration. Their weights are fitted to 46 and 195 photographs of laboratories 100 to 219. The limits of
other evidence are set by hand on the same laboratories. The score is not a fitted probability.
"""

import math
from dataclasses import dataclass

ACCEPTED = 0.5
"""Outlines with a lower confidence are not written."""
_WEIGHTS = {"expected_mm": 1.35, "off_axis_mm": 0.62, "calibration_mm": 0.22}
"""What stated errors are multiplied by before their squares are added; by likelihood of the errors that were found."""


@dataclass(frozen=True)
class Evidence:
    """Evidence for an outline and against it.

    Attributes:
        edge: Median strength of the edge along it, in standard deviations.
        weak_edge: Share of it without an edge across the radius, as the standard's plate and cloth would have it.
        rival: Share of it where a stronger edge lies elsewhere.
        colour: Share of places beside it whose colour suits their side.
        undecided: Share of places beside it whose colour suits both.
        learning_mm: How far most of it moved when colours were learnt again [mm].
        disagreement_mm: How far most of it lies from outlines by colour alone and by edges alone [mm].
        roughness_mm: Its deviation from a smooth curve, as folds of the standard's plate and cloth would have it [mm].
        unfound: Share of it where the light crosses no level between cloth and ground.
        at_limit: Share of it at the limits of what cloth can do.
        unseen: Share of it outside the picture.
        width_mm: Width of the edge along it [mm].
        strange: Largest share of places between plate and ground, in a sector of 15 degrees, that are like neither
            cloth nor ground.
        off_axis_mm: Error that a camera beside the axis is expected to leave [mm].
        calibration_mm: Error that scale, centre and tilt are expected to leave, by their stated uncertainty [mm].
        weak_fine: Share of it without a sharp edge at the photograph's own resolution.
        unsettled_mm: How far most of it moved when it was moved to the edges beside it a second time [mm].
        expected_mm: Error across it that the network which read it expects [mm].
        beyond_plate: How far most of it lies outside the plate, in overhangs.
        reread_mm: How far the network moved all of it in or out, from where the light is halfway [mm].
        off_circle_mm: Its root-mean-square deviation from a circle [mm].
        burnt: Share of it where the cloth beside it is overexposed.
    """

    edge: float
    weak_edge: float
    rival: float
    colour: float
    undecided: float
    roughness_mm: float
    at_limit: float
    unseen: float
    beyond_plate: float
    learning_mm: float = 0.0
    disagreement_mm: float = 0.0
    unfound: float = 0.0
    width_mm: float = 0.0
    strange: float = 0.0
    off_axis_mm: float = 0.0
    calibration_mm: float = 0.0
    weak_fine: float = 0.0
    unsettled_mm: float = 0.0
    expected_mm: float = 0.0
    reread_mm: float = 0.0
    off_circle_mm: float = math.inf
    burnt: float = 0.0

    @property
    def total_mm(self) -> float:
        """Error that edge, camera's place and calibration make one expect [mm]."""
        return math.hypot(*(weight * getattr(self, measure) for measure, weight in _WEIGHTS.items()))


@dataclass(frozen=True)
class _Doubt:
    """A reason against an outline.

    Attributes:
        measure: Field or property of the evidence.
        limit: Value at which it speaks as much against as for the outline.
        softness: Change of the value that makes it e times as likely to be wrong; negative where less is worse.
        words: The reason.
    """

    measure: str
    limit: float
    softness: float
    words: str

    def trust(self, evidence: Evidence) -> float:
        """Score of the outline by this alone, from 0 to 1."""
        excess = (getattr(evidence, self.measure) - self.limit) / self.softness
        return 1 / (1 + math.exp(min(max(excess, -50.0), 50.0)))


_DOUBTS = (
    _Doubt("weak_edge", 0.045, 0.012, "no edge along {:.0%} of it"),
    _Doubt("colour", 0.95, -0.008, "the colours of cloth and ground beside it fit only {:.0%}"),
    _Doubt("undecided", 0.06, 0.015, "{:.0%} of the places beside it could be cloth as well as ground"),
    _Doubt("disagreement_mm", 6.0, 1.2, "colours and edges disagree by {:.1f} mm"),
    _Doubt("learning_mm", 2.2, 0.4, "its place depends by {:.1f} mm on which colours are learnt"),
    _Doubt("roughness_mm", 0.36, 0.05, "it is ragged, by {:.2f} mm"),
    _Doubt("unfound", 0.03, 0.008, "no crossing from cloth to ground along {:.0%} of it"),
    _Doubt("weak_fine", 0.05, 0.015, "no sharp edge along {:.0%} of it"),
    _Doubt("unsettled_mm", 1.0, 0.12, "it moves by {:.1f} mm when edges are looked for again"),
    _Doubt("width_mm", 1.6, 0.08, "the picture is blurred over {:.1f} mm"),
    _Doubt("strange", 0.16, 0.03, "{:.0%} of a sector is neither cloth nor ground: something lies on it"),
    _Doubt("at_limit", 0.01, 0.003, "{:.0%} of it lies where no cloth can end"),
    _Doubt("unseen", 0.002, 0.0005, "{:.0%} of it leaves the picture"),
    _Doubt("total_mm", 0.42, 0.04, "its edge, the camera's place and the calibration make {:.1f} mm likely"),
    _Doubt("off_axis_mm", 0.75, 0.05, "the camera is too far beside the axis, which may leave {:.1f} mm: level it"),
    _Doubt(
        "calibration_mm",
        1.2,
        0.05,
        "scale and tilt are uncertain by {:.1f} mm: calibrate with the board, and measure its ruler",
    ),
    # Sharp limits, which no photograph comes near but those that they are about.
    _Doubt("reread_mm", 0.6, 1e-3, "light and network differ by {:.1f} mm all along it: too coarse, or not sharp"),
    _Doubt("burnt", 0.3, 1e-3, "the cloth is overexposed along {:.0%} of it, and looks larger than it is"),
    _Doubt("off_circle_mm", 0.25, -1e-3, "it is a circle within {:.2f} mm: a paper ring, or a part of the meter?"),
    _Doubt("beyond_plate", 0.09, -0.015, "it lies {:.0%} of the overhang outside the plate: is there a cloth?"),
)


def confidence(evidence: Evidence) -> float:
    """Score of how likely an outline is right within half a millimetre: the product of what each doubt leaves.

    Args:
        evidence: What can be seen of it.

    Returns:
        From 0 to 1.
    """
    return math.prod(doubt.trust(evidence) for doubt in _DOUBTS)


def doubts(evidence: Evidence) -> tuple[str, ...]:
    """Reasons against an outline, the gravest first.

    Args:
        evidence: What can be seen of it.

    Returns:
        Reasons in words; the gravest alone where none is grave.
    """
    ordered = sorted(_DOUBTS, key=lambda doubt: doubt.trust(evidence))
    grave = [doubt for doubt in ordered if doubt.trust(evidence) < 0.5] or ordered[:1]
    return tuple(doubt.words.format(getattr(evidence, doubt.measure)) for doubt in grave[:3])
