"""Evidence of a fabric's silhouettes for every set of causes, without any simulation.

    Captures -> SampleStatistics -> Features -> Residual -> detection, posterior over sets -> named set, novelty, budget

Everything here is linear algebra on the atlas.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.findings.budget import Budget, budget
from cusick_bench.diagnosis.inference.findings.detection import detection_p_value
from cusick_bench.diagnosis.inference.findings.evened import evened_out, evened_weights
from cusick_bench.diagnosis.inference.findings.novelty import Novelty, novelty
from cusick_bench.diagnosis.inference.findings.unusual import unusual
from cusick_bench.diagnosis.inference.findings.verdict import Finding, finding
from cusick_bench.diagnosis.inference.residuals.refusal import domain_doubts
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData, fabric_data
from cusick_bench.diagnosis.inference.sets.fabric_sets import (
    FabricSets,
    fabric_sets,
    likeliest_candidates,
    named_causes,
    refitted,
)
from cusick_bench.diagnosis.inference.sets.refined import named_set
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features


@dataclass(frozen=True, eq=False)
class FabricEvidence:
    """Everything that follows from a fabric's silhouettes without any simulation.

    Attributes:
        samples: Statistics of its samples.
        data: Its features, with the atlas and its calibration.
        plain: Residual of the best base model without effects.
        p: p-value of that model: probability of at least so much evidence for any effect where none acts.
        sets: Posterior over sets of effects.
        novelty: Whether the likeliest set is all that acts.
        finding: Verdict and named set.
        causes: The named effects at their best parameters, with one of each group of look-alikes; the likeliest set
            where there is neither.
        best: Every effect that may act at its likeliest parameters, by its name.
        budget: Which share of the gap each of these takes; None where there is no gap.
        notes: What was left out or is in doubt.
    """

    samples: SampleStatistics
    data: FabricData
    plain: Residual
    p: float
    sets: FabricSets
    novelty: Novelty
    finding: Finding
    causes: tuple[Candidate, ...]
    best: Mapping[str, Candidate]
    budget: Budget | None
    notes: tuple[str, ...]

    @property
    def features(self) -> Features:
        """Features of all samples."""
        return self.data.features

    @property
    def leading(self) -> Mapping[str, float]:
        """Probability that each effect, `none` or `unknown` accounts for most."""
        return self.finding.leading


@threadpool_limits.wrap(limits=1, user_api="blas")  # more threads are slower for such small matrices
def fabric_evidence(
    captures: Captures,
    emulator: Emulator,
    calibration: Calibration,
    generator: np.random.Generator,
    *,
    without: Sequence[str] = (),
    shared: SharedCauses | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> FabricEvidence:
    """Computes the evidence for every set of causes in one fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        generator: Generator of bootstraps and samplers.
        without: Effects that are not to be considered.
        shared: What all fabrics of its laboratory show; nothing by default.
        progress: Called with the share that is done.

    Returns:
        The evidence.

    Raises:
        Refused: Another geometry than the atlas', too few samples, or a cloth beyond the atlas.
        DiagnosisError: No usable drape.
    """
    common = shared or SharedCauses()
    samples, data, notes = fabric_data(captures, emulator, calibration, without)
    plain = data.against()
    model = data.model(plain)
    p = detection_p_value(model, generator)
    own_p = p
    if common.causes:
        left = data.against(start=plain.theta, shift=data.shift(common.causes, plain))
        own_p = detection_p_value(data.model(left), generator)
    hidden = sorted({one.name for one in hypotheses(emulator)} - {*model.points.names, *without})
    if hidden:
        notes.append(f"undetectable in this fabric, whatever their strength: {', '.join(hidden)}")
    sampled = fabric_sets(data, plain, generator, shared=common.causes, progress=progress)
    drift_known = bool(np.isfinite(data.features.order).any())
    evened = evened_out(sampled.posterior, drift_known=drift_known)
    sets = replace(sampled, posterior=replace(evened, weight=evened_weights(sampled, evened)))
    likeliest = [*common.names, *next(iter(sets.posterior.sets))]
    likely = named_causes(data, sets, likeliest)
    notes += domain_doubts(emulator, data.features, sets.residual, data.shift(likely, sets.residual))
    best = named_set(data, sets, likely)
    together = refitted(data, sets, best.causes)
    best = named_set(data, together, best.causes)
    test = novelty(together, best, generator)
    found = finding(own_p, sets.posterior, test, common.names, common.groups)
    causes = best.causes
    stated = [*found.effects, *(group[0] for group in found.groups)]
    if stated and set(stated) != set(likeliest):
        causes = named_set(data, together, named_causes(data, sets, stated)).causes
    if found.verdict == NONE:
        causes = ()
    taken = budget(data, together, samples, causes, generator)
    every = {**likeliest_candidates(sets), **{one.hypothesis.name: one for one in causes}}
    notes += [*found.notes, *unusual(causes)]
    return FabricEvidence(samples, data, plain, p, sets, test, found, causes, every, taken, tuple(notes))
