"""Performance profiles: on which share of the problems a method is within a factor of the best one.

A problem is a cloth with a seed. With t(p, s) what solver s needs, or misses by, on problem p,

    r(p, s) = t(p, s) / min over solvers of t(p, .)        rho_s(tau) = share of problems with r(p, s) <= tau

rho_s(1) is the share of problems on which s is the best; its height far right is the share that it solves at all.
Two quantities are compared: an error that is left, and the cost of coming near the lowest training loss that any
method reached (there a method that never comes near has solved nothing).

References:
    E. D. Dolan, J. J. More. Benchmarking optimization software with performance profiles. Math. Program. 91, 2002,
    equations 1 and 2.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.leaderboard.anytime import Steps, method_label, steps_of
from cusick_bench.leaderboard.board import variants
from cusick_bench.leaderboard.bootstrap import cell_values

NEAR = 0.1
"""A loss counts as reached within this relative distance of the lowest one."""

Problem = tuple[str, int]  # cloth, seed
_SEARCHING = "solver"  # kind of cells that compete; rows without physics, and oracles, are no solvers


@dataclass(frozen=True, eq=False)
class PerformanceProfile:
    """How near to the best a method is, over all problems.

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
        needs: t by method and problem, above 0; what is missing or infinite is a failure.

    Returns:
        A profile a method, the one that is most often the best first; none without a problem that anybody solves.
    """
    best: dict[Problem, float] = {}
    for of_method in needs.values():
        for problem, need in of_method.items():
            if isfinite(need):
                best[problem] = min(best.get(problem, inf), need)
    if not best:
        return []
    profiles = []
    for label, of_method in needs.items():
        ratios = [_ratio(of_method.get(problem, inf), least) for problem, least in best.items()]
        profiles.append(PerformanceProfile(label, np.sort(ratios)))
    return sorted(profiles, key=lambda profile: (-profile.share(1), -profile.share(2), profile.label))


def error_profiles(table: pd.DataFrame, metric: str = "test_mse") -> list[PerformanceProfile]:
    """Profiles of the error that is left.

    Args:
        table: Table of cells, from `load_cells`.
        metric: Metric of which smaller is better, and 0 the best there is.

    Returns:
        A profile for each method that fits; none where fewer than two methods do.
    """
    return _of_several({label: cell_values(group, metric) for label, group in _methods(table).items()})


def cost_profiles(table: pd.DataFrame, cost: str = "forward_equivalents") -> list[PerformanceProfile]:
    """Profiles of the cost of coming within `NEAR` of the lowest training loss that any method reached.

    Args:
        table: Table of cells, from `load_cells`.
        cost: One of `anytime.COSTS`.

    Returns:
        A profile for each method that fits; none where fewer than two methods have traces.
    """
    traces = {label: _traces(group, cost) for label, group in _methods(table).items()}
    lowest: dict[Problem, float] = {}
    for of_method in traces.values():
        for problem, steps in of_method.items():
            lowest[problem] = min(lowest.get(problem, inf), float(steps.loss.min()))
    return _of_several(
        {
            label: {problem: _cost_to(steps, (1 + NEAR) * lowest[problem]) for problem, steps in of_method.items()}
            for label, of_method in traces.items()
            if of_method
        }
    )


def _of_several(needs: Mapping[str, Mapping[Problem, float]]) -> list[PerformanceProfile]:
    return performance_profiles(needs) if len(needs) > 1 else []


def _methods(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {method_label(name): group for name, group in variants(table) if str(group["kind"].iloc[0]) == _SEARCHING}


def _traces(group: pd.DataFrame, cost: str) -> dict[Problem, Steps]:
    cells = zip(group["cloth"], group["seed"], group["folder"], strict=True)
    found = {(str(cloth), int(seed)): steps_of(folder, cost) for cloth, seed, folder in cells}
    return {problem: steps for problem, steps in found.items() if len(steps.cost)}


def _cost_to(steps: Steps, loss: float) -> float:
    reached = np.flatnonzero(steps.loss <= loss)
    return float(steps.cost[reached[0]]) if len(reached) and isfinite(loss) else inf


def _ratio(need: float, least: float) -> float:
    """How many times the least a method needs; of nothing, one that needs nothing too is as good as the best."""
    if not isfinite(need):
        return inf
    return need / least if least > 0 else 1.0 if need <= 0 else inf
