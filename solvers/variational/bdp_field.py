"""A Bayesian fit whose draws move folds: the posterior of a cloth with smooth random fields, by synthetic likelihood.

The parameters theta of the cloth (39 numbers of stiffness; traits; amplitude and correlation length of the fields of
stiffness, laid shape and rest shape) have the prior N(0, I). The weights w of the fields belong to a specimen: the next
specimen has new ones, and those of the training specimen, whose fold phases tell nothing about the next one, are
integrated out. So the cloth is learned from what samples of one cloth have in common, the statistics s of
`cusick_bench.problem.statistics`, which scatter over specimens about m(theta) = E_w s(theta, w):

    p(theta | s_1 .. s_n) ~ N(theta; 0, I) N(mean of s_i; m(theta), V / n + L + D + uncertainty of m)

In each round, cloths are drawn from the present posterior and draped, one specimen of each. These drapes show how far m
and V differ from their expected values (`linear_correction`), and elliptical slice sampling draws from the new
posterior. A Gaussian about a linear m, which this solver had before, spread three times too far: statistics are nearly
constant along a curved ridge (softer in bending and stiffer in stretch, or the other way round), which a straight line
leaves.

Where training samples show both faces, the statistics of both faces are used together: with the other face up a cloth
curls the other way, and is the same otherwise. A sample has the same level of stiffness on both faces; all other
differences between samples are taken to be independent from face to face.

V, the scatter of specimens, is that of pairs with the same cloth and level, plus what the level of stiffness adds along
the slope of m. No measurement noise is added, since the fields and the level have the spread that photographs of
samples show. L is the error of the regression for cloths near the observation, D the mean square distance of fabrics
from the nearest simulated cloth. A new sample is predicted by a new cloth with new weights; its drape coefficient has
up to 1 + 1/n times the variance between samples: once for its own scatter, and 1/n for what n samples leave unknown
about the cloth.

References:
    Wood. Statistical inference for noisy nonlinear ecological dynamic systems. Nature 466, 2010. Ong, Nott, Tran,
    Sisson, Drovandi. Variational Bayes with synthetic likelihood. Statistics and Computing 28, 2018. Murray, Adams,
    MacKay. Elliptical slice sampling. AISTATS 2010. Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth
    Digitalization. CVPR 2024. Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001 (D).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.problem import BudgetExceeded
from cusick_bench.sim.engine.pace import PaceName
from cusick_bench.solvers.base import Prediction, Progress, Solver, prediction_at, require_at_least, require_positive
from cusick_bench.solvers.incumbent import Incumbent
from cusick_bench.solvers.level_search import match_bending_level
from cusick_bench.solvers.variational.gaussian_posterior import PREDICTION, standard_normal
from cusick_bench.solvers.variational.predictive import predictive_draws, with_draws

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


@dataclass(frozen=True)
class BdpField(Solver):
    """Level search, inference of the cloth, fit of the training specimen, predictive draws.

    Attributes:
        draws: Posterior-predictive drapes, outside the budget; of each face where both are learned from.
        first: Cloths drawn from the prior and draped, once the level of bending has been found.
        rounds: Rounds of the inference after these.
        cloths: Cloths drawn from the posterior and draped in each round.
        search: Most drapes for the bending level.
        refinement: Gradients for Adam in a round of the fit of the training specimen, 0 for no fit.
        rate: Its first step length [prior standard deviations].
        samples: Most training samples that each face is learned from, of those that the split has; 0 for all.
        pace: How fast drops of drawn cloths get to their end, in the inference and in the prediction: `steady`, as the
            fit's own drapes, or `brisk`, in two thirds of the steps and eight cloths in lockstep.
    """

    draws: int = 200
    first: int = 112
    rounds: int = 4
    cloths: int = 48
    search: int = 8
    refinement: int = 10
    rate: float = 0.2
    samples: int = 0
    pace: PaceName = "steady"
    version: ClassVar[int] = 6
    name: ClassVar[str] = "bdp-field"
    summary: ClassVar[str] = "Bayesian inference over smooth fields of stiffness, laid shape and rest shape"
    reference: ClassVar[str] = "Gong, Mao, Wang 2024; Lindgren, Rue, Lindstrom 2011; Wood 2010; Murray et al. 2010"
    space: ClassVar[str | None] = "field"
    needs_gradient: ClassVar[bool] = True
    learns_both_faces: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_at_least(self, 1, "draws", "cloths")
        require_at_least(self, 0, "first", "rounds", "search", "refinement", "samples")
        require_positive(self, "rate")

    @property
    def takes_gradients(self) -> bool:
        return self.refinement > 0

    @property
    def pace_of_draws(self) -> PaceName:
        return self.pace

    @property
    def drapes_of_prediction(self) -> int:
        return self.draws

    @property
    def draws_asked_for(self) -> int:
        return self.draws

    @property
    def drapes_of_inference(self) -> int:
        return self.search + self.first + self.rounds * self.cloths

    def samples_used(self, given: int) -> int:
        """As many as `samples` says."""
        return min(given, self.samples or given)

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        from cusick_bench.solvers.variational.cloth_inference import ClothInference

        seed, finished = int(generator.integers(2**63)), False
        paced = replace(problem.at_pace(self.pace), follow=False)  # every specimen is laid down by itself
        incumbent, inference = Incumbent(problem), ClothInference(paced, seed, self.samples)
        if problem.protocol.has_standard_ratio:  # as in the drapes that the expected statistics were learned from
            progress(f"first answer: {_known_stiffness(problem, inference.before_drapes())}", problem.meter.share)
        with problem.meter.reserve(1):
            try:
                inference.begin(match_bending_level(incumbent, self.search))
                for number, cloths in enumerate([self.first, *[self.cloths] * self.rounds]):
                    known = _known_stiffness(problem, inference.cloths)
                    progress(f"inference, round {number} of {self.rounds}; {known}", problem.meter.share)
                    inference.drape(cloths)
                known = _known_stiffness(problem, inference.cloths)
                progress(f"fitting the training silhouette; {known}", problem.meter.share)
                self._fit_specimen(incumbent, inference.middle)
                finished = True
            except BudgetExceeded:
                pass
        nearest = min(incumbent, inference.seen, key=lambda one: one.loss)  # a draw, where the fit found no time
        laid = replace(problem, follow=False) if nearest is inference.seen else problem
        best = prediction_at(laid, nearest.tau, finished=finished)
        posterior = {"cloths": inference.cloths, "seed": np.array(seed)}
        if len(inference.faces) == 1:
            seen = predictive_draws(paced, lambda index: self.redraw(problem, posterior, index), self.draws, progress)
            return with_draws(best, seen, posterior)
        return self._draws_of_both(paced, best, posterior, progress)

    def _draws_of_both(
        self, problem: DrapeProblem, best: Prediction, posterior: dict[str, np.ndarray], progress: Progress
    ) -> Prediction:
        """Draws of either face, in turn: even numbers lie as the training sample does, odd ones the other way up."""
        posterior = posterior | {"faces": np.array(2)}
        of_face = [
            predictive_draws(
                problem,
                lambda i, face=face: self.redraw(problem, posterior, 2 * i + face),
                self.draws,
                lambda what, share, face=face: progress(f"face {face + 1}: {what}", share),
            )
            for face in (0, 1)
        ]
        pairs = zip(*(face.items() for face in of_face), strict=False)  # as many of either, where drapes have failed
        seen = {2 * i + face: one for pair in pairs for face, (i, one) in enumerate(pair)}
        return with_draws(best, seen, posterior, np.array(list(seen)) % 2 == 1)

    def redraw(
        self, problem: DrapeProblem, posterior: dict[str, np.ndarray], index: int
    ) -> Float[np.ndarray, " dimension"]:
        """Draws a cloth, and the fields of a specimen of it; of both faces odd numbers lie the other way up."""
        from cusick_bench.problem import FieldSpace
        from cusick_bench.solvers.variational.cloth_inference import drawn_specimen

        noise = standard_normal(int(posterior["seed"]), PREDICTION, index, problem.dimension)
        number, face = divmod(index, int(posterior.get("faces", 1)))
        specimen = drawn_specimen(posterior["cloths"], number, noise)
        if not face:
            return specimen
        assert isinstance(problem.space, FieldSpace)
        return problem.space.turned(specimen)

    def _fit_specimen(self, incumbent: Incumbent, cloth: Float[np.ndarray, " cloth"]) -> None:
        """Fits the training image: the inferred cloth, laid down with the folds of the image, then all at once."""
        from cusick_bench.problem import FieldSpace
        from cusick_bench.solvers.descent import rounds

        space = incumbent.problem.space
        assert isinstance(space, FieldSpace)
        tau = np.zeros(space.dimension)
        tau[: len(cloth)] = cloth
        tau[space.weights("laying")] = space.laid_like(_undulation(incumbent.problem))
        incumbent.value(tau, as_laid=True)
        if self.refinement:
            rounds(incumbent, steps=self.refinement, rate=self.rate, iterations=2 * self.refinement)


def _undulation(problem: DrapeProblem) -> Float[np.ndarray, " vertices"]:
    """Heights with the waves of the training silhouette's folds and the laying field's median amplitude [m]."""
    from cusick_bench.problem import laid_like, profile_in_cloth_frame
    from cusick_bench.problem.cloth_prior import FIELDS
    from cusick_bench.sim.cloth.shape import fade_in

    space = problem.space
    radii = profile_in_cloth_frame(profile_of(problem.train_image, problem.protocol).radii, problem.scene)
    height = laid_like(radii, space.mesh, plate_radius=space.plate_radius).numpy()[:, 2]
    outside = fade_in(space.mesh, space.plate_radius)
    along = np.hypot(*space.mesh.material.T) - space.plate_radius
    folds = outside * (height - along * (outside * height @ along) / (outside * along @ along))
    rms = math.sqrt(float((folds**2).sum() / outside.sum()))
    return folds * FIELDS["laying"].amplitude / max(rms, 1e-9)


def _known_stiffness(problem: DrapeProblem, cloths: Float[np.ndarray, "cloths numbers"]) -> str:
    """Bending stiffness as far as it is known, the mean of directions and curvatures: median and 90 % interval."""
    from cusick_bench.problem.cloth_tables import mean_bending

    low, middle, high = 1e6 * np.quantile(mean_bending(problem.space.prior, cloths), [0.05, 0.5, 0.95])
    return f"bending {_figures(middle, 3)} µN m, {_figures(low, 2)} to {_figures(high, 2)}"


def _figures(value: float, digits: int) -> str:
    """A number with so many significant digits; thousands without exponent."""
    return f"{float(f'{value:.{digits}g}'):g}"
