"""The problem a solver sees: a training silhouette, a simulator, a parameter space, a loss, a running meter.

Find tau such that the drape of the cloth that tau stands for has the training silhouette:

    loss(tau) = d(render(camera(drape(specimen(tau)))), train_image)

In equilibrium mode a drape starts from the best one so far and so follows its branch at the price of a few
Newton steps; `follow=False` starts each one anew.
"""

import hashlib
import math
import time
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.budget import COST, Evaluation, Meter
from cusick_bench.problem.errors import ProblemError
from cusick_bench.problem.journal import Checkpoint, Entry, Journal
from cusick_bench.problem.losses import LOSSES
from cusick_bench.problem.space import ParameterSpace
from cusick_bench.problem.train_mesh import TrainMesh
from cusick_bench.sim.camera import Camera, ParallelCamera
from cusick_bench.sim.drape import Drape, DrapeSimulator
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.silhouette import Method, render

Vector = Float[np.ndarray, " dimension"]


@dataclass(frozen=True)
class Observation:
    """A drape as it is seen: `vertices` (V, 3) [m], `image` (256, 256), `loss` against the training image."""

    vertices: Float[np.ndarray, "vertices 3"]
    image: Float[np.ndarray, "256 256"]
    loss: float


@dataclass
class _Branch:
    """The best drape so far, from which the next one starts."""

    loss: float = math.inf
    vertices: Tensor | None = None

    @property
    def drape(self) -> Drape | None:
        """As the simulator takes it for a warm start."""
        return None if self.vertices is None else Drape(self.vertices, True, 0.0, 0.0, 0)


@dataclass(frozen=True)
class DrapeProblem:
    """Frozen configuration plus a meter, a journal and the branch that is followed.

    Attributes:
        train_image: Silhouette to fit, cloth = 1.
        simulator: Simulator with its mesh and settings.
        space: What the parameter vector means.
        thickness: Of the cloth [m], NaN where unknown.
        camera: How the drape is seen.
        renderer: "coverage" or "soft".
        loss: Name in `LOSSES`.
        initial: How the cloth is laid down, None for the simulator's own way [m].
        follow: In equilibrium mode, start each drape from the best one so far.
        meter: Counts, budget, trace.
        journal: Evaluations kept for resumption.
        checkpoint: Place for a solver's own state.
        train_mesh: The training drape in three dimensions, where its shape is known and the solver asks for it.
    """

    train_image: Float[np.ndarray, "256 256"]
    simulator: DrapeSimulator
    space: ParameterSpace
    thickness: float = math.nan
    camera: Camera = field(default_factory=ParallelCamera)
    renderer: Method = "coverage"
    loss: str = "mse"
    initial: Float[Tensor, "vertices 3"] | None = None
    follow: bool = True
    meter: Meter = field(default_factory=Meter)
    journal: Journal = field(default_factory=Journal)
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    train_mesh: TrainMesh | None = None
    _branch: _Branch = field(default_factory=_Branch, repr=False)

    def __post_init__(self) -> None:
        if self.loss not in LOSSES:
            raise ProblemError(f"unknown loss {self.loss!r}; use one of {', '.join(LOSSES)}")
        if np.shape(self.train_image) != (256, 256):
            raise ProblemError(f"a training image has 256 x 256 pixels, got {np.shape(self.train_image)}")

    @property
    def areal_density(self) -> float:
        """Mass per area of the cloth [kg/m2]."""
        return self.space.prior.areal_density

    @property
    def dimension(self) -> int:
        """Length of the parameter vector."""
        return self.space.dimension

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Box for solvers that need one."""
        return self.space.bounds

    def sample_prior(self, generator: np.random.Generator) -> Vector:
        """A parameter vector drawn from the prior."""
        return self.space.sample_prior(generator)

    def evaluate(self, tau: Vector) -> float:
        """Loss at tau; inf where the drape fails.

        Raises:
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: tau has a wrong length or holds NaN or infinity.
        """
        return self._metered("loss", tau).evaluation.loss

    def evaluate_and_gradient(self, tau: Vector) -> tuple[float, Vector]:
        """Loss and its gradient at tau; (inf, 0) where the drape fails.

        Raises:
            BudgetExceeded: The budget does not allow for another drape and its adjoint.
            ProblemError: tau is not a finite vector, or the space has no gradients.
        """
        if not self.space.differentiable:
            raise ProblemError(f"the space {self.space.name!r} has no gradients; use a gradient-free solver")
        entry = self._metered("gradient", tau)
        if entry.evaluation.failure:
            return math.inf, np.zeros(self.dimension)
        return entry.evaluation.loss, entry.arrays["gradient"]

    def observe(self, tau: Vector) -> Observation:
        """The drape at tau and how it is seen; costs one forward-equivalent.

        Raises:
            DrapeDiverged: The drape fails.
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: tau has a wrong length or holds NaN or infinity.
        """
        entry = self._metered("drape", tau)
        if entry.evaluation.failure:
            raise DrapeDiverged(entry.evaluation.failure)
        vertices = entry.arrays["vertices"]
        with torch.no_grad():
            image = self.render(torch.as_tensor(vertices)).numpy()
        return Observation(vertices, image, entry.evaluation.loss)

    def image(self, tau: Vector) -> Float[np.ndarray, "256 256"]:
        """Silhouette of the drape at tau (see `observe`)."""
        return self.observe(tau).image

    def drape(self, tau: Vector) -> Float[np.ndarray, "vertices 3"]:
        """Vertices of the drape at tau [m] (see `observe`)."""
        return self.observe(tau).vertices

    def render(self, vertices: Float[Tensor, "vertices 3"]) -> Float[Tensor, "256 256"]:
        """Silhouette of given vertices, as the problem's camera and renderer see them."""
        return render(vertices, self.simulator.mesh.faces, self.camera, method=self.renderer)

    def save(self, **arrays: np.ndarray) -> None:
        """Saves a solver's own state, from which `restore` goes on after a kill."""
        branch = {} if self._branch.vertices is None else {"_vertices": self._branch.vertices.numpy()}
        counts = {"_evaluations": np.array(len(self.meter.trace)), "_loss": np.array(self._branch.loss)}
        self.checkpoint.save(**arrays, **counts, **branch)

    def restore(self) -> dict[str, np.ndarray] | None:
        """State saved last, or None; meter, trace and branch are set to what they were at that moment."""
        state = self.checkpoint.load()
        evaluations = 0 if state is None else int(state.pop("_evaluations"))
        for entry in self.journal.rewind(evaluations):
            self.meter.replay(entry.evaluation)
        if state is not None:
            self._branch.loss = float(state.pop("_loss"))
            vertices = state.pop("_vertices", None)
            self._branch.vertices = None if vertices is None else torch.as_tensor(vertices)
        return state

    def _metered(self, kind: str, tau: Vector) -> Entry:
        tau = self._checked(tau)
        digest = hashlib.sha256(tau.tobytes()).hexdigest()[:16]
        entry = self.journal.next(kind, digest)
        if entry is not None:
            self.meter.replay(entry.evaluation)
        else:
            self.meter.admit(kind)
            entry = self._computed(kind, digest, tau)
            self.journal.append(entry)
            self.meter.record(entry.evaluation)
        if entry.evaluation.loss < self._branch.loss and self._follows:
            self._branch.loss = entry.evaluation.loss
            self._branch.vertices = torch.as_tensor(entry.arrays["vertices"])
        return entry

    def _checked(self, tau: Vector) -> Vector:
        tau = np.ascontiguousarray(tau, dtype=np.float64)
        if tau.shape != (self.dimension,):
            raise ProblemError(f"space {self.space.name!r} takes {self.dimension} numbers, got shape {tau.shape}")
        bad = np.flatnonzero(~np.isfinite(tau))
        if len(bad):
            raise ProblemError(f"parameters must be finite, got {tau[bad[0]]} at index {bad[0]} ({len(bad)} in all)")
        return tau

    @property
    def _follows(self) -> bool:
        return self.follow and self.simulator.settings.mode == "equilibrium"

    def _computed(self, kind: str, digest: str, tau: Vector) -> Entry:
        start = time.perf_counter()
        loss, failure, simulated = math.inf, "", 0.0
        arrays: dict[str, np.ndarray] = {}
        try:
            loss, drape, arrays = self._simulate(tau, gradient=kind == "gradient")
            simulated = 0.0 if self._static else drape.iterations * self.simulator.settings.step_seconds
        except DrapeDiverged as error:
            failure = str(error)
        if kind != "drape" and not (self._follows and loss < self._branch.loss):
            arrays.pop("vertices", None)
        evaluation = Evaluation(
            kind=kind,
            digest=digest,
            loss=loss,
            best_loss=min(loss, self.meter.best_loss),
            forward_equivalents=self.meter.forward_equivalents + COST[kind],
            wall_seconds=self.meter.wall_seconds,
            seconds=time.perf_counter() - start,
            simulated_seconds=simulated,
            failure=failure,
        )
        return Entry(evaluation, arrays)

    @property
    def _static(self) -> bool:
        return self.simulator.settings.mode == "equilibrium"

    def _simulate(self, tau: Vector, *, gradient: bool) -> tuple[float, Drape, dict[str, np.ndarray]]:
        """Loss, drape, and the arrays worth keeping of one drape (and its adjoint)."""
        parameters = torch.as_tensor(tau).clone().requires_grad_(gradient)
        with torch.set_grad_enabled(gradient):
            specimen = self.space.specimen(parameters)
            drape = self.simulator.drape(
                specimen.material,
                initial=self.initial if specimen.initial is None else specimen.initial,
                rest_angle=specimen.rest_angle,
                warm=self._branch.drape if self._follows else None,
            )
            image = self.render(drape.vertices)
            loss = LOSSES[self.loss](image, torch.as_tensor(self.train_image))
        arrays = {"vertices": drape.vertices.detach().numpy()}
        if gradient:
            (slope,) = torch.autograd.grad(loss, parameters)
            arrays["gradient"] = slope.numpy()
        if not all(np.isfinite(array).all() for array in (loss.item(), *arrays.values())):
            raise DrapeDiverged("the drape, its loss or its gradient is not finite")
        return loss.item(), drape, arrays
