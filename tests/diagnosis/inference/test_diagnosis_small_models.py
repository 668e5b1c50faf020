"""Sets of effects and detection on a model of four rows and three points, where all sums can be written out."""

from itertools import chain, combinations
from math import comb

import numpy as np
import pytest
from scipy.special import logsumexp

from cusick_bench.diagnosis.inference.findings.detection import detection_p_value, detection_statistic
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.misfit import ANY_PRIOR, ANY_SIZES, MISFIT_PRIOR, MISFIT_SIZES, Misfit
from cusick_bench.diagnosis.inference.sets.set_model import COUNT_PRIOR, SetModel
from cusick_bench.diagnosis.inference.sets.set_sampler import conditional, sample_sets
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN

MISFIT = Misfit(np.eye(4), (1, 1, 0, 2), np.array([0.5, 1.5]))
POINTS = EffectPoints(
    ("one", "other"),
    (),
    np.array([0, 0, 1]),
    np.zeros(3, dtype=int),
    np.arange(3),
    np.array([[2.5, 0.5, 0.0, 1.0], [1.5, 2.0, 1.0, 0.0], [0.5, 2.5, -1.0, 2.0]]),
    np.array([[0.1, 0.0, 0.2, 0.0], [0.0, 0.3, 0.0, 0.1], [0.2, 0.2, 0.0, 0.0]]),
    np.log([0.7, 0.3, 1.0]),
)
WHITE = np.array([2.0, 1.5, 0.5, -0.5])
LISTED = 6


def model(white: np.ndarray = WHITE, freedom: float = np.inf) -> SetModel:
    return SetModel(white, MISFIT, POINTS, LISTED, freedom)


def log_density(left: np.ndarray, variance: np.ndarray) -> float:
    return float(-0.5 * (left**2 / variance + np.log(variance)).sum())


def log_likelihood(chosen: tuple[int, ...], white: np.ndarray = WHITE, *, anything: bool = True) -> float:
    """Of a set, summed over the sizes of the misfit; without those of anything else, that of none."""
    left, variance = white - POINTS.shift[list(chosen)].sum(0), 1 + POINTS.variance[list(chosen)].sum(0)
    forbidden = [
        np.log(p) + log_density(left[:2], variance[:2] + t**2) for t, p in zip(ANY_SIZES, ANY_PRIOR, strict=True)
    ]
    allowed = [
        np.log(p) + log_density(left[2:], variance[2:] + s**2 * MISFIT.pattern)
        for s, p in zip(MISFIT_SIZES, MISFIT_PRIOR, strict=True)
    ]
    first = logsumexp(forbidden) if anything else forbidden[0] - np.log(ANY_PRIOR[0])
    return float(first + logsumexp(allowed))


def exact() -> dict[tuple[int, ...], float]:
    """Probability of each set of points, no two of one effect."""
    sets = [one for one in chain(*(combinations(range(3), size) for size in range(3))) if not {0, 1} <= set(one)]
    joint = [
        log_likelihood(one) + np.log(COUNT_PRIOR[len(one)] / comb(LISTED, len(one))) + POINTS.log_prior[list(one)].sum()
        for one in sets
    ]
    return dict(zip(sets, np.exp(np.array(joint) - logsumexp(joint)).tolist(), strict=True))


def test_the_joint_probability_of_a_set_is_that_of_its_definition():
    for chosen in ((), (1,), (0, 2)):
        prior = np.log(COUNT_PRIOR[len(chosen)] / comb(LISTED, len(chosen))) + POINTS.log_prior[list(chosen)].sum()
        assert model().log_joint(chosen) == pytest.approx(log_likelihood(chosen) + prior), chosen


def test_sampled_sets_have_their_probabilities():
    found = sample_sets(model(), np.random.default_rng(0), steps=1500)
    probability = exact()
    of_points = [sum(p for chosen, p in probability.items() if point in chosen) for point in range(3)]
    np.testing.assert_allclose(found.weight, of_points, atol=0.02)
    assert found.effects["one"] == pytest.approx(of_points[0] + of_points[1], abs=0.02)
    assert found.effects["other"] == pytest.approx(of_points[2], abs=0.02)
    assert found.sets.get((), 0.0) == pytest.approx(probability[()], abs=0.03)
    assert found.sets.get(("one", "other"), 0.0) == pytest.approx(probability[0, 2] + probability[1, 2], abs=0.03)
    assert {*found.sets} <= {(), ("one",), ("other",), ("one", "other")}  # no effect twice
    assert found.best == max(probability, key=lambda chosen: probability[chosen])
    assert {*found.leading} == {"one", "other", NONE, UNKNOWN}
    assert sum(found.leading.values()) == pytest.approx(1)


@pytest.mark.parametrize("others", [[], [0], [2], [0, 2]])
def test_what_accounts_for_most_is_the_largest_shift_or_something_unlisted_that_is_larger(others: list[int]):
    given, size = conditional(model(), others), np.linalg.norm(POINTS.shift, axis=1)
    expected = dict.fromkeys((*POINTS.names, NONE, UNKNOWN), 0.0)
    for option, probability in enumerate(given.options):
        chosen = [*others, *([option] if option < len(POINTS) else [])]
        most = max(chosen, key=lambda point: size[point], default=None)
        left, variance = WHITE - POINTS.shift[chosen].sum(0), 1 + POINTS.variance[chosen].sum(0)
        sizes = zip(ANY_SIZES, ANY_PRIOR, strict=True)
        beyond = np.array([np.log(p) + log_density(left[:2], variance[:2] + t**2) for t, p in sizes])
        larger = ANY_SIZES * np.sqrt(2) > (0.0 if most is None else size[most])  # over both forbidden rows
        unlisted = np.exp(beyond - logsumexp(beyond))[larger].sum()
        expected[UNKNOWN] += probability * unlisted
        expected[NONE if most is None else POINTS.name(most)] += probability * (1 - unlisted)
    assert given.leading == pytest.approx(list(expected.values()))


def test_the_detection_statistic_is_the_evidence_for_anything_over_that_for_nothing():
    nothing = log_likelihood((), anything=False)
    sizes = zip(ANY_SIZES[1:], ANY_PRIOR[1:], strict=True)
    unlisted = logsumexp([np.log(share) + log_density(WHITE[:2], np.full(2, 1 + t**2)) for t, share in sizes])
    unlisted += nothing - log_density(WHITE[:2], np.ones(2))
    single = [log_likelihood((point,), anything=False) + POINTS.log_prior[point] for point in range(3)]
    expected = np.logaddexp(logsumexp(single) - np.log(LISTED), unlisted) - nothing
    assert detection_statistic(model(), WHITE[None])[0] == pytest.approx(expected)


@pytest.mark.parametrize("freedom", [np.inf, 4.0])
@pytest.mark.parametrize("size", [0.0, 5.6])
def test_fabrics_without_effect_are_detected_as_seldom_as_the_level_says(size: float, freedom: float):
    """Whatever symmetry lets the base model get wrong, and however well the noise is known."""
    generator = np.random.default_rng(1)
    scale = np.sqrt(MISFIT.variance(size, 0.0))
    noise = generator.standard_normal((250, 4))
    if np.isfinite(freedom):
        noise *= np.sqrt(freedom / generator.chisquare(freedom, (250, 1)))
    p = [detection_p_value(model(white, freedom), generator, draws=99, most=99) for white in scale * noise]
    assert min(p) >= 0.01
    assert np.mean(np.array(p) <= 0.05) < 0.095  # within three standard errors
    assert np.mean(np.array(p) <= 0.2) < 0.28


def test_p_values_near_the_level_of_the_test_are_from_more_draws_so_that_chance_does_not_decide():
    nulls = np.random.default_rng(2).standard_normal((1000, 4))
    in_order = nulls[np.argsort(-detection_statistic(model(), nulls))]

    def p_value(white: np.ndarray, seed: int, most: int) -> float:
        return detection_p_value(model(white), np.random.default_rng(seed), most=most)

    near = min(in_order[:200:5], key=lambda white: abs(p_value(white, 0, most=2000) - 0.05))
    few = np.std([p_value(near, seed, most=2000) for seed in range(1, 13)])
    many = np.std([p_value(near, seed, most=50_000) for seed in range(1, 13)])
    assert few > 0.0025
    assert many < 0.0015
    far = in_order[len(nulls) // 2]
    assert p_value(far, 1, most=50_000) == p_value(far, 1, most=2000)


def test_no_p_value_is_zero():
    assert detection_p_value(model(50 + WHITE), np.random.default_rng(0), draws=19, most=19) == pytest.approx(0.05)
