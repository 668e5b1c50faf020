"""The problem that a solver sees: a training silhouette, a simulator, a parameter space, a loss and a meter.

Find parameters tau such that the drape of their cloth has the training silhouette:

    loss(tau) = d(render(camera(drape(specimen(tau)))), train_image)

Sizes, scale and camera are those of the data's `protocol`.

In mode `equilibrium` a drape starts from the best one so far. So it follows that branch of equilibria, and takes only a
few Newton steps; with `follow=False` each drape starts from the cloth as laid down, and so do the draws of a
prediction, which are of other specimens.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.problem.checks import check_images, check_simulator, checked_rows, one_row
from cusick_bench.problem.errors import ProblemError
from cusick_bench.problem.followed_branch import FollowedBranch
from cusick_bench.problem.losses import LOSSES
from cusick_bench.problem.metering.bookkeeping import Simulated, digest_of, metered
from cusick_bench.problem.metering.budget import Meter
from cusick_bench.problem.metering.journal import Checkpoint, Entry, Journal
from cusick_bench.problem.scene import Scene
from cusick_bench.problem.space import ParameterSpace
from cusick_bench.problem.train_mesh import TrainMesh
from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
from cusick_bench.sim.engine.pace import PaceName, pace_of
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.render.camera import Camera
from cusick_bench.sim.render.silhouette import Method, render

_log = logging.getLogger(__name__)

Vector = Float[np.ndarray, " dimension"]
Vectors = Float[np.ndarray, "members dimension"]
Measure = Callable[[dict[int, Tensor]], Tensor]
"""From the silhouettes of a batch, by member and without those whose drape failed, to a number."""
_KEPT = ("drape", "draw")  # kinds whose vertices are asked for


@dataclass(frozen=True)
class Observation:
    """A drape as it is seen: `vertices` (V, 3) [m], its `image`, and the image's `loss` against the training image."""

    vertices: Float[np.ndarray, "vertices 3"]
    image: Float[np.ndarray, "size size"]
    loss: float


@dataclass(frozen=True)
class DrapeProblem:
    """Frozen configuration plus a meter, a journal and the branch that is followed.

    Attributes:
        train_image: Silhouette to fit, cloth = 1.
        simulator: Simulator with its mesh and settings.
        space: What the parameter vector means.
        thickness: Thickness of the cloth [m], NaN where unknown.
        protocol: Nominal values of the experiment; the simulator and the space have been made for its sizes.
        camera: How the drape is seen, None for the protocol's camera.
        renderer: "coverage" or "soft".
        loss: Name in `LOSSES`.
        initial: How the cloth is laid down, None for the simulator's own way [m].
        follow: Whether each drape starts from the best one so far, in equilibrium mode.
        meter: Counts, budget, trace.
        journal: Evaluations kept for resumption.
        checkpoint: Place for a solver's own state.
        further_images: Silhouettes of other training samples of the same cloth and face, for methods that learn from
            several; the loss knows nothing of them.
        other_face_images: Silhouettes of training samples that lie the other way up, for methods that learn from both
            faces; the loss knows nothing of them either.
        train_mesh: The training drape in three dimensions, where its shape is known and the solver asks for it.
        scene: What the base model leaves out, if anything; the simulator is that of its mesh and settings.

    Raises:
        ProblemError: An unknown loss, training images of another size or range, or a simulator whose plate, gravity or
            law is not that of protocol, space and prior.
    """

    train_image: Float[np.ndarray, "size size"]
    simulator: DrapeSimulator
    space: ParameterSpace
    thickness: float = math.nan
    protocol: Protocol = RELEASE
    camera: Camera | None = None
    renderer: Method = "coverage"
    loss: str = "mse"
    initial: Float[Tensor, "vertices 3"] | None = None
    follow: bool = True
    meter: Meter = field(default_factory=Meter)
    journal: Journal = field(default_factory=Journal)
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    further_images: tuple[Float[np.ndarray, "size size"], ...] = ()
    other_face_images: tuple[Float[np.ndarray, "size size"], ...] = ()
    train_mesh: TrainMesh | None = None
    scene: Scene | None = None
    _branch: FollowedBranch = field(default_factory=FollowedBranch, repr=False)

    def __post_init__(self) -> None:
        if self.loss not in LOSSES:
            raise ProblemError(f"unknown loss {self.loss!r}; use one of {', '.join(LOSSES)}")
        check_images((*self.train_images, *self.other_face_images), self.protocol)
        nominal = None if self.scene is not None else self.protocol  # a cause may change plate and gravity
        check_simulator(self.simulator.mesh, self.simulator.settings, self.space, nominal)

    @property
    def train_images(self) -> tuple[Float[np.ndarray, "size size"], ...]:
        """Silhouettes of all training samples of the fitted face, the one that is fitted first."""
        return (self.train_image, *self.further_images)

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
        """Draws a parameter vector from the prior.

        Args:
            generator: Source of randomness.

        Returns:
            Parameter vector in the unconstrained, scaled space.
        """
        return self.space.sample_prior(generator)

    def evaluate(self, tau: Vector) -> float:
        """Drapes a cloth and compares it with the training silhouette.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            The loss; inf where the drape fails.

        Raises:
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: tau has a wrong length or holds NaN or infinity.
        """
        return float(self.evaluate_batch(one_row(tau, self.space))[0])

    def evaluate_as_laid(self, tau: Vector) -> float:
        """As `evaluate`, but the drape starts from the cloth as laid down, whatever was followed before.

        For a specimen with folds of its own; later drapes start from it if it is the best one so far.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            The loss; inf where the drape fails.

        Raises:
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: tau has a wrong length or holds NaN or infinity.
        """
        begun = FollowedBranch(self._branch.loss)
        loss = replace(self, _branch=begun).evaluate(tau)
        if begun.vertices is not None:
            self._branch.loss, self._branch.vertices = begun.loss, begun.vertices
        return loss

    def evaluate_and_gradient(self, tau: Vector) -> tuple[float, Vector]:
        """As `evaluate`, with the gradient of the loss by the adjoint.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            Loss and gradient with respect to tau; (inf, 0) where the drape fails.

        Raises:
            BudgetExceeded: The budget does not allow for another drape and its adjoint.
            ProblemError: tau is not a finite vector, or the space has no gradients.
        """
        losses, gradients = self.evaluate_and_gradient_batch(one_row(tau, self.space))
        return float(losses[0]), gradients[0]

    def observe(self, tau: Vector) -> Observation:
        """Drapes a cloth and looks at it; costs one forward-equivalent.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            The drape and how it is seen.

        Raises:
            DrapeDiverged: The drape fails.
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: tau has a wrong length or holds NaN or infinity.
        """
        (entry,) = self._metered("drape", one_row(tau, self.space))
        if entry.evaluation.failure:
            raise DrapeDiverged(entry.evaluation.failure)
        return self._seen(entry)

    def evaluate_batch(self, taus: Vectors) -> Float[np.ndarray, " members"]:
        """Losses of several vectors, draped together, which is faster than one by one; raises as `evaluate`.

        Args:
            taus: Parameter vectors, one a row.

        Returns:
            One loss a vector.
        """
        return np.array([entry.evaluation.loss for entry in self._metered("loss", taus)])

    def evaluate_and_gradient_batch(
        self, taus: Vectors, measure: Measure | None = None
    ) -> tuple[Float[np.ndarray, " members"], Vectors]:
        """Losses and gradients of several vectors, draped together; raises as `evaluate_and_gradient`.

        Args:
            taus: Parameter vectors.
            measure: What to take the gradients of, instead of the sum of the losses.

        Returns:
            Losses, and gradients, one row a vector.
        """
        self._check_differentiable()
        entries = self._metered("gradient", taus, measure)
        losses = np.array([entry.evaluation.loss for entry in entries])
        nothing = np.zeros(self.dimension)
        gradients = [entry.arrays.get("gradient", nothing) for entry in entries]
        return losses, np.reshape(gradients, (len(entries), self.dimension))

    def observe_batch(self, taus: Vectors) -> list[Observation | None]:
        """Drapes cloths together and looks at them, as many as the budget allows for; one forward-equivalent each.

        Args:
            taus: Parameter vectors, one a row.

        Returns:
            One observation for each vector that was affordable, the first ones; None where the drape fails. A run that
            goes on gets those that it had made before it was stopped; whether there is time for the others is asked
            with them.

        Raises:
            BudgetExceeded: The budget does not allow for another drape.
            ProblemError: A vector has a wrong length or holds NaN or infinity.
        """
        taus, replaying = checked_rows(taus, self.space), self.journal.replaying
        most = self.journal.repeats("drape", [digest_of(tau) for tau in taus]) if replaying else len(taus)
        affordable = self.meter.affordable("drape", most, replayed=True if replaying else None)
        return self._observed("drape", taus[: max(1, affordable)])

    def draw_batch(self, taus: Vectors) -> list[Observation | None]:
        """Drapes vectors that were drawn from what a solver has learned, each as laid down; they cost no budget.

        Args:
            taus: Parameter vectors, one a row.

        Returns:
            One observation a vector; None where the drape fails.

        Raises:
            ProblemError: A vector has a wrong length or holds NaN or infinity.
        """
        return replace(self, follow=False)._observed("draw", taus)

    def at_pace(self, pace: PaceName) -> "DrapeProblem":
        """The same problem with another pace of its drops; it shares meter, journal and branch.

        Args:
            pace: `steady`: as they are. `brisk`: drops of fewer steps, eight cloths in lockstep, without gradients,
                where the settings and the device know them; for drapes whose distribution counts.

        Returns:
            The problem.
        """
        s, stateful = self.simulator.settings, self.scene is not None and bool(self.scene.stateful)
        if pace == "steady" or s.mode != "drop" or self.simulator.engine is not None or stateful:
            return self
        return replace(self, simulator=DrapeSimulator(self.simulator.mesh, replace(s, pace=pace, backend="lockstep")))

    def image(self, tau: Vector) -> Float[np.ndarray, "size size"]:
        """Silhouette of the drape at tau; costs and raises as `observe`.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            Coverage in [0, 1], cloth = 1.
        """
        return self.observe(tau).image

    def drape(self, tau: Vector) -> Float[np.ndarray, "vertices 3"]:
        """Vertices of the drape at tau [m] (see `observe`)."""
        return self.observe(tau).vertices

    def simulate(
        self, taus: Float[Tensor, "members dimension"], warm: Float[Tensor, "members vertices 3"] | None = None
    ) -> DrapeBatch:
        """Drapes with gradients to the vectors, neither metered nor kept.

        Args:
            taus: Parameter vectors.
            warm: Positions from which equilibria are sought [m]; by default from the branch that is followed.

        Returns:
            The drapes; brisk ones have no gradients, and are the same to the bit in any batch.
        """
        specimens = [self.space.specimen(tau) for tau in taus]
        materials = [one.material for one in specimens]
        initial = _stacked([self.initial if one.initial is None else one.initial for one in specimens])
        rest_angle = _stacked([one.rest_angle for one in specimens])
        warm = self._branch.start(len(taus)) if warm is None and self._follows else warm
        if self.scene is None:
            return self.simulator.drape_batch(materials, initial=initial, rest_angle=rest_angle, warm=warm)
        laid, flat = torch.from_numpy(self.simulator.laid_down()), self.simulator.rest_angles()
        return self.scene.drape(
            self.simulator,
            materials,
            laid.expand(len(taus), -1, -1) if initial is None else initial,
            flat.expand(len(taus), -1) if rest_angle is None else rest_angle,
            warm,
        )

    def render(self, vertices: Float[Tensor, "vertices 3"]) -> Float[Tensor, "size size"]:
        """Silhouette of given vertices, as the problem's camera and renderer see them.

        Args:
            vertices: Positions [m].

        Returns:
            Coverage in [0, 1], cloth = 1.
        """
        if self.scene is not None:
            vertices = self.scene.seen(vertices)
        camera, size = self.camera or camera_of(self.protocol), self.protocol.image_size_px
        return render(vertices, self.simulator.mesh.faces, camera, method=self.renderer, size=size)

    def save(self, **arrays: np.ndarray) -> None:
        """Saves a solver's own state, from which `restore` goes on after a kill."""
        branch = {} if self._branch.vertices is None else {"_vertices": self._branch.vertices.numpy()}
        evaluations = len(self.meter.trace)
        counts = {"_evaluations": np.array(evaluations), "_loss": np.array(self._branch.loss)}
        counts["_link"] = np.array(self.journal.link(evaluations))
        self.checkpoint.save(**arrays, **counts, **branch)

    def restore(self) -> dict[str, np.ndarray] | None:
        """State saved last, or None; meter, trace and branch are set to what they were at that moment.

        A state that was saved after other evaluations than the journal holds is not taken up: the solver begins anew,
        and so does its budget.
        """
        state = self.checkpoint.load()
        evaluations = 0 if state is None else int(state.pop("_evaluations"))
        if state is not None and str(state.pop("_link")) != self.journal.link(evaluations):
            _log.warning(
                "%s was saved after %d evaluations, which trace.jsonl does not hold; the cell is run again from its "
                "start",
                f"{self.checkpoint.folder}/state.npz",
                evaluations,
            )
            state, evaluations = None, 0
        for entry in self.journal.rewind(evaluations):
            self.meter.replay(entry.evaluation)
        if state is not None:
            self._branch.loss = float(state.pop("_loss"))
            vertices = state.pop("_vertices", None)
            self._branch.vertices = None if vertices is None else torch.as_tensor(vertices)
        return state

    def _check_differentiable(self) -> None:
        if not self.space.differentiable:
            raise ProblemError(f"the space {self.space.name!r} has no gradients; use a gradient-free solver")
        if self.scene is not None and self.scene.stateful:
            raise ProblemError(
                f"effect {self.scene.stateful} has internal variables, so drapes have no gradients; "
                "use a gradient-free solver, such as cmaes or nlopt:LN_BOBYQA"
            )

    def _seen(self, entry: Entry) -> Observation:
        vertices = entry.arrays["vertices"]
        with torch.no_grad():
            image = self.render(torch.as_tensor(vertices)).numpy()
        return Observation(vertices, image, entry.evaluation.loss)

    def _observed(self, kind: str, taus: Vectors) -> list[Observation | None]:
        entries = self._metered(kind, taus)
        return [None if entry.evaluation.failure else self._seen(entry) for entry in entries]

    def _metered(self, kind: str, taus: Vectors, measure: Measure | None = None) -> list[Entry]:
        entries = metered(
            kind,
            checked_rows(taus, self.space),
            lambda some: self._simulated(some, kind == "gradient", measure),
            self.meter,
            self.journal,
            keeps_vertices=lambda loss: kind in _KEPT or (self._follows and loss < self._branch.loss),
            all_at_once=measure is not None,
        )
        if self._follows:
            for entry in entries:
                self._branch.keep(entry)
        return entries

    @property
    def _follows(self) -> bool:
        return self.follow and self.simulator.settings.mode == "equilibrium"

    def _simulated(self, taus: Vectors, gradient: bool, measure: Measure | None) -> list[Simulated]:
        """Drapes and their adjoints; vectors that stand for no cloth fail, and spoil no other."""
        try:
            return self._draped(taus, gradient, measure)
        except SimulationError:
            found = (self.space.no_specimen(torch.as_tensor(tau)) for tau in taus)
            lost = {member: f"the parameters stand for no cloth: {why}" for member, why in enumerate(found) if why}
            if not lost:
                raise
        kept = [member for member in range(len(taus)) if member not in lost]
        results = [Simulated(failure=lost.get(member, "")) for member in range(len(taus))]
        of_kept = measure and (lambda images: measure({kept[place]: image for place, image in images.items()}))
        for member, one in zip(kept, self._draped(taus[kept], gradient, of_kept) if kept else [], strict=True):
            results[member] = one
        return results

    def _draped(self, taus: Vectors, gradient: bool, measure: Measure | None) -> list[Simulated]:
        """Drapes (and their adjoints), measured against the training image where the simulator's device leaves them."""
        parameters = torch.as_tensor(taus).clone().requires_grad_(gradient)
        target = torch.from_numpy(np.array(self.train_image))  # a copy: torch knows no mirrored arrays
        with torch.set_grad_enabled(gradient):
            batch = self.simulate(parameters)
            alive = [member for member, failure in enumerate(batch.failures) if failure is None]
            images = {member: self.render(batch.vertices[member]) for member in alive}
            measure_loss = LOSSES[self.loss]
            losses = {m: measure_loss(image, target.to(image), self.protocol) for m, image in images.items()}
        slopes = np.zeros_like(taus)
        if gradient and alive:
            total = torch.stack(list(losses.values())).sum() if measure is None else measure(images)
            slopes = torch.autograd.grad(total, parameters)[0].cpu().numpy()
        s = self.simulator.settings
        fall = 0.0 if s.mode == "equilibrium" else pace_of(s.pace, s.steps).steps * s.step_seconds
        results = [Simulated(failure=failure or "") for failure in batch.failures]
        for member in alive:
            arrays = {"vertices": batch.vertices[member].detach().cpu().numpy()}
            if gradient:
                arrays["gradient"] = slopes[member]
            loss = losses[member].item()
            if all(np.isfinite(array).all() for array in (loss, *arrays.values())):
                jumped = self._follows and self._branch.left_by(self.simulator.mesh, arrays["vertices"])
                results[member] = Simulated(loss, "", arrays, fall, jumped)
            else:
                results[member] = Simulated(failure="the drape, its loss or its gradient is not finite")
        return results


def _stacked(tensors: list[Tensor | None]) -> Tensor | None:
    """All of them along a new axis, or None where none is given."""
    given = [tensor for tensor in tensors if tensor is not None]
    return torch.stack(given) if given else None
