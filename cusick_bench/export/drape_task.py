"""A cloth's fit as another benchmark's program poses it: strings in, a metered answer and its scores out.

The cells are those of `cusick-bench run`, so that both give the same numbers for the same seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from cusick_bench.datasets import DrapeDataset
from cusick_bench.problem import Budget, DrapeProblem
from cusick_bench.runner import Cell, ProblemSettings, Source, build_problem, load_once, plan
from cusick_bench.runner.cell import score_cell, solve_cell
from cusick_bench.runner.warm_up import DRAPES, WarmUp
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import CusickError
from cusick_bench.solvers.base import Prediction

if TYPE_CHECKING:
    from cusick_bench.sim.constants import Law

FEWEST_DRAPES = DRAPES
"""Forward-equivalents with which every solver can answer."""

_ANY = "null:copy"  # whose cells have the samples of every other solver's


@dataclass(frozen=True)
class Attempt:
    """A problem that is posed, its budget not touched.

    Attributes:
        dataset: The data set.
        cell: What is asked.
        problem: The problem, with its meter.
    """

    dataset: DrapeDataset
    cell: Cell
    problem: DrapeProblem

    def solve(self) -> Prediction:
        """The solver's answer within its budget.

        Raises:
            CusickError: The solver cannot answer this problem.
        """
        return solve_cell(self.problem, self.dataset, self.cell)


@dataclass(frozen=True)
class DrapeTask:
    """One cloth of a data set, to be fitted from one sample and judged on the others.

    Attributes:
        data: Name of a data set, or a folder.
        cloth: Cloth.
        settings: The problem's settings; the budget is each attempt's own.
        protocol: How samples are split into training and held out.
    """

    data: str
    cloth: str
    settings: ProblemSettings = field(default_factory=ProblemSettings)
    protocol: str = "paper"

    def attempt(self, solver: str, *, seed: int, drapes: float = FEWEST_DRAPES) -> Attempt:
        """Poses the problem for a solver.

        Args:
            solver: Registered name, with options.
            seed: Of the solver's generator and of the laid-down shape.
            drapes: Forward-equivalents that it may spend; `FEWEST_DRAPES` where that is more.

        Returns:
            The problem, ready to be solved.

        Raises:
            CusickError: The data cannot be read, an unknown solver or cloth, or a solver that does not fit.
        """
        dataset = load_once(Source(self.data))
        cell = self._cell(dataset, solver, max(drapes, FEWEST_DRAPES), seed)
        return Attempt(dataset, cell, build_problem(dataset, cell))

    def refusal(self, solver: str) -> str | None:
        """Why a solver cannot be used here, None where it can.

        Args:
            solver: Registered name, with options.

        Returns:
            The reason.
        """
        try:
            self._cell(load_once(Source(self.data)), solver, FEWEST_DRAPES, 0)
        except CusickError as error:
            return str(error)
        return None

    def warm_up(self, solver: str) -> None:
        """Compiles the kernels that a solver calls, so that nobody times the compiler.

        Args:
            solver: Registered name, with options.

        Raises:
            CusickError: As `attempt`.
        """
        dataset = load_once(Source(self.data))
        WarmUp().before(dataset, self._cell(dataset, solver, FEWEST_DRAPES, 0))

    def scores(self, prediction: Prediction) -> dict[str, float]:
        """Scores of an answer on the training sample and on the samples that were held out.

        Args:
            prediction: From `Attempt.solve`.

        Returns:
            `value`, the training MSE, which solvers minimise, and every metric of `cusick_bench.metrics` by name.

        Raises:
            MetricError: The prediction does not fit these samples.
        """
        dataset = load_once(Source(self.data))
        scores = score_cell(dataset, self._cell(dataset, _ANY, FEWEST_DRAPES, 0), prediction)
        return {"value": scores["train_mse"], **scores}

    def _cell(self, dataset: DrapeDataset, solver: str, drapes: float, seed: int) -> Cell:
        (cell,) = plan(
            dataset,
            solvers=[solver],
            cloths=[self.cloth],
            seeds=[seed],
            settings=replace(self.settings, budget=Budget(drapes)),
            protocol=self.protocol,
        )
        return cell


def drape_task(data: str, cloth: str, *, vertices: int, steps: int, law: Law, space: str) -> DrapeTask:
    """A task from plain values, as parameter grids of other programs hold them.

    Args:
        data: Name of a data set, or a folder.
        cloth: Cloth.
        vertices: Vertices of the cloth's mesh.
        steps: Time steps of a drop.
        law: Material law.
        space: Parameter space of solvers that have none of their own.

    Returns:
        The task; data are read when it is used.

    Raises:
        CusickError: An unknown law or space, or a number out of bounds.
    """
    return DrapeTask(
        data, cloth, ProblemSettings(space=space, vertices=vertices, drape=DrapeSettings(law=law, steps=steps))
    )
