"""Gradient fit of one stretch table a face and one bending table a hinge: 241,680 numbers on 2699 vertices.

One silhouette does not determine as many numbers, so the fit is a regularised one: tau = tau_0 + (39 numbers that all
elements share) + (smooth fields), with tau_0 the best cloth of the search for the bending level, and a Gaussian
prior on both (`smooth_field`), whose white coordinates z minimise

    J(z) = MODES E(tau(z)) / FLOOR + |z|^2 / 2,

the negative log likelihood of the silhouette's harmonics, with an error that corresponds to how accurately edges are
drawn, plus the negative log prior. Every table can change independently, but the prior makes neighbouring tables change
together over its correlation length, and keeps tables as they are unless the silhouette requires a change. E compares
blurred silhouettes (`blurred_misfit`), since the squared error of pixels has a kink wherever outlines meet. The answer
is the cloth with the lowest loss of all that were draped, whatever its J.

J is minimised by a walk of Gauss-Newton steps (`gauss_newton`). J is not continuous: where a fold appears or vanishes,
which in limp cloth may happen within 1e-4 of a step, the drape and J jump, and a search that accepts only lower values
soon gets stuck at a jump. So every step is accepted, whether J rises or falls, and only the largest allowed step length
shrinks; after a failed drape the walk returns to its lowest point. All state is saved every few steps, and a killed run
goes on from there.

References:
    Gong, Mao, Wang, Bayesian Differentiable Physics for Cloth Digitalization, CVPR 2024 (the row HETER of Table 1).
    Lindgren, Rue, Lindstroem, J. Royal Statistical Society B 73(4), 2011.
    Schlenkrich, Griewank, Walther, Math. Programming 121, 2010.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.problem import BudgetExceeded
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at, require_at_least, require_positive
from cusick_bench.solvers.gradient.gauss_newton import Adjoints, damped_step
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.level_search import match_bending_level

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem
    from cusick_bench.solvers.gradient.smooth_field import StiffnessField


FLOOR = 1e-4  # E of two drawings of one outline 0.3 px (0.4 mm) apart, at a blur of 2 px of the release
MODES = 20.0  # independent numbers in a silhouette, halved: harmonics 1 to 20, cosine and sine
LAST = 0.1  # last radius over the first
RECOVERY = 1.25  # factor on a reduced radius after a step that did not fail
SAVED = 8  # number of steps after which the state is saved

PARTS = ("z", "residual", "product")  # arrays of a point in a saved state

White = Float[np.ndarray, " white"]
Residual = Float[np.ndarray, " kept"]


class BlurredIncumbent(Incumbent):
    """An incumbent of the problem's loss, whose gradients are those of the blurred misfit."""

    def __init__(self, problem: DrapeProblem, blur: float) -> None:
        from cusick_bench.solvers.gradient.blurred_misfit import BlurredMisfit

        super().__init__(problem)
        self._misfit = BlurredMisfit(problem.train_image, blur, problem.protocol)

    def residual_and_product(self, tau: np.ndarray) -> tuple[Residual, np.ndarray] | None:
        """Residual r of the blurred silhouette, and (dr/dtau)^T r; None where the drape fails.

        Args:
            tau: Parameter vector.

        Returns:
            r and (dr/dtau)^T r, or None.
        """
        losses, gradients = self.problem.evaluate_and_gradient_batch(tau[None], self._misfit)
        self._keep(tau, float(losses[0]))
        return (self._misfit.residual, gradients[0] / 2) if np.isfinite(losses[0]) else None


@dataclass(frozen=True)
class Point:
    """A cloth that was draped: its `residual` r, and the `product` (dr/dz)^T r."""

    z: White
    residual: Residual
    product: White


@dataclass(frozen=True)
class RegularisedFit:
    """The objective J around a homogeneous cloth.

    Attributes:
        incumbent: Keeps the cloth with the lowest loss, whatever J.
        field: Smooth deviations from the homogeneous cloth.
        mean: tau_0.
        weight: Weight of the misfit E.
    """

    incumbent: BlurredIncumbent
    field: StiffnessField
    mean: Float[np.ndarray, " parameters"]
    weight: float = MODES / FLOOR

    def look(self, z: White) -> Point | None:
        """Drapes the cloth at z.

        Args:
            z: White coordinates of the cloth.

        Returns:
            The draped cloth; None where its drape fails.
        """
        seen = self.incumbent.residual_and_product(self.mean + self.field.deviation(z))
        return None if seen is None else Point(z, seen[0], self.field.pulled_back(seen[1]))

    def value(self, point: Point) -> float:
        """The objective J.

        Args:
            point: A cloth that was draped.

        Returns:
            J there.
        """
        return self.weight * float(point.residual @ point.residual) + 0.5 * float(point.z @ point.z)

    def gradient(self, point: Point) -> White:
        """Gradient of J.

        Args:
            point: A cloth that was draped.

        Returns:
            Derivatives of J by z.
        """
        return 2 * self.weight * point.product + point.z


@dataclass(frozen=True)
class Walk:
    """State of the walk.

    Attributes:
        here: Present point.
        lowest: Point with the lowest J.
        adjoints: Information on the Jacobian from the last points.
        step: Number of the next step.
        caution: Share of the radius that is used; smaller after failed drapes.
    """

    here: Point
    lowest: Point
    adjoints: Adjoints
    step: int = 0
    caution: float = 1.0

    @classmethod
    def at(cls, point: Point) -> Walk:
        """A new walk.

        Args:
            point: Its first point.

        Returns:
            The walk before its first step.
        """
        return cls(point, point, Adjoints.of(point.residual, point.product))

    def on(self, fit: RegularisedFit, radius: float) -> Walk:
        """Takes the next step, whether J falls or rises; if the drape fails, returns to the lowest point instead.

        Args:
            fit: Objective of the walk.
            radius: Longest step [standard deviations of the prior].

        Returns:
            The walk after that step.
        """
        gradient, length = fit.gradient(self.here), self.caution * radius
        there = fit.look(self.here.z + damped_step(gradient, self.adjoints, weight=fit.weight, radius=length))
        if there is None:  # the present point may be next to a failing region, so the walk does not go on from there
            return replace(self, here=self.lowest, step=self.step + 1, caution=self.caution / 2)
        lowest = there if fit.value(there) < fit.value(self.lowest) else self.lowest
        adjoints, caution = self.adjoints.and_of(there.residual, there.product), min(1.0, RECOVERY * self.caution)
        return Walk(there, lowest, adjoints, self.step + 1, caution)


@dataclass(frozen=True)
class Heter(Solver):
    """Smooth fields of stiffness around a homogeneous cloth.

    Attributes:
        search: Most drapes for the bending level.
        steps: Number of steps of the walk, a gradient each.
        radius: Longest first step [standard deviations of the prior].
        blur: Width of the blur [px of the release, 1.4 mm; in proportion to the cloth].
        amplitude: Prior standard deviation of the fields [prior standard deviations of a cloth's mean].
        length: Distance at which their correlation has fallen to 0.14 [m].
    """

    search: int = 8
    steps: int = 160
    radius: float = 1.0
    blur: float = 2.0
    amplitude: float = 0.5
    length: float = 0.05
    name: ClassVar[str] = "heter"
    summary: ClassVar[str] = "gradient fit of one stretch table a face and one bending table a hinge, smooth fields"
    reference: ClassVar[str] = "Gong, Mao, Wang, CVPR 2024, Table 1 HETER; Lindgren, Rue, Lindstroem 2011"
    space: ClassVar[str | None] = "heter"
    needs_gradient: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_at_least(self, 0, "search", "steps")
        require_positive(self, "radius", "blur", "amplitude", "length")

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        incumbent, finished = BlurredIncumbent(problem, self.blur), False
        with problem.meter.reserve(1), contextlib.suppress(BudgetExceeded):
            finished = self._fit(problem, incumbent, progress)
        return prediction_at(problem, incumbent.tau, finished=finished)

    def _fit(self, problem: DrapeProblem, incumbent: BlurredIncumbent, progress: Progress) -> bool:
        """Whether the walk came to its end."""
        from cusick_bench.solvers.gradient.smooth_field import StiffnessField

        field = StiffnessField(problem.simulator.mesh, self.amplitude, self.length)
        begun = self._restored(problem, incumbent, field) or self._begun(incumbent, field)
        if begun is None:
            return False
        fit, walk = begun
        while walk.step < self.steps:
            if walk.step % SAVED == 0:
                self._keep(problem, fit, walk)
            progress(f"step {walk.step + 1} of {self.steps}", problem.meter.share)
            walk = walk.on(fit, self.radius * (1 - (1 - LAST) * walk.step / self.steps))
        return True

    def _begun(self, incumbent: BlurredIncumbent, field: StiffnessField) -> tuple[RegularisedFit, Walk] | None:
        """Starts from the best drape of the search for the bending level; None if no level gives a drape."""
        match_bending_level(incumbent, self.search)
        fit, z = RegularisedFit(incumbent, field, incumbent.tau), np.zeros(field.dimension)
        seen = fit.look(z)
        return None if seen is None else (fit, Walk.at(seen))

    def _restored(
        self, problem: DrapeProblem, incumbent: BlurredIncumbent, field: StiffnessField
    ) -> tuple[RegularisedFit, Walk] | None:
        """The state that was saved last; None without one."""
        state = problem.restore()
        if state is None:
            return None
        incumbent.tau, incumbent.loss = state["tau"], float(state["loss"])
        here, lowest = (Point(*(state[f"{name}_{part}"] for part in PARTS)) for name in ("here", "lowest"))
        adjoints = Adjoints(state["residuals"], state["products"])
        walk = Walk(here, lowest, adjoints, int(state["step"]), float(state["caution"]))
        return RegularisedFit(incumbent, field, state["mean"]), walk

    @staticmethod
    def _keep(problem: DrapeProblem, fit: RegularisedFit, walk: Walk) -> None:
        """Saves what the next step begins with."""
        points = {"here": walk.here, "lowest": walk.lowest}
        problem.save(
            **{f"{name}_{part}": getattr(point, part) for name, point in points.items() for part in PARTS},
            tau=fit.incumbent.tau,
            loss=np.array(fit.incumbent.loss),
            mean=fit.mean,
            residuals=walk.adjoints.residuals,
            products=walk.adjoints.products,
            step=np.array(walk.step),
            caution=np.array(walk.caution),
        )
