"""Labels of withheld cases: what acted, how strongly and where, in the package's names and units."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.withheld.format.causes import NONE, UNKNOWN, class_of
from cusick_bench.withheld.format.label import LabelDocument
from cusick_bench.withheld.suite.design import EFFECTS, OUTSIDE, Plan


def label_of(plan: Plan) -> LabelDocument:
    """Writes the label of a case.

    Args:
        plan: Plan of the case.

    Returns:
        The label, not yet sealed; of a pair, effect, class, severity, parameters and location are lists.
    """
    causes = [_cause(name, dict(value)) for name, value in plan.causes.items()]
    if not causes:
        causes = [{"effect": NONE, "class": NONE, "severity": 0.0, "parameters": {}, "location": None}]
    joined = causes[0] if len(causes) == 1 else {key: [cause[key] for cause in causes] for key in causes[0]}
    more = {"oracle_closure": None, "kind": plan.kind, "reference": plan.reference}
    if plan.kind != "null":
        more["multiple" if plan.reference == "detectable" else "multiple_of_typical"] = plan.multiple
    return LabelDocument.model_validate(joined | more)


def _cause(name: str, value: dict[str, float]) -> dict[str, Any]:
    """The part of a label that is about one effect."""
    if name in OUTSIDE:
        outside = {"effect": UNKNOWN, "class": UNKNOWN, "name": name}
        return {**outside, "severity": value[OUTSIDE[name].severity], "parameters": value, "location": None}
    return {
        "effect": name,
        "class": class_of(name),
        "severity": value[EFFECTS[name].severity],
        "parameters": value,
        "location": _location(name, value),
    }


def _location(name: str, value: Mapping[str, float]) -> dict[str, Any] | None:
    """Where a local effect acts: angles from and to [deg], counter-clockwise, and radii [m]."""
    if name == "rim-stiffening":
        return {"kind": "ring", "angle_deg": [0.0, 360.0], "radius_m": [CLOTH_RADIUS - value["width"], CLOTH_RADIUS]}
    if name not in ("local-stiff-patch", "local-mass-patch"):
        return None
    reach = np.sqrt(2) * value["size"]
    half = float(np.degrees(np.arcsin(reach / value["radius"])))
    angles = [(value["direction"] + turn) % 360 for turn in (-half, half)]
    radii = np.clip([value["radius"] - reach, value["radius"] + reach], PLATE_RADIUS, CLOTH_RADIUS)
    return {
        "kind": "patch",
        "angle_deg": [round(angle, 2) for angle in angles],
        "radius_m": [round(float(radius), 4) for radius in radii],
    }
