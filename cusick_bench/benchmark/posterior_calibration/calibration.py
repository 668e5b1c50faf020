"""Whether a solver's intervals of stiffness hold the truth as often as they say: simulation-based calibration.

Parameters are drawn from the prior that the solver assumes, a drape is simulated with them, and the solver sees its
silhouette. Where the posterior is right, the truth's rank among draws of it is uniform, whatever the prior: its
intervals of 90 % hold nine truths out of ten. Too many ranks at the ends are intervals that are too narrow, too many in
the middle intervals that are too wide, too many at one end a bias.

This is a test of the inference alone. Simulator and prior are right by construction, as they never are for real cloth.

References:
    Talts, Betancourt, Simpson, Vehtari, Gelman. Validating Bayesian inference algorithms with simulation-based
    calibration. arXiv:1804.06788, 2018. Cook, Gelman, Rubin. Validation of software for Bayesian models using
    posterior quantiles. Journal of Computational and Graphical Statistics 15(3), 2006.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.metrics.stiffness import BENDING
from cusick_bench.sim.constants import DEFAULT_LAW
from cusick_bench.sim.errors import CusickError, failure_text, raise_stop
from cusick_bench.sim.memory import memory_returned

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem
    from cusick_bench.problem.drape_problem import Vector
    from cusick_bench.sim.setup import Simulators

BINS = 10
"""Number of bins of the histogram of the truth's rank among posterior draws."""
_DENSITIES = (0.06, 0.35)  # [kg/m2] between which cloths are, evenly in the logarithm
_MOST_TRIALS = 20  # cloths drawn until one drapes
_INTERVALS = (0.5, 0.9)


class CalibrationError(CusickError, ValueError):
    """A solver that cannot be calibrated, or a plan that cannot be carried out."""


@dataclass(frozen=True)
class CalibrationPlan:
    """What to fit.

    Attributes:
        solver: Who is tested, with options, as `run --solver` takes it.
        fits: Number of cloths.
        vertices: Vertices of the mesh; from about 300 on limp cloth folds instead of standing stiffly on its mesh.
        budget: Most forward-equivalents of each fit.
        law: Material law of truth and fit.
        seed: Seed of the cloths.

    Raises:
        CalibrationError: A solver that draws from no posterior, or no fits.
    """

    solver: str = "bdp-field"
    fits: int = 100
    vertices: int = 297
    budget: float = 1000.0
    law: str = DEFAULT_LAW
    seed: int = 0

    def __post_init__(self) -> None:
        from cusick_bench.solvers.base import Solver
        from cusick_bench.solvers.registry import make_solver

        solver = make_solver(self.solver)
        if solver.kind != "solver" or solver.needs_mesh or type(solver).redraw is Solver.redraw:
            raise CalibrationError(f"{self.solver} has no posterior of stiffness; use bdp-field or bdp")
        if self.fits < 1:
            raise CalibrationError(f"fits must be >= 1, got {self.fits}")


@dataclass(frozen=True)
class CalibrationFit:
    """One cloth and what the solver made of it; stiffnesses in the order of `BENDING`.

    Attributes:
        number: Number of the cloth.
        density: Its areal density [kg/m2].
        true: Its bending stiffness [N m].
        median: Median of the posterior [N m].
        rank: Share of the posterior's draws below the truth.
        seconds: Wall time of the fit [s].
        numerics: Versions of what made it.
    """

    number: int
    density: float
    true: tuple[float, float, float]
    median: tuple[float, float, float]
    rank: tuple[float, float, float]
    seconds: float
    numerics: str


@dataclass(frozen=True)
class FailedFit:
    """A cloth that the solver could not fit.

    Attributes:
        number: Number of the cloth.
        failure: Why.
    """

    number: int
    failure: str


def plan_numerics(plan: CalibrationPlan) -> str:
    """Everything that decides the numbers of a fit, apart from its cloth.

    Args:
        plan: The plan.

    Returns:
        The plan's own values and the versions of the code's parts.
    """
    from cusick_bench.runner.labels import numerics_text
    from cusick_bench.runner.numerics import cell_numerics
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.solvers.registry import make_solver

    versions = cell_numerics(make_solver(plan.solver), DrapeSettings(law=plan.law))  # pyright: ignore[reportArgumentType]
    asked = f"{plan.solver}, {plan.vertices} vertices, budget {plan.budget:.15g}, law {plan.law}, seed {plan.seed}"
    return f"{asked}; {numerics_text(versions)}"


@memory_returned()
def calibration_fit(plan: CalibrationPlan, number: int, simulators: Simulators | None = None) -> CalibrationFit:
    """Draws a cloth from the solver's prior, drapes it and has the solver find its stiffness.

    Args:
        plan: What to fit.
        number: Number of the cloth.
        simulators: Simulators that are reused from fit to fit.

    Returns:
        The fit.

    Raises:
        CalibrationError: The solver gives no posterior, or no cloth of its prior drapes.
    """
    import time

    from cusick_bench.metrics.found_stiffness import find_stiffness
    from cusick_bench.problem import Budget
    from cusick_bench.sim.setup import Simulators
    from cusick_bench.solvers.registry import make_solver

    kept, solver = simulators or Simulators(), make_solver(plan.solver)
    generator = np.random.default_rng([plan.seed, number])
    density = float(np.exp(generator.uniform(*np.log(_DENSITIES))))
    blank = _problem(plan, density, kept, Budget())
    tau, image = _draped(blank, generator)
    problem = _problem(plan, density, kept, Budget(plan.budget), image)
    begin = time.monotonic()
    prediction = solver.solve(problem, np.random.default_rng([plan.seed, number, 1]))
    seconds = time.monotonic() - begin
    _, drawn = find_stiffness(solver, problem, prediction)
    if drawn is None:
        raise CalibrationError(f"{plan.solver} gives no posterior of stiffness; use bdp-field or bdp")
    true = _cloth_bending(problem, tau)
    return CalibrationFit(
        number,
        density,
        _as_triple(true),
        _as_triple(np.median(drawn, axis=0)),
        _as_triple((drawn < true).mean(0)),
        seconds,
        plan_numerics(plan),
    )


def _problem(
    plan: CalibrationPlan,
    density: float,
    kept: Simulators,
    budget: Any,
    image: Float[ndarray, "size size"] | None = None,
) -> DrapeProblem:
    """The problem of one cloth; without an image, of nothing."""
    from cusick_bench.datasets.files.protocol import RELEASE
    from cusick_bench.problem import DrapeProblem, Meter, StiffnessPrior
    from cusick_bench.problem.spaces import SPACES
    from cusick_bench.sim.cloth.resolution import cloth_mesh
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.solvers.registry import make_solver

    mesh = cloth_mesh(plan.law, plan.vertices)
    simulator = kept.get(mesh, DrapeSettings(law=plan.law, seed=plan.seed))  # pyright: ignore[reportArgumentType]
    name = make_solver(plan.solver).space or "heter"
    blank = np.zeros((RELEASE.image_size_px,) * 2)
    return DrapeProblem(
        train_image=blank if image is None else image,
        simulator=simulator,
        space=SPACES[name](simulator.mesh, StiffnessPrior(plan.law, density)),
        meter=Meter(budget),
    )


def _draped(problem: DrapeProblem, generator: np.random.Generator) -> tuple[Vector, Float[ndarray, "size size"]]:
    """Parameters of a cloth that drapes, and its silhouette in steps of a byte, as files have it."""
    for _ in range(_MOST_TRIALS):
        tau = problem.sample_prior(generator)
        (seen,) = problem.draw_batch(tau[None])
        if seen is not None:
            return tau, np.rint(255 * seen.image) / 255
    raise CalibrationError(f"none of {_MOST_TRIALS} cloths of the prior drapes; use another law or another mesh")


def _cloth_bending(problem: DrapeProblem, tau: Vector) -> Float[ndarray, " bending"]:
    """Bending stiffness of the cloth, without what belongs to its specimen."""
    import torch

    from cusick_bench.metrics.stiffness import cloth_stiffness, element_weights

    space, own = problem.space, np.array(tau)
    own[space.specimen_level] = 0.0
    with torch.no_grad():
        material = space.specimen(torch.as_tensor(own)).material
    weights = element_weights(space.mesh, problem.simulator.settings.plate_radius)
    return cloth_stiffness(
        material.stretch, material.bending, space.prior.law, weights, float(material.poisson)
    ).bending


def _as_triple(values: Float[ndarray, " bending"]) -> tuple[float, float, float]:
    warp, weft, bias = values.tolist()
    return warp, weft, bias


def _attempt(plan: CalibrationPlan, number: int, simulators: Simulators | None = None) -> CalibrationFit | FailedFit:
    try:
        return calibration_fit(plan, number, simulators)
    except CalibrationError:
        raise  # it is the plan that fails
    except (Exception, SystemExit) as error:
        raise_stop(error)
        return FailedFit(number, failure_text(error))


def calibration_fits(
    plan: CalibrationPlan, numbers: Sequence[int], workers: int = 1
) -> Iterator[CalibrationFit | FailedFit]:
    """Makes several fits; one that fails stops no other.

    Args:
        plan: What to fit.
        numbers: Numbers of the cloths.
        workers: Number of processes.

    Yields:
        The fits as they are finished, in any order.

    Raises:
        CalibrationError: The solver gives no posterior, or no cloth of its prior drapes.
        SimulationError: There is no mesh of so few vertices.
    """
    from concurrent.futures import as_completed

    from cusick_bench.runner.processes import process_pool
    from cusick_bench.sim.cloth.resolution import cloth_mesh

    if numbers:
        cloth_mesh(plan.law, plan.vertices)  # else every fit would fail by itself
    if workers == 1:
        from cusick_bench.sim.setup import Simulators

        simulators = Simulators()
        for number in numbers:
            yield _attempt(plan, number, simulators)
        return
    with process_pool(workers) as pool:
        for done in as_completed([pool.submit(_attempt, plan, number) for number in numbers]):
            yield done.result()


def calibration_table(fits: Sequence[CalibrationFit]) -> list[dict[str, Any]]:
    """How often intervals hold the truth, and whether ranks are uniform.

    Args:
        fits: Finished fits.

    Returns:
        A row a direction: `direction`, `fits`; `cover_50` and `cover_90` with 95 % Wilson intervals (`_low`, `_high`);
        `ranks`, counts in `BINS` bins from 0 to 1; `p_uniform` of their chi-squared test; `bias`, median of found over
        true; `error`, exp of the mean |log(found / true)|.

    Raises:
        CalibrationError: No fit.
    """
    from scipy.stats import binomtest, chisquare

    if not fits:
        raise CalibrationError("no finished fit")
    rows = []
    for place, name in enumerate(BENDING):
        rank = np.array([one.rank[place] for one in fits])
        ratio = np.log([one.median[place] / one.true[place] for one in fits])
        row: dict[str, Any] = {"direction": name, "fits": len(fits)}
        for share in _INTERVALS:
            inside = int((np.abs(rank - 0.5) <= share / 2).sum())
            interval = binomtest(inside, len(fits)).proportion_ci(method="wilson")
            key = f"cover_{100 * share:.0f}"
            row |= {key: inside / len(fits), f"{key}_low": interval.low, f"{key}_high": interval.high}
        counts = np.histogram(rank, bins=BINS, range=(0.0, 1.0))[0]
        row |= {"ranks": counts.tolist(), "p_uniform": float(chisquare(counts).pvalue)}
        row |= {"bias": math.exp(float(np.median(ratio))), "error": math.exp(float(np.abs(ratio).mean()))}
        rows.append(row)
    return rows
