"""Base class of solvers: a solver is data plus one method, and the base class checks its input and output.

A new solver is one file with a frozen dataclass, whose fields are its options, and one line in `registry.py`
(or an entry point in the group `cusick_bench.solvers` of somebody else's package).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float, Int

from cusick_bench.files.json_text import json_text
from cusick_bench.sim.engine.pace import PaceName
from cusick_bench.sim.errors import CusickError
from cusick_bench.solvers.process_settings import settings_of_work

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


Images = Float[np.ndarray, "images size size"]

# Called with what a solver is doing and the share of it that is done, in [0, 1].
Progress = Callable[[str, float], None]


class SolverError(CusickError, ValueError):
    """A solver is unknown, wrongly set up, or has answered with something that is no prediction."""


def silent(message: str, fraction: float) -> None:
    """Ignores the progress of a solver.

    Args:
        message: What is being done.
        fraction: Share of it that is done.
    """


@dataclass(frozen=True)
class Prediction:
    """A solver's answer.

    Attributes:
        train_image: Its fit of the training silhouette.
        draws: Silhouettes it offers for samples it has not seen; a list of images or a tensor is kept as an array.
        tau: Fitted parameters.
        vertices: Drape behind `train_image` [m].
        faces: Triangles of `vertices` and `draw_vertices`.
        draw_vertices: Drapes behind `draws` [m].
        draw_turned: Which draws lie with the other face up than the training sample. Each draw predicts the unseen
            samples with the same face up, and both faces have the same number of draws. None where all draws predict
            all samples.
        paired: Whether draw i was made for held-out image i (oracles), instead of all draws for all images.
        finished: Whether the solver ended by itself rather than by its budget.
        notes: Further findings, written to the result's JSON.
        posterior: Arrays that define a distribution over parameters, from which `Solver.redraw` makes each draw again.
    """

    train_image: Float[np.ndarray, "size size"]
    draws: Images
    tau: Float[np.ndarray, " dimension"] | None = None
    vertices: Float[np.ndarray, "vertices 3"] | None = None
    faces: Int[np.ndarray, "faces 3"] | None = None
    draw_vertices: Float[np.ndarray, "images vertices 3"] | None = None
    draw_turned: Bool[np.ndarray, " images"] | None = None
    paired: bool = False
    finished: bool = True
    notes: dict[str, Any] = field(default_factory=dict)
    posterior: dict[str, np.ndarray] | None = None

    def __post_init__(self) -> None:
        for name in ("train_image", "draws"):
            object.__setattr__(self, name, _images(name, getattr(self, name)))
        size = np.shape(self.train_image)
        if len(size) != 2 or size[0] != size[1]:
            raise SolverError(f"train_image must be a square image, got {size}")
        if np.ndim(self.draws) != 3 or np.shape(self.draws)[1:] != size or len(self.draws) == 0:
            raise SolverError(
                f"draws must be at least one image of {size[0]} x {size[1]} pixels, as train_image, "
                f"got {np.shape(self.draws)}"
            )
        if self.draw_turned is not None:
            turned = int(np.count_nonzero(self.draw_turned))
            if self.paired or len(self.draw_turned) != len(self.draws) or 2 * turned != len(self.draws):
                raise SolverError(
                    f"draws that are not paired must be as many of one face as of the other, got {len(self.draws)} "
                    f"draws, {turned} of {len(self.draw_turned)} turned over"
                )
        if self.draw_vertices is not None and len(self.draw_vertices) != len(self.draws):
            raise SolverError(
                f"draw_vertices must hold a drape for each of {len(self.draws)} draws, got {len(self.draw_vertices)}"
            )
        for name, values in (self.posterior or {}).items():
            if np.asarray(values).dtype.hasobject:  # would be pickled, and files are never unpickled
                raise SolverError(f"posterior[{name!r}] must be an array of numbers or text, got one of objects")
        try:
            json_text(self.notes)
        except (TypeError, ValueError, RecursionError) as error:
            raise SolverError(f"notes must hold numbers, arrays and text, which JSON can keep ({error})") from error
        for name in ("train_image", "draws"):
            image = getattr(self, name)
            if np.asarray(image).dtype.kind in "iu":  # bytes are read as 0 to 255 by every metric
                raise SolverError(f"{name} must hold floats in [0, 1] (cloth = 1), got {np.asarray(image).dtype}")
            if not (np.isfinite(image).all() and image.min() >= -1e-9 and image.max() <= 1 + 1e-9):
                raise SolverError(f"{name} must lie in [0, 1] (cloth = 1), got {image.min()} .. {image.max()}")


def _images(name: str, given: Any) -> np.ndarray:
    """Images of an answer as one array: of a list of images, or of a tensor."""
    if isinstance(given, np.ndarray):
        return given
    try:
        return given.detach().cpu().numpy() if hasattr(given, "detach") else np.asarray(given)
    except (ValueError, RuntimeError) as error:  # of several sizes, or tensors that carry gradients
        raise SolverError(f"{name} must be one array of images ({error}); give images of one size") from error


KINDS = ("solver", "null", "oracle")
"""Kinds of solvers: one that simulates, one without physics, one that has seen the held-out images."""


@dataclass(frozen=True)
class Solver(ABC):
    """A method that answers a drape problem. Fields of subclasses are its options."""

    name: ClassVar[str]
    version: ClassVar[int] = 1  # raised when its answers change; see runner/numerics.py
    kind: ClassVar[str] = "solver"  # one of `KINDS`
    reference: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    space: ClassVar[str | None] = None  # the parameter space that the method is about, whatever the run asks for
    needs_gradient: ClassVar[bool] = False
    most_numbers: ClassVar[int | None] = None  # longest tau that it can search, None for any
    learns_both_faces: ClassVar[bool] = False  # whether it also learns from training samples with the other face up
    needs_mesh: ClassVar[bool] = False  # whether it fits the training drape's shape in three dimensions

    def samples_used(self, given: int) -> int:
        """How many of a cloth's training samples it learns from.

        Args:
            given: Training samples that there are, at least 1.

        Returns:
            1 unless the solver says otherwise: the sample whose silhouette is fitted.
        """
        return min(1, given)

    @property
    def pace_of_draws(self) -> PaceName:
        """Pace of the drops of its draws; see `DrapeProblem.at_pace`."""
        return "steady"

    @property
    def drapes_of_prediction(self) -> int:
        """Number of drapes of its prediction, outside the budget; for each face if it learns from both."""
        return 0

    @property
    def draws_asked_for(self) -> int:
        """Number of draws, for each face, that `predictive_draws` makes up for where some fail; 0 by another rule."""
        return 0

    @property
    def drapes_of_inference(self) -> int | None:
        """Drapes after which a larger budget changes nothing of its posterior any more; None where it always may."""
        return None

    @property
    def drapes_of_design(self) -> int:
        """Number of drapes before its first model, whose libraries a warm-up imports; 0 of one without a model."""
        return 0

    @property
    def remark(self) -> str:
        """What to know of these options before the solver is run; empty where there is nothing to say."""
        return ""

    @property
    def takes_gradients(self) -> bool:
        """Whether it asks for gradients, with these options."""
        return self.needs_gradient

    @property
    def options(self) -> dict[str, Any]:
        """Everything that decides the answer, apart from the problem."""
        return asdict(self)

    def solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress = silent) -> Prediction:
        """Answers the problem within its budget; the answer does not depend on the number of threads.

        What the solver prints goes to standard error.

        Args:
            problem: The problem, which counts what is spent.
            generator: Source of all randomness.
            progress: Called with what is being done and the share that is done.

        Returns:
            Its answer: fit of the training image, forecasts of unseen samples, parameters.

        Raises:
            SolverError: The solver cannot be used on this problem, or its answer does not fit it.
        """
        if self.needs_gradient and not problem.space.differentiable:
            raise SolverError(
                f"{self.name} needs gradients, and the space {problem.space.name!r} has none; "
                "use a gradient-free solver such as nlopt:LN_BOBYQA"
            )
        if self.takes_gradients and problem.scene is not None and problem.scene.stateful:
            raise SolverError(
                f"{self.name} needs gradients, and drapes with effect {problem.scene.stateful} have none, since it has "
                "internal variables; use a gradient-free solver such as nlopt:LN_BOBYQA, or bdp-field,refinement=0"
            )
        if self.most_numbers is not None and problem.dimension > self.most_numbers:
            raise SolverError(
                f"{self.name} keeps tables as large as the square of the parameters' number, so it takes at most "
                f"{self.most_numbers} of them, and the space {problem.space.name!r} has {problem.dimension} here; use "
                "another space or solver"
            )
        if self.needs_mesh and problem.train_mesh is None:
            raise SolverError(
                f"{self.name} fits the training drape's three-dimensional shape, and there is no mesh of it; give data "
                "with a folder `meshes` beside `silhouettes`, or use a solver that fits silhouettes"
            )
        if self.space not in (None, problem.space.name):
            raise SolverError(
                f"{self.name} works in the space {self.space!r}, and the problem is posed in {problem.space.name!r}; "
                f"pose it with space={self.space!r}"
            )
        faces = 2 if self.learns_both_faces and len(problem.other_face_images) else 1
        problem.meter.draws = faces * self.drapes_of_prediction
        with settings_of_work(), problem.meter.running():
            answer = self._solve(problem, generator, progress)
        if not isinstance(answer, Prediction):
            raise SolverError(f"{self.name} must answer with a Prediction, got {answer!r:.60}")
        if answer.tau is not None and np.shape(answer.tau) != (problem.dimension,):
            raise SolverError(
                f"{self.name} must answer with a tau of {problem.dimension} numbers, got shape {np.shape(answer.tau)}"
            )
        if np.shape(answer.train_image) != np.shape(problem.train_image):
            size = problem.protocol.image_size_px
            raise SolverError(
                f"{self.name} must answer with images of {size} x {size} pixels, as the problem's protocol says, "
                f"got {np.shape(answer.train_image)}"
            )
        if answer.tau is not None and (tau := np.asarray(answer.tau, dtype=np.float64)) is not answer.tau:
            return replace(answer, tau=tau)  # of a list, or of shorter numbers
        return answer

    def redraw(
        self, problem: DrapeProblem, posterior: dict[str, np.ndarray], index: int
    ) -> Float[np.ndarray, " dimension"]:
        """Parameters of one draw from the stored posterior; used to verify a stored prediction.

        The interval of the stiffness that was found is over draws of the numbers from 0 on, whichever were predicted.

        Args:
            problem: The problem that was answered.
            posterior: From the prediction.
            index: Number of the draw, any from 0 on; `posterior["draws"]` has those of the predicted draws.

        Returns:
            Parameter vector of that draw.

        Raises:
            SolverError: The solver defines none: it learns no distribution.
        """
        raise SolverError(
            f"{self.name} defines no `redraw`, which draws cloths from its posterior; define it (docs/add-solver.md), "
            "or answer without a posterior"
        )

    @abstractmethod
    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        """Answers the problem; BudgetExceeded must not leave it."""


def require_positive(solver: Solver, *names: str) -> None:
    """Refuses options that are no positive numbers.

    Args:
        solver: Solver that has these options.
        names: Names of the options.

    Raises:
        SolverError: One of them is not positive, or not finite.
    """
    for name in names:
        value = getattr(solver, name)
        if not 0 < value < math.inf:
            raise SolverError(
                f"{solver.name}'s {name} must be > 0 and finite, got {value}; leave it out for the usual one"
            )


def require_at_least(solver: Solver, least: int, *names: str) -> None:
    """Refuses options that are too small.

    Args:
        solver: Solver that has these options.
        least: Their smallest value.
        names: Names of the options.

    Raises:
        SolverError: One of them is smaller.
    """
    for name in names:
        value = getattr(solver, name)
        if not value >= least:
            raise SolverError(f"{solver.name}'s {name} must be >= {least}, got {value}; leave it out for the usual one")


@dataclass(frozen=True)
class HeldOut:
    """Data that an oracle sees.

    Attributes:
        images: The held-out images.
        others: For each of them, images of the cloth's other samples with the same face up, training ones included; of
            either face where no other sample shows that one.
        repeats: For each of them, other captures of the same drape.
    """

    images: Images
    others: tuple[Images, ...]
    repeats: tuple[Images, ...]


@dataclass(frozen=True)
class Oracle(Solver):
    """A reference row that looks at the held-out images, and is marked so."""

    kind: ClassVar[str] = "oracle"
    heldout: HeldOut | None = field(default=None, repr=False, compare=False, kw_only=True)

    @property
    def options(self) -> dict[str, Any]:
        return {}

    def samples_used(self, given: int) -> int:
        """All: the other samples of a held-out one are those that train, too."""
        return given

    def revealing(self, heldout: HeldOut) -> Oracle:
        """The oracle with the held-out images.

        Args:
            heldout: The images that it may look at.

        Returns:
            An oracle that knows them.
        """
        return replace(self, heldout=heldout)

    @property
    def seen(self) -> HeldOut:
        """The held-out images.

        Raises:
            SolverError: They were not revealed.
        """
        if self.heldout is None or len(self.heldout.images) == 0:
            raise SolverError(f"{self.name} is an oracle and needs held-out images, but the split has none")
        return self.heldout


def prediction_at(problem: DrapeProblem, tau: np.ndarray, *, finished: bool) -> Prediction:
    """The drape at tau as fit of the training image and forecast of unseen samples; costs one drape.

    Args:
        problem: The problem that was answered.
        tau: Fitted parameters.
        finished: Whether the solver ended by itself rather than by its budget.

    Returns:
        An answer whose only draw is the fitted drape.
    """
    seen = problem.observe(tau)
    return Prediction(
        train_image=seen.image,
        draws=seen.image[None],
        tau=tau,
        vertices=seen.vertices,
        faces=problem.simulator.mesh.faces,
        draw_vertices=seen.vertices[None],
        finished=finished,
    )
