"""Anytime curves: how good the best fit is after so many drapes, or so many seconds, from the traces of cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.leaderboard.cells.variants import method_label, variants
from cusick_bench.problem.metering.journal import read_trace

COSTS = {"forward_equivalents": "drapes", "wall_seconds": "seconds"}
POINTS = 60  # of a curve


@dataclass(frozen=True)
class Curve:
    """Best training loss of one method over its cost, mean over its cells.

    Attributes:
        label: Name of the method.
        cost: Values of the cost.
        loss: Mean best loss; NaN until every cell has a drape that came to rest.
        low: Smallest over cells.
        high: Largest over cells.
        end: Cost at which the last of its cells had ended.
    """

    label: str
    cost: Float[ndarray, " points"]
    loss: Float[ndarray, " points"]
    low: Float[ndarray, " points"]
    high: Float[ndarray, " points"]
    end: float

    @property
    def until_end(self) -> "Curve":
        """The curve up to its end, which is its last point: as it is drawn."""
        before = self.cost < self.end
        loss, low, high = (np.append(values[before], values[-1]) for values in (self.loss, self.low, self.high))
        return Curve(self.label, np.append(self.cost[before], self.end), loss, low, high, self.end)


@dataclass(frozen=True)
class Steps:
    """Best loss of one cell as a step function of its cost."""

    cost: Float[ndarray, " evaluations"]
    loss: Float[ndarray, " evaluations"]

    def at(self, cost: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
        """Best loss when so much was spent; infinite before the first success.

        Args:
            cost: Values of the cost.

        Returns:
            Best loss at each.
        """
        place = np.searchsorted(self.cost, cost, side="right") - 1
        return np.where(place >= 0, self.loss[np.maximum(place, 0)], inf)


def traces(table: pd.DataFrame, cost: str) -> dict[tuple[str, str], list[Steps]]:
    """Traces of the cells of each (solver, variant) that has any.

    Args:
        table: Table of cells, from `load_cells`.
        cost: One of `COSTS`.

    Returns:
        Step functions of its cells, by (solver, variant).
    """
    found = {}
    for name, group in variants(table):
        steps = [steps_of(folder, cost) for folder in group["folder"]]
        if steps and all(len(step.cost) for step in steps):
            found[name] = steps
    return found


def curves(table: pd.DataFrame, cost: str) -> list[Curve]:
    """Anytime curves of all methods that simulate, best at the end first.

    Args:
        table: Table of cells, from `load_cells`.
        cost: One of `COSTS`.

    Returns:
        A curve a method; none where no cell has a trace.
    """
    found = traces(table, cost)
    if not found:
        return []
    start = min(step.cost[0] for steps in found.values() for step in steps)
    stop = max(step.cost[-1] for steps in found.values() for step in steps)
    first_end = min(_end(steps) for steps in found.values())
    points = np.geomspace(max(start, min(1e-3 * stop, 0.1 * first_end)), stop, POINTS)
    made = [_curve(method_label(*name), steps, points) for name, steps in found.items()]
    return sorted(made, key=lambda curve: float(np.nan_to_num(curve.loss[-1], nan=inf)))


def loss_at_equal_time(table: pd.DataFrame) -> tuple[float, dict[tuple[str, str], float]]:
    """Mean best loss of each method once the first of them had ended.

    Args:
        table: Table of cells, from `load_cells`.

    Returns:
        That wall time [s], and the losses; infinite for who had no drape by then.
    """
    found = traces(table, "wall_seconds")
    if not found:
        return inf, {}
    shortest = min(float(np.mean([step.cost[-1] for step in steps])) for steps in found.values())
    point = np.array([shortest])
    return shortest, {name: float(np.mean([step.at(point)[0] for step in steps])) for name, steps in found.items()}


def documents(table: pd.DataFrame) -> dict[str, dict[str, Mapping[str, object]]]:
    """Curves over every cost as plain numbers.

    Args:
        table: Table of cells, from `load_cells`.

    Returns:
        Numbers of every curve, by cost and by method.
    """
    return {
        cost: {
            curve.label: {"cost": curve.cost, "loss": curve.loss, "low": curve.low, "high": curve.high}
            | {"end": curve.end}
            for curve in curves(table, cost)
        }
        for cost in COSTS
    }


def steps_of(folder: Path | str, cost: str) -> Steps:
    """Best loss of a cell over its cost; draws from a posterior are no search, so they are left out.

    Args:
        folder: The cell's folder.
        cost: One of `COSTS`.

    Returns:
        The step function, without steps where the cell has no trace.
    """
    points = [_point(line, cost) for line in read_trace(Path(folder)) if line.get("kind") != "draw"]
    known = np.array([point for point in points if point is not None]).reshape(-1, 2)
    return Steps(known[:, 0], known[:, 1])


def _point(line: Mapping[str, Any], cost: str) -> tuple[float, float] | None:
    """Cost and best loss of a line, the loss infinite before the first success.

    None of a damaged line, and of one before anything was spent, which has no place on a logarithmic axis.
    """
    try:
        spent, loss = float(line[cost]), inf if line["best_loss"] is None else float(line["best_loss"])
    except (KeyError, TypeError, ValueError):
        return None
    return (spent, loss) if 0 < spent < inf and loss >= 0 else None


def _curve(label: str, steps: list[Steps], points: Float[ndarray, " points"]) -> Curve:
    losses = np.stack([step.at(points) for step in steps])
    losses[:, ~np.isfinite(losses).all(0)] = np.nan
    return Curve(label, points, losses.mean(0), losses.min(0), losses.max(0), _end(steps))


def _end(steps: list[Steps]) -> float:
    """Cost at which the last of a method's cells had ended."""
    return max(float(step.cost[-1]) for step in steps)
