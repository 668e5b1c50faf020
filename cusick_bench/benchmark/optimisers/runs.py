"""The gradient-free solvers on test functions whose results others have published.

The solvers are the very ones that fit drapes; only what they minimise differs. Published means and standard errors are
those of 50 runs in the result files of Letham et al.; their settings are copied where they are known (REMBO: d = d_e,
four embeddings; HeSBO: d = 2 d_e).

One published row cannot be met: 5.179 for Sobol points on Branin's function is what 10 uniform points reach (5.7); 50
of them reach 1.43, whatever the dimension. That of Hartmann's function, -2.325, is what 200 uniform points reach.

References:
    Letham, Calandra, Rai, Bakshy, Re-Examining Linear Embeddings for High-Dimensional Bayesian Optimization,
    NeurIPS 2020.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cusick_bench.benchmark.optimisers.functions import (
    FUNCTIONS,
    NUMERICS_VERSION,
    AnalyticFunction,
    BenchmarkError,
    Point,
    hide,
)
from cusick_bench.runner.environment import code_state, code_text
from cusick_bench.solvers.bayesian_optimisation.baxus import Baxus
from cusick_bench.solvers.bayesian_optimisation.hesbo import Hesbo
from cusick_bench.solvers.bayesian_optimisation.rembo import Rembo
from cusick_bench.solvers.bayesian_optimisation.turbo import Turbo
from cusick_bench.solvers.bayesian_optimisation.vanilla_bo import VanillaBo
from cusick_bench.solvers.black_box.box import BoxSolver, run_search
from cusick_bench.solvers.black_box.cmaes import CmaEs
from cusick_bench.solvers.black_box.sobol import Sobol

METHODS: dict[str, Callable[[AnalyticFunction], BoxSolver]] = {
    "sobol": lambda function: Sobol(),
    "cmaes": lambda function: CmaEs(),
    "rembo": lambda function: Rembo(embedded=function.coordinates),
    "hesbo": lambda function: Hesbo(embedded=2 * function.coordinates, initial=10),
    "turbo": lambda function: Turbo(initial=10),
    "baxus": lambda function: Baxus(),
    "vanilla-bo": lambda function: VanillaBo(initial=10),
}


@dataclass(frozen=True)
class Published:
    """Best value found: mean, its standard error, and median where it was given."""

    mean: float
    standard_error: float
    median: float | None = None


PUBLISHED_RUNS = 50
"""Runs behind every published mean."""

PUBLISHED: dict[tuple[str, int, int], dict[str, Published]] = {
    ("branin", 100, 50): {
        "rembo": Published(1.433, 0.165, 0.992),
        "hesbo": Published(2.149, 0.716, 0.431),
        "turbo": Published(1.755, 0.329),
        "cmaes": Published(1.642, 0.175),
        "sobol": Published(5.179, 0.622),
    },
    ("hartmann6", 100, 200): {
        "rembo": Published(-1.791, 0.115),
        "hesbo": Published(-2.708, 0.090),
        "turbo": Published(-3.078, 0.057),
        "cmaes": Published(-2.747, 0.027),
        "sobol": Published(-2.325, 0.039),
    },
    ("hartmann6", 1000, 200): {
        "rembo": Published(-1.797, 0.126),
        "hesbo": Published(-2.606, 0.083),
        "turbo": Published(-1.436, 0.102),
        "cmaes": Published(-2.722, 0.038),
        "sobol": Published(-2.327, 0.053),
    },
}
"""By function, dimension and evaluations."""


@dataclass(frozen=True)
class Plan:
    """What to run.

    Attributes:
        function: Name in `FUNCTIONS`.
        dimension: D.
        evaluations: Number of evaluations of each run; 0 for as many as published comparisons spend.
        runs: Number of runs of each method; the coordinates that matter are drawn anew for each.
        methods: Names in `METHODS`, each once.
        seed: Seed of all random choices.
    """

    function: str = "branin"
    dimension: int = 100
    evaluations: int = 0
    runs: int = 10
    methods: tuple[str, ...] = tuple(METHODS)
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "methods", tuple(dict.fromkeys(self.methods)))
        hide(self.function, self.dimension, np.random.default_rng(0))  # refuses what cannot be hidden
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown:
            raise BenchmarkError(f"unknown method {unknown[0]!r}; use one of {', '.join(METHODS)}")
        for name in self.methods:
            embedded = getattr(METHODS[name](FUNCTIONS[self.function]), "embedded", 1)
            if embedded > self.dimension:
                raise BenchmarkError(
                    f"{name} searches {embedded} numbers of {self.function}, got dimension {self.dimension}; raise it, "
                    "or name other methods (--solver)"
                )
        if self.runs < 1 or self.evaluations < 0:
            raise BenchmarkError(f"runs must be >= 1 and evaluations >= 0, got {self.runs} and {self.evaluations}")

    @property
    def spent(self) -> int:
        """Evaluations of each run."""
        return self.evaluations or FUNCTIONS[self.function].evaluations


@dataclass(frozen=True)
class Finished:
    """One finished run.

    Attributes:
        function: Name in `FUNCTIONS`.
        dimension: D.
        evaluations: Number of evaluations that it spent.
        method: Name in `METHODS`.
        run: Number of the run.
        seed: Seed of the plan.
        best: Least value found.
        seconds: Wall time [s].
        numerics: Versions of the solver and of the test functions that made it.
        code: Commit that made it.
    """

    function: str
    dimension: int
    evaluations: int
    method: str
    run: int
    seed: int
    best: float
    seconds: float
    numerics: str
    code: str

    def answers(self, plan: Plan, method: str, run: int) -> bool:
        """Whether it is what a plan asks for.

        Args:
            plan: The plan.
            method: Name in `METHODS`.
            run: Number of the run.

        Returns:
            Whether it need not be run again.
        """
        asked = (plan.function, plan.dimension, plan.spent, plan.seed, method, run)
        return asked == (self.function, self.dimension, self.evaluations, self.seed, self.method, self.run)


def run_numerics(function: str, method: str) -> str:
    """Versions of what decides the numbers of a run.

    Args:
        function: Name in `FUNCTIONS`.
        method: Name in `METHODS`.

    Returns:
        Text such as `solver rembo 1, test functions 1`.
    """
    from cusick_bench.runner.labels import numerics_text

    solver = METHODS[method](FUNCTIONS[function])
    return numerics_text({f"solver {solver.name}": solver.version, "test functions": NUMERICS_VERSION})


def run_once(plan: Plan, method: str, run: int, told: Callable[[], None] = lambda: None) -> list[float]:
    """One run of one method.

    Args:
        plan: What to run.
        method: Name in `METHODS`.
        run: Number of the run.
        told: Called after every evaluation.

    Returns:
        Value of every point asked for.
    """
    hidden = hide(plan.function, plan.dimension, np.random.default_rng([plan.seed, run]))
    values: list[float] = []

    def value(point: Point) -> float:
        values.append(hidden(point))
        told()
        return values[-1]

    generator = np.random.default_rng([plan.seed, run, 1])
    search = METHODS[method](hidden.function).search(plan.dimension, plan.spent, generator)
    run_search(search, value, plan.spent)
    return values


def summary(best: Sequence[float], published: Published | None) -> dict[str, Any]:
    """Mean, standard error and median of the best values of some runs, beside the published ones.

    Args:
        best: Best value of each run.
        published: What others found, None where nothing is published.

    Returns:
        `mean`, `standard_error`, `median`, `best` (of each run), `published`, and `z`: the difference of the means in
        its standard errors, NaN where there is nothing to compare.
    """
    values = np.array(best)
    error = float(values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else math.nan
    z = math.nan
    if published is not None:
        z = (float(values.mean()) - published.mean) / math.hypot(error, published.standard_error)
    return {
        "mean": float(values.mean()),
        "standard_error": error,
        "median": float(np.median(values)),
        "best": values.tolist(),
        "published": None if published is None else asdict(published),
        "z": z,
    }


def compare(
    plan: Plan,
    told: Callable[[str, int], None] = lambda method, run: None,
    *,
    known: Sequence[Finished] = (),
    keep: Callable[[Finished], None] = lambda finished: None,
) -> dict[str, Any]:
    """Runs the methods, in turn, so that one that is stopped has as many runs of each.

    Args:
        plan: What to run.
        told: Called with method and run after every evaluation.
        known: Runs finished before, which are not made again.
        keep: Called with every run that ends.

    Returns:
        The plan, `optimum`, and `methods`: the summary of each, with `seconds_per_run`.

    Raises:
        SolverError: A method runs on a package that is not installed.
    """
    finished: dict[str, list[Finished]] = {method: [] for method in plan.methods}
    for run in range(plan.runs):
        for method in plan.methods:
            before = next((old for old in known if old.answers(plan, method, run)), None)
            if before is None:
                before = _finish(plan, method, run, told)
                keep(before)
            finished[method].append(before)
    published = PUBLISHED.get((plan.function, plan.dimension, plan.spent), {})
    rows = []
    for method, runs in finished.items():
        seconds = float(np.median([run.seconds for run in runs]))  # a run may have been suspended
        found = summary([run.best for run in runs], published.get(method))
        rows.append({"method": method, **found, "seconds_per_run": seconds})
    return {
        **asdict(plan),
        "evaluations": plan.spent,
        "optimum": FUNCTIONS[plan.function].optimum,
        "methods": rows,
    }


def _finish(plan: Plan, method: str, run: int, told: Callable[[str, int], None]) -> Finished:
    clock = time.perf_counter()
    best = min(run_once(plan, method, run, lambda: told(method, run)))
    seconds, code = time.perf_counter() - clock, code_text({"code": code_state()})
    question = (plan.function, plan.dimension, plan.spent)
    return Finished(*question, method, run, plan.seed, best, seconds, run_numerics(plan.function, method), code)
