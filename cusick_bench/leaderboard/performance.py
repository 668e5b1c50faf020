"""Performance profiles: on which share of the problems a method is within a factor of the best one.

A problem is a cloth with a seed. With t(p, s) what solver s needs, or misses by, on problem p,

    r(p, s) = t(p, s) / min over solvers of t(p, .)        rho_s(tau) = share of problems with r(p, s) <= tau

rho_s(1) is the share of problems on which s is the best; its value at large tau is the share of problems that s solves
at all. Only problems on which all solvers were run, and which at least one of them solved, are counted. A failed cell
counts as run: its solver has not solved the problem.

Two quantities are compared: the remaining error, and the cost of coming near the lowest training loss that any method
reached (a method that never comes near has not solved the problem).

References:
    E. D. Dolan, J. J. More. Benchmarking optimization software with performance profiles. Math. Program. 91, 2002,
    equations 1 and 2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.leaderboard.anytime import Steps, steps_of
from cusick_bench.leaderboard.bootstrap import cell_values, repeats
from cusick_bench.leaderboard.cells.loading import Skipped
from cusick_bench.leaderboard.cells.variants import Problem, method_label, problems_run, variants

NEAR = 0.1
"""A loss counts as reached within this relative distance of the lowest one."""

_SEARCHING = "solver"  # kind of cells that compete; rows without physics, and oracles, are no solvers


@dataclass(frozen=True, eq=False)
class PerformanceProfile:
    """Performance profile of a method: how near to the best it is, over all problems.

    Attributes:
        label: Name of the method.
        ratios: r of each problem, smallest first; infinite where it has no answer.
    """

    label: str
    ratios: Float[ndarray, " problems"]

    def share(self, factor: float) -> float:
        """rho at a factor.

        Args:
            factor: tau, at least 1.

        Returns:
            Share of the problems within that factor of the best.
        """
        return float(np.searchsorted(self.ratios, factor * (1 + 1e-12), side="right") / len(self.ratios))


def performance_profiles(needs: Mapping[str, Mapping[Problem, float]]) -> list[PerformanceProfile]:
    """Profiles of methods.

    Args:
        needs: t by method and problem that it was run on, above 0; infinite where it failed.

    Returns:
        A profile a method, the one that is most often the best first, over the problems that all were run on; none
        without such a problem that anybody solves.
    """
    shared = set[Problem].intersection(*(set(of_method) for of_method in needs.values())) if needs else set()
    best = {problem: min(of_method[problem] for of_method in needs.values()) for problem in sorted(shared)}
    best = {problem: least for problem, least in best.items() if isfinite(least)}
    if not best:
        return []
    profiles = []
    for label, of_method in needs.items():
        ratios = [_ratio(of_method[problem], least) for problem, least in best.items()]
        profiles.append(PerformanceProfile(label, np.sort(ratios)))
    return sorted(profiles, key=lambda profile: (-profile.share(1), -profile.share(2), profile.label))


def error_profiles(
    table: pd.DataFrame, metric: str = "test_mse", *, skipped: Sequence[Skipped] = ()
) -> list[PerformanceProfile]:
    """Profiles of the error that is left.

    Args:
        table: Table of cells, from `load_cells`.
        metric: Metric of which smaller is better, and 0 the best there is.
        skipped: The folder's other cells, from there too; those that failed count against their solver.

    Returns:
        A profile for each method that fits; none where fewer than two methods do, or where a value is below 0, of
        which nothing is a multiple.
    """
    methods = _methods(table, skipped)
    values = {method.label: cell_values(method.cells, metric) for method in methods}
    if any(value < 0 for of_method in values.values() for value in of_method.values()):
        return []
    return _of_several({method.label: method.needs(values[method.label]) for method in methods})


def cost_profiles(
    table: pd.DataFrame, cost: str = "forward_equivalents", *, skipped: Sequence[Skipped] = ()
) -> list[PerformanceProfile]:
    """Profiles of the cost of coming within `NEAR` of the lowest training loss that any method reached.

    Args:
        table: Table of cells, from `load_cells`.
        cost: One of `anytime.COSTS`.
        skipped: The folder's other cells, from there too; those that failed count against their solver.

    Returns:
        A profile for each method that fits; none where fewer than two methods have traces.
    """
    methods = _methods(table, skipped)
    traces = {method.label: _traces(method.cells, cost) for method in methods}
    lowest: dict[Problem, float] = {}
    for of_method in traces.values():
        for problem, steps in of_method.items():
            lowest[problem] = min(lowest.get(problem, inf), float(steps.loss.min()))
    return _of_several(
        {
            method.label: method.needs(
                {
                    problem: _cost_to(steps, (1 + NEAR) * lowest[problem])
                    for problem, steps in traces[method.label].items()
                }
            )
            for method in methods
            if traces[method.label]
        }
    )


@dataclass(frozen=True, eq=False)
class _Method:
    """Cells of one method.

    Attributes:
        label: Its name.
        cells: Those that are finished.
        problems: What it was run on, with or without success.
    """

    label: str
    cells: pd.DataFrame
    problems: frozenset[Problem]

    def needs(self, known: Mapping[Problem, float]) -> dict[Problem, float]:
        """t by problem; infinite where nothing is known of what became of it."""
        return {problem: known.get(problem, inf) for problem in self.problems}


def _of_several(needs: Mapping[str, Mapping[Problem, float]]) -> list[PerformanceProfile]:
    return performance_profiles(needs) if len(needs) > 1 else []


def _methods(table: pd.DataFrame, skipped: Sequence[Skipped]) -> list[_Method]:
    return [
        _Method(method_label(*name), group, problems_run(group, skipped))
        for name, group in variants(table)
        if str(group["kind"].iloc[0]) == _SEARCHING
    ]


def _traces(group: pd.DataFrame, cost: str) -> dict[Problem, Steps]:
    cells = zip(group["cloth"], repeats(group), group["folder"], strict=True)
    found = {(str(cloth), number): steps_of(folder, cost) for cloth, number, folder in cells}
    return {problem: steps for problem, steps in found.items() if len(steps.cost)}


def _cost_to(steps: Steps, loss: float) -> float:
    reached = np.flatnonzero(steps.loss <= loss)
    return float(steps.cost[reached[0]]) if len(reached) and isfinite(loss) else inf


def _ratio(need: float, least: float) -> float:
    """How many times the least a method needs; of nothing, one that needs nothing too is as good as the best."""
    if not isfinite(need):
        return inf
    return need / least if least > 0 else 1.0 if need <= 0 else inf
