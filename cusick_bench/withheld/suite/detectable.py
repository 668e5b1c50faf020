"""How strong an effect must be to be found: a table over fabrics, made elsewhere (`cusick-bench atlas power`).

What a limp cloth hides a stiff one shows: the same offset of a camera is found at a quarter of the size. So severities
are given for several levels of

    l = ln( B / (rho g R^3) )

B the bending stiffness at rest, rho the areal density, R the cloth's radius, and interpolated between them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import exp, isfinite, log
from pathlib import Path
from typing import Any

import numpy as np

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.checked_json import listed, mapping, number, read_object


@dataclass(frozen=True)
class Detectable:
    """Detectable severities.

    Attributes:
        stiffness: Levels l, ascending.
        severity: By effect, at each level, in its own unit; None where it is never found.
    """

    stiffness: tuple[float, ...]
    severity: Mapping[str, tuple[float | None, ...]]

    def at(self, name: str, stiffness: float) -> float | None:
        """Detectable severity of an effect in a fabric, log-linear between levels; None where it is not known.

        Args:
            name: The effect.
            stiffness: The fabric's l; beyond the table its end counts.
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


def read_detectable(path: Path) -> Detectable:
    """Reads a table.

    Args:
        path: JSON `{"stiffness": [l, ...], "severity": {effect: [number or null, ...]}}`.

    Raises:
        WithheldError: Not such a file, levels that do not ascend, or severities that are not positive.
    """
    found = read_object(path)
    levels = listed(found.get("stiffness"), None, f"{path}: stiffness")
    stiffness = tuple(number(level, f"{path}: stiffness") for level in levels)
    if not stiffness or not all(a < b for a, b in pairwise(stiffness)):
        raise WithheldError(
            f"{path}: stiffness must be levels that ascend, got {levels}; see `cusick-bench atlas power`"
        )
    table = mapping(found.get("severity"), f"{path}: severity")
    return Detectable(
        stiffness, {str(name): _severities(row, len(stiffness), f"{path}: {name}") for name, row in table.items()}
    )


def _severities(row: Any, count: int, where: str) -> tuple[float | None, ...]:
    values = [None if value is None else number(value, where) for value in listed(row, count, where)]
    if any(value is not None and not (isfinite(value) and value > 0) for value in values):
        raise WithheldError(f"{where}: detectable severities are positive, or null where nothing is found, got {row}")
    return tuple(values)
