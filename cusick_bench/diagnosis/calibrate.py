"""Calibration on simulated cases with known causes: how much noise there is, and how far evidence is to be trusted.

The atlas is not the world. On cases of another world the whitened residual is wider than white where no effect acts,
and evidences are stronger than deserved, as the model's errors are no more independent than effects' are alike. Two
numbers mend that: a factor on the noise, set by the level of the detection test on cases without effect, and a power of
the evidences, set by the mean log score of the probabilities over all cases. None of the cases may be one that a
diagnosis is scored on.

References:
    Gneiting, Raftery. Strictly proper scoring rules, prediction, and estimation. JASA 102(477), 2007. Gruenwald, van
    Ommen. Inconsistency of Bayesian inference for misspecified linear models, and a proposal for repairing it. Bayesian
    Analysis 12(4), 2017 (powers of the likelihood).
"""

from collections.abc import Callable, Sequence

import numpy as np

from cusick_bench.diagnosis.captures import Captures
from cusick_bench.diagnosis.diagnose import single_causes
from cusick_bench.diagnosis.emulator import Emulator
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.evidence import NONE
from cusick_bench.diagnosis.examine import ALPHA, Weighed, examine
from cusick_bench.diagnosis.store import Calibration

INFLATIONS = np.round(np.arange(0.9, 1.55, 0.05), 2)
TEMPERINGS = np.round(np.arange(0.1, 1.55, 0.05), 2)
_LEAST_NULLS = 20
_LEAST_PROBABILITY = 1e-3  # a cause that was left out as undetectable surprises by no more than that
_SEED = 29


def calibrate(
    cases: Sequence[tuple[Captures, str]],
    emulator: Emulator,
    *,
    step: Callable[[], None] = lambda: None,
) -> Calibration:
    """Calibrates the probabilities of an atlas.

    Args:
        cases: Silhouettes, and what acts there: `none`, an effect or `unknown`.
        emulator: The atlas.
        step: Called for every case that was looked at, in both passes.

    Raises:
        DiagnosisError: Too few cases without effect.
    """
    nulls = [captures for captures, truth in cases if truth == NONE]
    if len(nulls) < _LEAST_NULLS:
        raise DiagnosisError(f"calibration needs at least {_LEAST_NULLS} cases without effect, got {len(nulls)}")
    inflation = _inflation(nulls, emulator, step)
    weighed: list[tuple[Weighed, str]] = []
    for captures, truth in cases:
        weighed.append((_examined(captures, emulator, inflation), truth))
        step()
    scores = [log_score(weighed, tempering) for tempering in TEMPERINGS]
    return Calibration(inflation, float(TEMPERINGS[int(np.argmin(scores))]), len(cases))


def log_score(weighed: Sequence[tuple[Weighed, str]], tempering: float) -> float:
    """Mean surprise at the truth [nat].

    Args:
        weighed: Evidence of every case, and what acts there.
        tempering: Power of the evidences.
    """
    found = (single_causes(one.probability(tempering)).get(truth, 0.0) for one, truth in weighed)
    return float(np.mean([-np.log(max(value, _LEAST_PROBABILITY)) for value in found]))


def _inflation(nulls: Sequence[Captures], emulator: Emulator, step: Callable[[], None]) -> float:
    """The least factor at which no more nulls are detected than the test's level allows, case by case by bisection."""
    needed = []
    for captures in nulls:
        low, high = 0, len(INFLATIONS)
        while low < high:
            middle = (low + high) // 2 if low else 0  # most are quiet at the least
            if _examined(captures, emulator, float(INFLATIONS[middle])).p > ALPHA:
                high = middle
            else:
                low = middle + 1
        needed.append(low)
        step()
    rank = int(np.ceil((1 - ALPHA) * len(needed))) - 1
    return float(INFLATIONS[min(sorted(needed)[rank], len(INFLATIONS) - 1)])


def _examined(captures: Captures, emulator: Emulator, inflation: float) -> Weighed:
    return examine(captures, emulator, inflation, np.random.default_rng(_SEED)).weighed
