"""Detectable severities of effects, a table from `cusick-bench atlas power`.

They depend on the stiffness of the cloth: in stiff cloth an offset of the camera is found at a quarter of the size that
limp cloth needs. So severities are given for several levels of

    l = ln( B / (rho g R^3) )

B the bending stiffness at rest, rho the areal density, R the cloth's radius, and interpolated between them.
"""

from itertools import pairwise
from math import exp, log
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, model_validator
from pydantic.dataclasses import dataclass

from cusick_bench.withheld.format.checked_json import read_object, validated
from cusick_bench.withheld.format.fields import Number, broken_rule


@dataclass(frozen=True)
class DetectableSeverities:
    """Detectable severities; the form of a table's file.

    Attributes:
        stiffness: Levels l, ascending.
        severity: Detectable severity by effect, at each level, in its own unit; None where it is never found.
    """

    stiffness: tuple[Number, ...]
    severity: dict[str, tuple[Number | None, ...]]

    @model_validator(mode="after")
    def _check(self) -> "DetectableSeverities":
        levels = list(self.stiffness)
        if not levels or not all(a < b for a, b in pairwise(levels)):
            raise broken_rule(f"stiffness must be levels that ascend, got {levels}; see `cusick-bench atlas power`")
        for effect, row in self.severity.items():
            if len(row) != len(levels):
                raise broken_rule(f"severity of {effect} must be a list of {len(levels)}, got {list(row)}; correct it")
            if any(value is not None and not value > 0 for value in row):
                raise broken_rule(
                    f"detectable severities are positive, or null where nothing is found, got {list(row)} for {effect}"
                )
        return self

    def at(self, name: str, stiffness: float) -> float | None:
        """Detectable severity of an effect in a fabric, log-linear between levels; None where it is not known.

        Args:
            name: The effect.
            stiffness: The fabric's l; beyond the table its end counts.

        Returns:
            The severity in the effect's own unit.
        """
        if name not in self.severity:
            return None
        place = float(np.interp(stiffness, self.stiffness, np.arange(len(self.stiffness))))
        below, share = int(place), place - int(place)
        ends = [(below, 1 - share), (below + 1, share)] if share else [(below, 1.0)]
        total = 0.0
        for index, weight in ends:
            value = self.severity[name][index]
            if value is None:
                return None
            total += weight * log(value)
        return exp(total)


_TABLE = TypeAdapter(DetectableSeverities)


def read_detectable(path: Path) -> DetectableSeverities:
    """Reads a table.

    Args:
        path: JSON `{"stiffness": [l, ...], "severity": {effect: [number or null, ...]}}`.

    Returns:
        The table.

    Raises:
        WithheldError: Not such a file, levels that do not ascend, or severities that are not positive.
    """
    return validated(_TABLE, read_object(path, "make it by `atlas power --out`"), str(path))
