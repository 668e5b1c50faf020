"""What a fabric's silhouettes say of every cause: the features, what the best base model leaves, the evidence.

    Captures -> SampleStatistics -> Features -> Residual -> Grids -> CauseEvidence

Everything here is linear algebra on the atlas. `diagnose` turns it into probabilities, a verdict and simulations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.evidence import (
    Candidate,
    Grid,
    by_effect,
    candidates,
    detectable_grids,
    detection_p_value,
    grid_at,
    log_sum,
    posterior,
    unknown_evidence,
)
from cusick_bench.diagnosis.inference.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.inference.pairs import pairs
from cusick_bench.diagnosis.inference.residual import Residual, against_base, inflated, scatter_of
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.features import features as features_of
from cusick_bench.diagnosis.measure.statistics import specimen_statistics
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

ALPHA = 0.05  # level of the detection test, over all causes together
_REFINED = 4  # effects whose base parameters are fitted again with them
_RATIO_TOLERANCE = 0.02


@dataclass(frozen=True, eq=False)
class SampleStatistics:
    """Statistics of a fabric's samples.

    Attributes:
        specimens: Means over the captures of each sample and side; NaN where there is none.
        drift: Last minus first capture of each sample.
        later: Share of captures that are not the first of their drape.
    """

    specimens: Float[ndarray, "samples 2 statistics"]
    drift: Float[ndarray, "samples statistics"]
    later: float

    def features(self, chosen: ndarray | None = None) -> Features:
        """Features of all samples, or of some.

        Args:
            chosen: Indices of the samples.

        Returns:
            Their features.
        """
        if chosen is None:
            return features_of(self.specimens, self.drift)
        return features_of(self.specimens[chosen], self.drift[chosen])


@dataclass(frozen=True, eq=False)
class CauseEvidence:
    """Evidence of every cause.

    Attributes:
        p: p-value of the base model: that so much evidence for anything arises where no effect acts.
        effects: Log evidence by effect.
        unknown: Log evidence of a shift that none of them makes.
        best: The best point of every effect.
        pairs: Log evidence by pair, `a + b`.
        together: The best points of every pair.
    """

    p: float
    effects: Mapping[str, float]
    unknown: float
    best: Mapping[str, Candidate]
    pairs: Mapping[str, float] = field(default_factory=dict)
    together: Mapping[str, tuple[Candidate, Candidate]] = field(default_factory=dict)

    def probability(self, tempering: float = 1.0) -> dict[str, float]:
        """Probabilities that follow from the evidence.

        Args:
            tempering: Power of the evidences.

        Returns:
            Of `none`, every effect, pairs and `unknown`.
        """
        return posterior(self.effects, self.unknown, tempering=tempering, extra=self.pairs)


@dataclass(frozen=True, eq=False)
class FabricEvidence:
    """A fabric and what follows from its silhouettes without any simulation.

    Attributes:
        samples: Statistics of its samples.
        features: Features of all of them.
        residual: What the best base model leaves.
        grids: All causes that can be detected.
        causes: Their evidence.
        notes: What was left out or is in doubt.
    """

    samples: SampleStatistics
    features: Features
    residual: Residual
    grids: Sequence[Grid]
    causes: CauseEvidence
    notes: tuple[str, ...]


def fabric_evidence(
    captures: Captures,
    emulator: Emulator,
    inflation: float,
    generator: np.random.Generator,
    *,
    without: Sequence[str] = (),
) -> FabricEvidence:
    """Weighs every cause for one fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas.
        inflation: Factor on the noise, from calibration.
        generator: Generator of the detection test's bootstrap.
        without: Effects that are not to be considered.

    Returns:
        The evidence.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    scaled, notes = to_atlas(captures)
    samples = sample_statistics(scaled)
    features = samples.features()
    plain = against_base(emulator, features, scatter=scatter_of(samples.specimens), drift=samples.later)
    residual = inflated(plain, inflation)
    grids = [grid for grid in detectable_grids(emulator, residual) if grid.hypothesis.name not in without]
    hidden = sorted({one.name for one in hypotheses(emulator)} - {grid.hypothesis.name for grid in grids} - {*without})
    if hidden:
        notes.append(f"undetectable in this fabric, whatever their strength: {', '.join(hidden)}")
    causes = _weighed(_Fabric(emulator, features, samples, residual, grids, inflation), generator)
    return FabricEvidence(samples, features, residual, grids, causes, (*notes, *_doubts(features)))


def to_atlas(captures: Captures) -> tuple[Captures, list[str]]:
    """Captures with lengths in units of the atlas' cloth.

    Args:
        captures: Silhouettes of a fabric.

    Returns:
        The captures, scaled; their notes.

    Raises:
        DiagnosisError: Plate and cloth are not in the atlas' ratio.
    """
    protocol = captures.protocol
    ratio, nominal_ratio = protocol.plate_radius_m / protocol.cloth_radius_m, PLATE_RADIUS / CLOTH_RADIUS
    if abs(ratio / nominal_ratio - 1) > _RATIO_TOLERANCE:
        raise DiagnosisError(
            f"the atlas is for plate over cloth = {nominal_ratio:g}, this protocol has {protocol.plate_radius_m:g} m "
            f"over {protocol.cloth_radius_m:g} m = {ratio:.3g}; drape samples of "
            f"{2 * protocol.plate_radius_m / nominal_ratio:.3g} m, or correct protocol.json"
        )
    factor, notes = CLOTH_RADIUS / protocol.cloth_radius_m, list(captures.notes)
    if factor != 1:
        notes.append(
            f"lengths are those of the atlas' cloth of {1e3 * CLOTH_RADIUS:g} mm radius; for this one, of "
            f"{1e3 * protocol.cloth_radius_m:g} mm, multiply them by {1 / factor:.4g}"
        )
    if protocol.projection == "pinhole":
        notes.append(
            "radii are corrected for the pinhole camera of protocol.json as those of straight generators from the "
            "plate's edge to the rim: what is left of perspective may show as an effect of the camera"
        )
    nominal = replace(
        protocol,
        cloth_radius_m=CLOTH_RADIUS,
        plate_radius_m=PLATE_RADIUS,
        px_per_m=protocol.px_per_m / factor,
        camera_height_m=protocol.camera_height_m * factor,
    )
    scaled = replace(captures, radii=captures.radii * factor, area=captures.area * factor**2, protocol=nominal)
    return scaled, notes


def sample_statistics(captures: Captures) -> SampleStatistics:
    """Statistics of a fabric's samples; a face that is not known counts as the upper one, where that is missing.

    Args:
        captures: Its silhouettes, in the atlas' lengths.

    Returns:
        The statistics.
    """
    table = specimen_statistics(captures)
    mean = table.mean.copy()
    unknown = np.isfinite(mean[:, 2, 0]) & ~np.isfinite(mean[:, 0, 0])
    mean[unknown, 0] = mean[unknown, 2]
    several = np.maximum(table.count.max(1), 1)
    later = float(np.mean((several - 1) / several))
    return SampleStatistics(mean[:, :2], table.order_odd, later)


def _doubts(features: Features) -> list[str]:
    """What the data cannot show."""
    notes = []
    number = int(features.samples.max())
    if number < 4:
        notes.append(f"only {number} samples: natural variability is the model's, and only strong effects show")
    if features.both == 0:
        notes.append("one face only: what belongs to the cloth and what to the laboratory cannot be told apart")
    if not np.isfinite(features.order).any():
        notes.append("no repeated captures: creep cannot be seen")
    return notes


@dataclass(frozen=True, eq=False)
class _Fabric:
    """What causes are weighed on; names as in `FabricEvidence`, `inflation` the factor on the noise."""

    emulator: Emulator
    features: Features
    samples: SampleStatistics
    residual: Residual
    grids: Sequence[Grid]
    inflation: float


def _weighed(fabric: _Fabric, generator: np.random.Generator) -> CauseEvidence:
    white, grids = fabric.residual.white, fabric.grids
    p = detection_p_value(fabric.residual, grids, generator)
    singles = candidates(white, grids)
    effects = by_effect(singles)
    best = {name: next(one for one in singles if one.hypothesis.name == name) for name in effects}
    unknown = unknown_evidence(white, grids)
    if p > ALPHA or len(effects) < 2:
        return CauseEvidence(p, effects, unknown, best)
    for name in sorted(effects, key=lambda n: -effects[n])[:_REFINED]:
        refined = _refined(fabric, best[name])
        if refined is not None:
            effects[name], best[name] = refined
    both = pairs(white, grids, singles)
    return CauseEvidence(
        p, effects, unknown, best,
        {f"{first} + {second}": evidence for (first, second), (evidence, _) in both.items()},
        {f"{first} + {second}": together for (first, second), (_, together) in both.items()},
    )  # fmt: skip


def _refined(fabric: _Fabric, candidate: Candidate) -> tuple[float, Candidate] | None:
    """Evidence of an effect with base parameters that were fitted together with it.

    A strong effect pulls the base parameters away from the truth, where its own shift is another; the evidence is
    then taken at the parameters that are best with it, against that of no effect at those that are best without.
    """
    emulator, residual, later = fabric.emulator, fabric.residual, fabric.samples.later
    hypothesis = candidate.hypothesis
    point = {name: np.array([value]) for name, value in candidate.value.items()}
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, later, point).features[0]
    scatter = scatter_of(fabric.samples.specimens)
    try:
        joint = against_base(emulator, fabric.features, scatter=scatter, drift=later, start=residual.theta, shift=moved)
        there = against_base(emulator, fabric.features, scatter=scatter, drift=later, start=joint.theta, fixed=True)
    except np.linalg.LinAlgError:
        return None
    there = inflated(there, fabric.inflation)
    refitted = grid_at(emulator, hypothesis, there)
    if not np.isfinite(refitted.log_prior).any():
        return None
    likelihood = refitted.log_likelihood(there.white) + 0.5 * residual.misfit + _volume(residual) - _volume(there)
    row = refitted.best(likelihood)
    evidence = log_sum(likelihood + refitted.log_prior)
    frames = [grid for grid in fabric.grids if grid.hypothesis.name == hypothesis.name]
    others = [candidates(residual.white, [g])[0].log_evidence for g in frames if g.hypothesis != hypothesis]
    value = {name: float(column[row]) for name, column in hypothesis.values.items()}
    size = float(np.linalg.norm(refitted.shift[row]))
    better = Candidate(hypothesis, value, float(likelihood[row]), evidence, size)
    total = log_sum([evidence, *others])
    return max(total, candidate.log_evidence), better if evidence >= candidate.log_evidence else candidate


def _volume(residual: Residual) -> float:
    """Half the log determinant of the covariance that whitened it."""
    return float(np.log(np.diag(residual.root)).sum())
