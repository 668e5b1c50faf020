"""A fabric looked at: its samples' statistics, what the best base model leaves, and the evidence of every cause.

    captures -> Data -> Residual -> Grids -> Weighed

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
    detection_p_value,
    grid_at,
    grids,
    log_sum,
    posterior,
    unknown_evidence,
)
from cusick_bench.diagnosis.inference.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.inference.pairs import pairs
from cusick_bench.diagnosis.inference.residual import Residual, against_base, inflated, scatter_of
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features, features
from cusick_bench.diagnosis.measure.statistics import specimen_statistics
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

ALPHA = 0.05  # level of the detection test, over all causes together
_REFINED = 4  # effects whose base parameters are fitted again with them
_RATIO_TOLERANCE = 0.02


@dataclass(frozen=True, eq=False)
class Data:
    """Statistics of a fabric's samples.

    Attributes:
        specimens: By sample and side.
        drift: Last minus first capture.
        later: Share of later captures.
    """

    specimens: Float[ndarray, "samples 2 statistics"]
    drift: Float[ndarray, "samples statistics"]
    later: float

    def features(self, chosen: ndarray | None = None) -> Features:
        """Of all samples, or of some."""
        if chosen is None:
            return features(self.specimens, self.drift)
        return features(self.specimens[chosen], self.drift[chosen])


@dataclass(frozen=True, eq=False)
class Weighed:
    """Evidence of every cause.

    Attributes:
        p: That so much evidence for anything arises where no effect acts.
        effects: Log evidence by effect.
        unknown: Of a shift that none of them makes.
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
        """Of `none`, every effect, pairs and `unknown`, with a power of the evidences."""
        return posterior(self.effects, self.unknown, tempering=tempering, extra=self.pairs)


@dataclass(frozen=True, eq=False)
class Examined:
    """A fabric and what is made of it without any simulation.

    Attributes:
        data: Its samples.
        features: Of all of them.
        residual: What the best base model leaves.
        grids: All causes that can be detected.
        weighed: Their evidence.
        notes: What was left out or is in doubt.
    """

    data: Data
    features: Features
    residual: Residual
    grids: Sequence[Grid]
    weighed: Weighed
    notes: tuple[str, ...]


def examine(
    captures: Captures,
    emulator: Emulator,
    inflation: float,
    generator: np.random.Generator,
    *,
    without: Sequence[str] = (),
) -> Examined:
    """Looks at a fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas.
        inflation: Of the noise, from calibration.
        generator: Of the detection test's bootstrap.
        without: Effects that are not to be considered.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    scaled, notes = to_atlas(captures)
    data = data_of(scaled)
    found = data.features()
    residual = against_base(emulator, found, scatter=scatter_of(data.specimens), drift=data.later)
    residual = inflated(residual, inflation)
    made = [grid for grid in grids(emulator, residual) if grid.hypothesis.name not in without]
    hidden = sorted({one.name for one in hypotheses(emulator)} - {grid.hypothesis.name for grid in made} - {*without})
    if hidden:
        notes.append(f"undetectable in this fabric, whatever their strength: {', '.join(hidden)}")
    weighed = _weigh(emulator, found, data, residual, made, inflation, generator)
    return Examined(data, found, residual, made, weighed, (*notes, *_doubts(found)))


def to_atlas(captures: Captures) -> tuple[Captures, list[str]]:
    """Lengths in units of the atlas' cloth.

    Raises:
        DiagnosisError: Plate and cloth are not in the atlas' ratio.
    """
    protocol = captures.protocol
    ratio, own = protocol.plate_radius_m / protocol.cloth_radius_m, PLATE_RADIUS / CLOTH_RADIUS
    if abs(ratio / own - 1) > _RATIO_TOLERANCE:
        raise DiagnosisError(
            f"the atlas is for plate over cloth = {own:g}, this protocol has {protocol.plate_radius_m:g} m over "
            f"{protocol.cloth_radius_m:g} m = {ratio:.3g}; drape samples of {2 * protocol.plate_radius_m / own:.3g} m, "
            "or correct protocol.json"
        )
    factor = CLOTH_RADIUS / protocol.cloth_radius_m
    nominal = replace(protocol, cloth_radius_m=CLOTH_RADIUS, plate_radius_m=PLATE_RADIUS)
    return replace(captures, radii=captures.radii * factor, protocol=nominal), list(captures.notes)


def data_of(captures: Captures) -> Data:
    """Statistics of a fabric's samples."""
    table = specimen_statistics(captures)
    mean = table.mean.copy()
    unknown = np.isfinite(mean[:, 2, 0]) & ~np.isfinite(mean[:, 0, 0])
    mean[unknown, 0] = mean[unknown, 2]
    several = np.maximum(table.count.max(1), 1)
    later = float(np.mean((several - 1) / several))
    return Data(mean[:, :2], table.order_odd, later)


def _doubts(found: Features) -> list[str]:
    """What the data cannot show."""
    notes = []
    number = int(found.samples.max())
    if number < 4:
        notes.append(f"only {number} samples: natural variability is the model's, and only strong effects show")
    if found.both == 0:
        notes.append("one face only: what belongs to the cloth and what to the laboratory cannot be told apart")
    if not np.isfinite(found.order).any():
        notes.append("no repeated captures: creep cannot be seen")
    return notes


def _weigh(
    emulator: Emulator,
    found: Features,
    data: Data,
    residual: Residual,
    made: Sequence[Grid],
    inflation: float,
    generator: np.random.Generator,
) -> Weighed:
    p = detection_p_value(residual, made, generator)
    singles = candidates(residual.white, made)
    effects = by_effect(singles)
    best = {name: next(one for one in singles if one.hypothesis.name == name) for name in effects}
    unknown = unknown_evidence(residual.white, made)
    if p > ALPHA or len(effects) < 2:
        return Weighed(p, effects, unknown, best)
    for name in sorted(effects, key=lambda n: -effects[n])[:_REFINED]:
        refined = _refined(emulator, found, data, residual, best[name], made, inflation)
        if refined is not None:
            effects[name], best[name] = refined
    both = pairs(residual.white, made, singles)
    return Weighed(
        p, effects, unknown, best,
        {f"{first} + {second}": evidence for (first, second), (evidence, _) in both.items()},
        {f"{first} + {second}": together for (first, second), (_, together) in both.items()},
    )  # fmt: skip


def _refined(
    emulator: Emulator,
    found: Features,
    data: Data,
    residual: Residual,
    candidate: Candidate,
    made: Sequence[Grid],
    inflation: float,
) -> tuple[float, Candidate] | None:
    """Evidence of an effect with base parameters that were fitted together with it.

    A strong effect pulls the base parameters away from the truth, where its own shift is another; the evidence is
    then taken at the parameters that are best with it, against that of no effect at those that are best without.
    """
    hypothesis = candidate.hypothesis
    point = {name: np.array([value]) for name, value in candidate.value.items()}
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, data.later, point).rows[0]
    scatter = scatter_of(data.specimens)
    try:
        joint = against_base(emulator, found, scatter=scatter, drift=data.later, start=residual.theta, shift=moved)
        there = against_base(emulator, found, scatter=scatter, drift=data.later, start=joint.theta, fixed=True)
    except np.linalg.LinAlgError:
        return None
    there = inflated(there, inflation)
    own = [grid for grid in made if grid.hypothesis.name == hypothesis.name]
    fresh = grid_at(emulator, hypothesis, there)
    if not np.isfinite(fresh.log_prior).any():
        return None
    likelihood = fresh.log_likelihood(there.white) + 0.5 * residual.misfit + _volume(residual) - _volume(there)
    row = fresh.best(likelihood)
    evidence = log_sum(likelihood + fresh.log_prior)
    others = [candidates(residual.white, [g])[0].log_evidence for g in own if g.hypothesis != hypothesis]
    value = {name: float(column[row]) for name, column in hypothesis.values.items()}
    size = float(np.linalg.norm(fresh.shift[row]))
    better = Candidate(hypothesis, value, float(likelihood[row]), evidence, size)
    total = log_sum([evidence, *others])
    return max(total, candidate.log_evidence), better if evidence >= candidate.log_evidence else candidate


def _volume(residual: Residual) -> float:
    """Half the log determinant of the covariance that whitened it."""
    return float(np.log(np.diag(residual.root)).sum())
