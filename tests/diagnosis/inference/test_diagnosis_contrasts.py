"""Contrasts of a sample's faces: means and their covariance whatever faces are missing, and the rows they stand in."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray
from scipy.linalg import solve_triangular
from toy_atlas import statistics_of, toy_emulator, toy_outlines, with_planted

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.detectability import power
from cusick_bench.diagnosis.inference.detectability.power import detectable_at, expected_features
from cusick_bench.diagnosis.inference.findings.budget import budget
from cusick_bench.diagnosis.inference.residuals import feature_rows
from cusick_bench.diagnosis.inference.residuals.feature_rows import (
    DRIFT,
    FACE_EVEN,
    FACE_ODD,
    MAY_BE_WRONG,
    ROWS,
    as_seen,
    faces_of,
    in_rows,
)
from cusick_bench.diagnosis.inference.residuals.noise import noise, scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import against_base, base_vector, feature_vector, inflated
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.inference.single_effects.localise import PatchMaps, place
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, contrast_weights, features
from cusick_bench.diagnosis.measure.statistics import NAMES, RESOLUTION, mirrored, rotated
from cusick_bench.sim.effects import effect

COUNT = len(NAMES)
MISSING = {
    "none": [],
    "one face of some": [(0, 1), (1, 1), (2, 0)],
    "down but once": [(n, 1) for n in range(1, 8)],
    "hardly a pair": [(n, n % 2) for n in range(7)],
}


def specimens_of(even: ndarray, odd: ndarray, missing: list[tuple[int, int]]) -> ndarray:
    found = np.stack([even - odd, even + odd], axis=1)
    for sample, face in missing:
        found[sample, face] = np.nan
    return found


@pytest.mark.parametrize("name", MISSING)
def test_contrasts_are_unbiased_and_their_covariance_is_said(name: str) -> None:
    generator = np.random.default_rng(0)
    even, odd = 3.0 + 2.0 * generator.standard_normal((3000, 8)), 1.0 + 0.5 * generator.standard_normal((3000, 8))
    drawn = []
    for e, o in zip(even, odd, strict=True):
        one = specimens_of(np.tile(e[:, None], COUNT), np.tile(o[:, None], COUNT), MISSING[name])
        weights = contrast_weights(np.isfinite(one[..., 0]))
        drawn.append(np.einsum("rsf,sf->r", weights, np.nan_to_num(one[..., 0])))
    found = features(one)
    np.testing.assert_allclose(found.contrast[:, 0], drawn[-1])
    np.testing.assert_allclose(np.mean(drawn, axis=0), [3.0, 1.0], atol=0.06)
    np.testing.assert_allclose(np.cov(np.array(drawn).T), 4.0 * found.share[0] + 0.25 * found.share[1], atol=0.06)
    if name in ("none", "one face of some"):  # how samples differ does not blur how their faces do
        assert found.share[0][1, 1] == pytest.approx(0.0, abs=1e-15)


def test_spreads_are_expected_to_be_known_as_well_as_they_are_measured() -> None:
    """Real and imaginary parts count together, so their spread is known twice as well."""
    measured = features(np.random.default_rng(0).standard_normal((12, 2, COUNT))).spread_variance
    expected = expected_features(toy_emulator(), PRIOR_MEAN, 12).spread_variance
    np.testing.assert_allclose(expected, measured, rtol=0.1)


@pytest.mark.parametrize("samples", [3, 12])
def test_spreads_of_few_samples_are_not_too_small_on_average(samples: int) -> None:
    """Of the logarithm, which of a few samples' standard deviation lies far below that of the true one."""
    generator = np.random.default_rng(1)
    drawn = [features(generator.standard_normal((samples, 2, COUNT))) for _ in range(300)]
    true = [0.5 * np.log(len(columns)) for _, columns in SPREADS]  # real and imaginary parts count together
    values = np.array([one.spread for one in drawn])
    # faces of one sample are taken to be partly alike, which these are not: fewer degrees of freedom than there are
    np.testing.assert_allclose(values.mean(0), true, atol=0.12 if samples == 3 else 0.04)
    assert 0.6 < np.mean(values.var(0) / drawn[0].spread_variance) < 0.9


@pytest.mark.parametrize(("face", "single"), [(0, -1), (1, 1)])
def test_where_one_face_is_known_it_counts(face: int, single: int) -> None:
    generator = np.random.default_rng(1)
    whole = generator.standard_normal((6, 2, COUNT))
    whole[:, 1 - face] = np.nan
    found = features(whole)
    assert found.single == single
    np.testing.assert_allclose(found.contrast[0], whole[:, face].mean(0))
    assert np.isnan(found.contrast[1]).all()
    np.testing.assert_allclose([found.share[0][0, 0], found.share[1][0, 0]], [1 / 6, 1 / 6])
    up, down = generator.standard_normal((2, 3, COUNT))
    rows = in_rows(up, down, np.zeros((3, len(SPREADS))), np.zeros((3, len(ORDERS))))
    np.testing.assert_allclose(as_seen(rows, single)[:, FACE_EVEN], (up, down)[face])
    np.testing.assert_array_equal(as_seen(rows, 0), rows)
    nothing = features(np.full((2, 2, COUNT), np.nan))
    assert np.isnan(nothing.contrast).all()


def test_blocks_hold_all_rows_and_symmetry_says_where_a_model_may_be_wrong() -> None:
    blocks = (FACE_EVEN, FACE_ODD, feature_rows.SPREAD, DRIFT)
    assert [row for block in blocks for row in range(block.start, block.stop)] == list(range(ROWS))
    # A cloth that is the same on both faces and symmetric about warp and weft, in statistics of any size.
    one = np.random.default_rng(2).standard_normal((40, COUNT))
    turned = [one, mirrored(one), rotated(one, np.pi), mirrored(rotated(one, np.pi))]
    up = np.mean(turned, axis=0)
    nothing = np.zeros((40, len(SPREADS))), np.zeros((40, len(ORDERS)))
    vector = in_rows(up, up, *nothing)
    moved = np.abs(vector).max(0) > 1e-12
    assert (moved <= MAY_BE_WRONG).all()
    assert moved[FACE_EVEN].sum() == MAY_BE_WRONG[FACE_EVEN].sum()
    assert MAY_BE_WRONG[feature_rows.SPREAD].all()
    assert not MAY_BE_WRONG[DRIFT].any()


def test_vectors_are_in_the_same_rows() -> None:
    emulator, theta = toy_emulator(), PRIOR_MEAN
    expected = expected_features(emulator, theta, 12)
    sd = emulator.sd(theta)
    np.testing.assert_allclose(feature_vector(expected, sd), base_vector(emulator, theta, sd), atol=1e-12)
    assert len(feature_vector(expected, sd)) == ROWS
    both = next(one for one in hypotheses(emulator) if one.name == "camera-offset" and one.frame == "lab")
    point = {"shift": np.array([2e-3]), "direction": np.array([0.0])}
    row = shifts(emulator, both, theta, sd, 0.5, point).features[0]
    first = NAMES.index("harmonic_1_real")  # towards +x for the camera: towards -x in the frame of a cloth face down
    assert row[FACE_ODD][first] < -0.2
    assert abs(row[FACE_EVEN][first]) < 0.1 * abs(row[FACE_ODD][first])


def test_data_widen_even_and_odd_parts_each_for_itself() -> None:
    emulator, theta, generator = toy_emulator(), PRIOR_MEAN, np.random.default_rng(4)
    sd = emulator.sd(theta)
    wide = specimens_of(
        3 * generator.standard_normal((200, COUNT)) * sd, 0.05 * generator.standard_normal((200, COUNT)) * sd, []
    )
    scatter = scatter_of(wide)
    assert (scatter.within_freedom, scatter.paired_freedom) == (398, 199)
    np.testing.assert_allclose(np.diag(scatter.even) / sd**2, 9, rtol=0.5)
    expected = expected_features(emulator, theta, 12)
    plain, widened = (
        noise(emulator, theta, expected, None, exact=True),
        noise(emulator, theta, expected, scatter, exact=True),
    )
    ratio = np.diag(widened.covariance)[: 2 * COUNT] * np.tile(widened.sd**2, 2)
    ratio = ratio / (np.diag(plain.covariance)[: 2 * COUNT] * np.tile(plain.sd**2, 2))
    assert (ratio[:COUNT] > 4).all()
    assert (ratio[COUNT:] < 0.5).all()
    one_face = scatter_of(np.where(np.arange(2)[:, None] == 0, wide, np.nan))
    assert (one_face.within_freedom, one_face.paired_freedom, one_face.freedom) == (199, 0, 199)
    single = noise(emulator, theta, expected, one_face, exact=True)
    assert (np.diag(single.covariance)[FACE_ODD] * single.sd**2 > RESOLUTION**2 / 100).all()


def test_a_contrast_of_faces_is_seen_through_samples_that_differ() -> None:
    """Samples of very different stiffness: the faces' difference stays as plain as it was."""
    emulator, generator = toy_emulator(), np.random.default_rng(5)
    unlike = replace_between(PRIOR_MEAN, 1.2)
    specimens = statistics_of(toy_outlines(unlike, 12, generator))
    moved = specimens.copy()
    shift = 1.5 * emulator.sd(PRIOR_MEAN)[NAMES.index("mean_radius")]
    moved[:, 1, NAMES.index("mean_radius")] += shift
    plain, shifted = (against_base(emulator, features(one), scatter=scatter_of(one)) for one in (specimens, moved))
    vector = np.zeros((1, ROWS))
    vector[0, FACE_ODD.start + NAMES.index("mean_radius")] = shift / 2 / plain.sd[NAMES.index("mean_radius")]
    assert np.linalg.norm(plain.whiten(vector)) > 3
    assert shifted.squares > plain.squares + 5


def replace_between(theta: ndarray, between: float) -> ndarray:
    changed = theta.copy()
    changed[8] = between
    return changed


def test_at_the_best_base_parameters_the_data_pull_as_hard_as_the_prior() -> None:
    emulator = toy_emulator()
    observed = expected_features(emulator, PRIOR_MEAN + 0.5 * PRIOR_SD, 12)
    best = against_base(emulator, observed).theta
    errors = noise(emulator, best, observed, None)

    def misfit(scaled: ndarray) -> float:
        theta = PRIOR_MEAN + scaled * PRIOR_SD
        value = feature_vector(observed, errors.sd) - base_vector(emulator, theta, errors.sd)
        kept = np.isfinite(value) & np.isfinite(np.diag(errors.covariance))
        return 0.5 * float(value[kept] @ np.linalg.solve(errors.covariance[np.ix_(kept, kept)], value[kept]))

    pull, step = (best - PRIOR_MEAN) / PRIOR_SD, 1e-3 * np.eye(len(PRIOR_SD))
    slope = [(misfit(pull + one) - misfit(pull - one)) / 2e-3 for one in step]
    assert np.linalg.norm(slope + pull) < 0.2 * np.linalg.norm(pull)


def test_what_is_left_is_the_distance_from_the_priors_mean_wherever_the_model_is_linearised() -> None:
    emulator, start = toy_emulator(), PRIOR_MEAN + 0.005 * PRIOR_SD
    observed = expected_features(emulator, PRIOR_MEAN + 0.7 * PRIOR_SD, 12)
    found = against_base(emulator, observed, start=start, fixed=True)
    apart, moved = (
        solve_triangular(found.root, (features - base_vector(emulator, PRIOR_MEAN, found.sd))[found.kept], lower=True)
        for features in (feature_vector(observed, found.sd), base_vector(emulator, start, found.sd))
    )
    assert np.linalg.norm(found.white - apart) < 0.2 * np.linalg.norm(moved)


def test_a_shift_is_whitened_as_the_data_show_it_and_noise_that_is_larger_makes_it_smaller() -> None:
    emulator, generator = toy_emulator(), np.random.default_rng(3)
    shift = generator.standard_normal((2, ROWS))
    for face, sign in ((0, -1), (1, 1)):
        specimens = np.tile(emulator.mean(PRIOR_MEAN), (5, 2, 1))
        specimens[:, 1 - face] = np.nan
        found = against_base(emulator, features(specimens), start=PRIOR_MEAN, fixed=True)
        seen = shift.copy()
        seen[:, FACE_EVEN] += sign * shift[:, FACE_ODD]
        whitened = found.whiten(shift)
        np.testing.assert_allclose(whitened @ found.root.T, seen[:, found.kept])
        wider, rows = inflated(found, 2.0), len(found.white)
        np.testing.assert_allclose(wider.whiten(shift), whitened / 2)
        density = found.log_likelihood + (1 - 1 / 4) / 2 * found.squares - rows * np.log(2)
        assert wider.log_likelihood == pytest.approx(density)


def test_three_samples_do_not_make_the_scatter_look_too_small() -> None:
    """Logarithms of variances of few degrees of freedom lie below those of the variances that they are drawn with."""
    emulator, theta, generator, n = toy_emulator(), PRIOR_MEAN, np.random.default_rng(5), COUNT
    sd = emulator.sd(theta)
    own = (emulator.correlation[:n, :n] + emulator.correlation[n:, n:]) / 2
    other = (emulator.correlation[:n, n:] + emulator.correlation[:n, n:].T) / 2
    roots = [np.linalg.cholesky(part / 2 + 1e-9 * np.eye(n)) for part in (own + other, own - other)]
    wider = []
    for _ in range(40):
        even, odd = ((generator.standard_normal((3, n)) @ root.T) * sd for root in roots)
        specimens = emulator.mean(theta) + np.stack([even - odd, even + odd], axis=1)
        found = noise(emulator, theta, features(specimens), scatter_of(specimens), exact=True)
        wider.append(np.mean(np.log(found.sd / sd)))
    assert abs(np.mean(wider)) < 0.08


def test_a_mean_drift_scatters_as_students_t_of_its_samples_does() -> None:
    generator = np.random.default_rng(2)
    drift = 2.0 + generator.standard_normal((12, COUNT))
    drift[3] = np.nan  # a sample without repeats
    found = features(generator.standard_normal((12, 2, COUNT)), drift)
    known = np.delete(drift, 3, axis=0)[:, list(ORDERS)]
    np.testing.assert_allclose(found.order, known.mean(0))
    assert found.order_freedom == 10
    np.testing.assert_allclose(
        found.order_covariance, 10 / 8 * np.cov(known.T) / 11
    )  # the variance of t is f / (f - 2)


def test_drifts_that_rise_together_count_once() -> None:
    emulator, theta = toy_emulator(), PRIOR_MEAN
    expected = expected_features(emulator, theta, 12)
    rows = noise(emulator, theta, expected, None).covariance[DRIFT, DRIFT]
    size = np.sqrt(np.diag(rows))
    correlation = rows / np.outer(size, size)
    names = [NAMES[column] for column in ORDERS]
    assert correlation[names.index("mean_radius"), names.index("area_dc")] > 0.7
    alike = np.ones((len(ORDERS), len(ORDERS))) * 1e-6 + np.eye(len(ORDERS)) * 1e-8
    data = replace(expected, order_covariance=alike, order_freedom=1000)
    rows = noise(emulator, theta, data, None).covariance[DRIFT, DRIFT]
    assert np.linalg.eigvalsh(rows).min() > 0


def test_pictures_taken_twice_are_known_to_their_resolution() -> None:
    """Second pictures that are copies of the first ones: every sample drifts alike, by nothing."""
    emulator, theta = toy_emulator(), PRIOR_MEAN
    expected = expected_features(emulator, theta, 12)
    copies = replace(expected, order_covariance=np.zeros((len(ORDERS), len(ORDERS))), order_freedom=11)
    found = noise(emulator, theta, copies, None)
    rows = found.covariance[DRIFT, DRIFT]
    assert np.isfinite(rows).all()
    assert np.linalg.eigvalsh(rows).min() > 0
    resolved = np.sqrt(np.diag(rows)) * found.sd[list(ORDERS)] / RESOLUTION[list(ORDERS)]
    assert ((resolved > 0.25) & (resolved < 1)).all(), "neither exactly nor worse"


def test_a_planted_offset_is_found_in_toy_cloths() -> None:
    emulator, generator = toy_emulator(), np.random.default_rng(6)
    outlines = with_planted(
        toy_outlines(PRIOR_MEAN, 12, generator), "camera-offset", {"shift": 3e-3, "direction": 40.0}
    )
    specimens = statistics_of(outlines)
    residual = against_base(emulator, features(specimens), scatter=scatter_of(specimens))
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "camera-offset" and one.frame == "lab")
    moved = residual.whiten(shifts(emulator, hypothesis, residual.theta, residual.sd, 0.5).features)
    best = int(np.argmin(((residual.white - moved) ** 2).sum(1)))
    assert hypothesis.values["shift"][best] == pytest.approx(3e-3, rel=0.5)
    assert abs(hypothesis.values["direction"][best] - 40) <= 15


def test_the_noise_is_that_of_fabrics_that_scatter_otherwise_than_the_model() -> None:
    """A dozen samples that scatter by half or by thrice the model's: mean squares of the noise stay near 1."""
    emulator, theta, generator = toy_emulator(), PRIOR_MEAN, np.random.default_rng(11)
    sd, n = emulator.sd(theta), COUNT
    own, other = emulator.correlation[:n, :n], emulator.correlation[:n, n:]
    root = np.linalg.cholesky((own + own.T) / 2 - (other + other.T) / 2 + 1e-9 * np.eye(n)) / np.sqrt(2)
    for wider in (0.5, 3.0):
        squares = []
        for _ in range(30):
            even, odd = (wider * (generator.standard_normal((12, n)) @ root.T) * sd for _ in range(2))
            specimens = np.stack([emulator.mean(theta) + even - odd, emulator.mean(theta) + even + odd], axis=1)
            found = noise(emulator, theta, features(specimens), scatter_of(specimens), exact=True)
            odd_rows = odd.mean(0) / found.sd
            squares.append(odd_rows @ np.linalg.solve(found.covariance[FACE_ODD, FACE_ODD], odd_rows) / n)
        assert 0.8 < np.mean(squares) < 1.6, (wider, np.mean(squares))  # 2 and more without the scale g


def test_detectable_severity_moves_the_features_by_what_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The median over directions of |d|, where no base parameters are fitted again, and between points of the grid."""
    emulator, theta = toy_emulator(), PRIOR_MEAN
    offset = next(one for one in hypotheses(emulator) if one.name == "camera-offset")
    monkeypatch.setattr(power, "PRIOR_SD", 0 * PRIOR_SD)
    monkeypatch.setattr(power, "hypotheses", lambda emulator: [offset])
    monkeypatch.setattr(power, "against_base", lambda *data, **how: against_base(*data, **how | {"fixed": True}))
    residual = against_base(emulator, expected_features(emulator, theta, 12), start=theta, fixed=True)
    for need, inflation in ((3.0, 1.0), (2.0, 1.8)):
        found = detectable_at(emulator, float(theta[0]), {"camera-offset": need}, fabrics=1, inflation=inflation)
        value = {"shift": np.full(24, found["camera-offset"]), "direction": np.arange(24) * 15.0}
        moved = residual.whiten(shifts(emulator, offset, theta, residual.sd, residual.drift, value).features)
        assert np.median(np.linalg.norm(moved, axis=1)) == pytest.approx(need * inflation, rel=0.1)


def test_two_effects_that_explain_the_gap_together_leave_nothing_of_it_unexplained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both make outlines larger: what they explain in common is shared out once."""
    monkeypatch.setattr(sys.modules[budget.__module__], "_SPLITS", 2)  # halves tell the same here
    emulator, generator = toy_emulator(), np.random.default_rng(7)
    listed = {one.name: one for one in hypotheses(emulator)}
    causes = [Candidate(listed["camera-scale"], {"error": 0.06}), Candidate(listed["threshold"], {"shift": 6e-3})]
    fabric = FabricData(emulator, Calibration(), expected_features(emulator, PRIOR_MEAN, 12), None, 0.5)
    at = fabric.against(start=PRIOR_MEAN, fixed=True)
    moved = faces_of(fabric.shift(causes, at)) * at.sd
    own, other = (at.whiten(fabric.shift([one], at)[None])[0] for one in causes)
    assert own @ other > 0.3 * np.linalg.norm(own + other) ** 2 / 4, "they overlap"
    root = np.linalg.cholesky(emulator.correlation + 1e-9 * np.eye(2 * COUNT))
    scatter = (generator.standard_normal((16, 2 * COUNT)) @ root.T).reshape(16, 2, COUNT) * emulator.sd(PRIOR_MEAN)
    samples = SampleStatistics(emulator.mean(PRIOR_MEAN) + moved + scatter, np.full((16, COUNT), np.nan), 0.5)
    white = replace(at, white=own + other)
    model = fabric.model(at)
    sets = FabricSets(white, model, SetPosterior({}, {}, {}, (), np.zeros(len(model.points)), 0.0))
    found = budget(fabric, sets, samples, causes, generator)
    assert found is not None
    assert found.unexplained.value == pytest.approx(0, abs=0.1)
    assert sum(one.value for one in found.effects.values()) == pytest.approx(1, abs=0.1)


def test_a_patch_of_which_nothing_is_seen_may_be_anywhere() -> None:
    """Sectors and rings of the map are alike, however many points of the grid stand for each."""
    patch = Hypothesis(effect("local-stiff-patch"), "cloth", 1.0)
    rows = np.concatenate([np.arange(len(patch.severity())), np.arange(0, len(patch.severity()), 7)])  # some twice
    values, zeros = {name: column[rows] for name, column in patch.values.items()}, np.zeros(len(rows))
    grid = Grid(patch, values, np.ones(len(rows)), np.zeros((len(rows), 3)), zeros, zeros)
    np.testing.assert_allclose(PatchMaps([grid]).of(np.ones(3)), 1 / 64)


class _Stain(type(effect("local-stiff-patch"))):
    """A patch of another package, whose parameters have names of their own, and perhaps no radius."""

    name = "stain"

    def __init__(self, *left_out: str) -> None:
        own = {"direction": "bearing", "radius": "distance"}
        known = effect("local-stiff-patch").parameters
        self.parameters = tuple(
            replace(one, name=own.get(one.role, one.name)) for one in known if one.role not in left_out
        )


@pytest.mark.parametrize("left_out", [(), ("radius",)])
def test_a_patch_of_another_package_is_placed_by_the_roles_of_its_parameters(left_out: tuple[str, ...]) -> None:
    """Every diagnosis ended in a KeyError."""
    known, stain = Hypothesis(effect("local-stiff-patch"), "cloth", 1.0), _Stain(*left_out)
    named = {one.role: one.name for one in stain.parameters}
    values = {named[one.role]: known.values[one.name] for one in known.effect.parameters if one.role in named}
    zeros = np.zeros(len(known.severity()))
    grid = Grid(Hypothesis(stain, "cloth", 1.0), values, np.ones(len(zeros)), np.zeros((len(zeros), 3)), zeros, zeros)
    np.testing.assert_allclose(PatchMaps([grid]).of(np.ones(3)), 1 / 64)
    found = place(None, np.ones(3), [grid])
    assert (found.localisable, found.why_not) == (False, "no single cause is named")
