"""Responses of effects, fitted to shifts whose law is known: from limp cloth, which hardly answers, to stiff."""

import numpy as np
import pytest

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW
from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS
from cusick_bench.diagnosis.atlas.design import BASE, FINE, FINEST, LAWS, LIMP, ONE_MESH, Design
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.emulator_fit import fit
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import scaled
from cusick_bench.diagnosis.atlas.response import Changes, changes, corrected, response
from cusick_bench.diagnosis.atlas.response_check import unexplained_shares
from cusick_bench.diagnosis.measure.features import SPREADS
from cusick_bench.diagnosis.measure.statistics import FREE, NAMES
from cusick_bench.sim.effects import effect

STEEP = 2.0  # the answer grows by e^4 = 55 from limp to stiff
NOISE = 0.02


def known(rows: int, *, odd: bool = False, seed: int = 0) -> Changes:
    """Shifts exp(2 z0) s d, d fixed for all fabrics, with a little noise."""
    generator = np.random.default_rng(seed)
    theta = generator.uniform(LOW, HIGH, (rows, len(LOW)))
    severity = np.exp(generator.uniform(np.log(0.7), np.log(6), rows)) * generator.choice([-1, 1], rows)
    faces = np.column_stack([severity, -severity if odd else severity])
    direction = np.zeros(len(NAMES))
    direction[list(FREE)] = np.cos(np.arange(len(FREE)))
    size = np.exp(STEEP * scaled(theta)[:, :1]) * faces
    shift = size[..., None] * direction
    shift[..., list(FREE)] += NOISE * generator.standard_normal((rows, 2, len(FREE)))
    noise = np.where(np.isin(np.arange(len(NAMES)), FREE), NOISE**2, 0.0) * np.ones_like(shift)
    return Changes(theta, faces, np.zeros((rows, 0)), shift, noise, np.zeros((rows, len(SPREADS))))


@pytest.mark.parametrize("name", ["camera-scale", "face-asymmetry"])
def test_limp_cloth_is_fitted_as_well_as_stiff(name: str) -> None:
    """A polynomial through all fabrics is wrong by several times the limp ones' whole answer."""
    found = known(200, odd=effect(name).face_odd)
    assert unexplained_shares(effect(name), found) == pytest.approx(np.zeros(3), abs=0.01)


@pytest.mark.parametrize(("name", "down"), [("face-asymmetry", -1.0), ("camera-scale", 1.0)])
def test_drapes_of_an_effect_of_the_faces_are_fitted_with_its_sign_on_each(name: str, down: float) -> None:
    """One raises what is seen of the upper face and lowers it as much on the lower one; the other moves both alike."""
    one, generator = effect(name), np.random.default_rng(6)
    theta, sd = generator.uniform(LOW, HIGH, (200, len(LOW))), np.full((200, len(NAMES)), 0.5)
    severity = generator.uniform(-3, 3, 200)
    plain = generator.standard_normal((200, 2, 2, len(NAMES)))
    moved = severity[:, None] * np.where(np.isin(np.arange(len(NAMES)), FREE), 1.0, 0.0)
    acted = plain + moved[:, None, None] * np.array([1.0, down])[:, None]
    acted += 0.01 * generator.standard_normal(acted.shape)
    base = {number: Point(np.zeros(0), plain[number]) for number in range(200)}
    points = {number: Point(severity[[number]] * one.severity.typical, acted[number]) for number in range(200)}
    found = changes(one, theta, base, points, sd)
    assert found.shift[:, 0, FREE[0]] == pytest.approx(2 * severity, abs=0.1), "in units of the scatter"
    assert unexplained_shares(one, found) == pytest.approx(np.zeros(3), abs=0.01)


def test_what_no_fit_can_know_is_unexplained() -> None:
    """Shifts that have nothing to do with the fabric: predicting them is worse than expecting none."""
    found, generator = known(200), np.random.default_rng(1)
    found.shift[:] = np.where(found.noise > 0, generator.standard_normal(found.shift.shape), 0.0)
    shares = unexplained_shares(effect("camera-scale"), found)
    assert (shares > 0.9).all()


@pytest.mark.parametrize("untouched", [slice(0, 3), slice(None)])
def test_an_effect_may_leave_drapes_exactly_as_they_are(untouched: slice) -> None:
    """Such as a table below the plate, which only limp cloth reaches."""
    found = known(200)
    found.shift[untouched] = found.noise[untouched] = 0.0
    moved, doubt = response(effect("camera-scale"), found).shift(found.theta, found.severity[:, 0], found.place)
    assert np.isfinite(doubt).all()
    assert moved[5:] == pytest.approx(found.shift[5:, 0], rel=0.2, abs=0.2)


def test_doubt_grows_with_the_answer_and_away_from_the_atlas() -> None:
    found = known(200)
    fitted = response(effect("camera-scale"), found)
    middle = (LOW + HIGH) / 2
    limp, stiff, corner = middle.copy(), middle.copy(), HIGH.copy()
    limp[0], stiff[0] = LOW[0], HIGH[0]
    moved, doubt = fitted.shift(np.stack([limp, stiff, corner]), np.ones(3), np.zeros((3, 0)))
    assert np.linalg.norm(moved[1]) / np.linalg.norm(moved[0]) == pytest.approx(np.exp(2 * STEEP), rel=0.1)
    assert doubt[0].mean() < doubt[1].mean() < doubt[2].mean()


def test_a_gain_is_corrected_to_that_of_another_law() -> None:
    """Shifts half as large again under the other law, and an eighth of their size in other directions."""
    found, generator = known(200), np.random.default_rng(2)
    fitted = response(effect("camera-scale"), found)
    cheap, fine = found.of(np.arange(24)), known(200).of(np.arange(24))
    size = np.linalg.norm(fine.shift, axis=2, keepdims=True)
    other = np.where(fine.noise > 0, generator.standard_normal(fine.shift.shape), 0.0)
    fine.shift[:] = 1.5 * fine.shift + 0.125 * size * other / np.linalg.norm(other, axis=2, keepdims=True)
    better = corrected(fitted, cheap, fine)
    before, after = (one.shift(fine.theta, fine.severity[:, 0], fine.place)[0] for one in (fitted, better))
    assert np.linalg.norm(after, axis=1) == pytest.approx(1.5 * np.linalg.norm(before, axis=1), rel=0.1)
    assert better.mismatch is not None
    assert max(better.mismatch) < 0.2
    assert fitted.mismatch is None


def test_cheap_drapes_and_fewer_exact_ones_give_the_exact_mean() -> None:
    """The cheaper model is wrong by a smooth function of stiffness: the fit is that of the exact one."""
    generator = np.random.default_rng(3)
    design = Design(points=96, stiff_points=0, effect_points=0, fine_points=48)
    theta = design.theta()

    def point(number: int, wrong: float) -> Point:
        z = scaled(theta[number])
        mean = np.zeros(len(NAMES))
        mean[: len(FREE)] = 0.2 + 0.02 * z[0] + wrong * (0.03 - 0.02 * z[0])
        noise = np.random.default_rng([4, number]).standard_normal((4, 2, len(NAMES)))
        return Point(np.zeros(0), mean + 1e-3 * noise)

    points = {
        BASE: {number: point(number, 1.0) for number in range(96)},
        FINE: {number: point(number, 0.0) for number in range(48)},
    }
    fitted = fit(design, points)
    at = generator.uniform(LOW, HIGH, (20, len(LOW)))
    expected = 0.2 + 0.02 * scaled(at)[:, 0]
    made = np.stack([fitted.mean(one) for one in at])
    corrected_by = np.abs(0.03 - 0.02 * scaled(at)[:, 0]).max()
    assert made[:, 1] == pytest.approx(expected, abs=0.15 * corrected_by)  # at the corners of the atlas, too
    change = (0.03 - 0.02 * scaled(at)[0, 0]) / fitted.sd(at[0])[: len(FREE)]
    wrong = fitted.wrong(at[0])[: len(FREE), : len(FREE)]
    assert wrong == pytest.approx(np.outer(change, change), rel=0.3), "nothing but the direction of the correction"


SIZE, NUMBER, SECOND, BESIDE = (
    NAMES.index(name) for name in ("mean_radius", "folds", "harmonic_2_real", "harmonic_1_imaginary")
)


@pytest.fixture(scope="module")
def made_up() -> tuple[Design, Emulator]:
    """An atlas of fabrics whose law is known, and its fit.

    Samples scatter by 5, half of their variance common to both faces. The second harmonic is 30 times anisotropy's z.
    Other laws change the number of folds by 10 either way, the base model's own mesh errs by 20 in the size of limp
    cloth, and the samples of one mesh lie beside the middle together.
    """
    design = Design(points=96, stiff_points=0, effect_points=0)
    theta, generator = design.theta(), np.random.default_rng(7)
    z = scaled(theta)

    def drapes(number: int, move: dict[int, float], samples: int = 4) -> Point:
        own = np.random.default_rng([7, number])
        common, face = own.standard_normal((4, 1, len(NAMES))), own.standard_normal((4, 2, len(NAMES)))
        mean = np.zeros(len(NAMES))
        mean[SIZE], mean[SECOND] = 1000.0, 30.0 * z[number, 1]
        for column, shift in move.items():
            mean[column] += shift
        return Point(np.zeros(0), (mean + 5.0 * (common + face) / np.sqrt(2))[:samples])

    limp = [number for number in range(96) if theta[number, 0] < LIMP]
    side = generator.choice([-1.0, 1.0], 96)
    points = {name: {number: drapes(number, {}) for number in range(96)} for name in (BASE, FINE)}
    points[FINEST] = {number: drapes(number, {SIZE: 20.0}, 2) for number in limp}
    points[LAWS] = {number: drapes(number, {NUMBER: 10.0 * side[number]}) for number in range(96)}
    points[ONE_MESH] = {number: drapes(number, {BESIDE: 15.0 * side[number]}) for number in range(96)}
    return design, fit(design, points)


def test_scatter_is_that_of_the_samples_and_of_their_faces(made_up: tuple[Design, Emulator]) -> None:
    design, fitted = made_up
    sd = np.array([fitted.sd(theta) for theta in design.theta()])
    assert np.exp(np.log(sd).mean()) == pytest.approx(5.0, rel=0.05), "not too small for four samples"
    count = len(NAMES)
    assert fitted.correlation == pytest.approx(fitted.correlation.T)
    assert fitted.correlation[:count, :count] == pytest.approx(fitted.correlation[count:, count:]), "faces are alike"
    between = fitted.correlation[:count, count:]
    assert np.diag(between).mean() == pytest.approx(0.9 * 0.5, abs=0.03)  # a tenth is shrunk away
    assert abs(between[~np.eye(count, dtype=bool)].mean()) < 0.01


def test_a_cloth_turned_by_a_quarter_has_warp_and_weft_exchanged(made_up: tuple[Design, Emulator]) -> None:
    design, fitted = made_up
    other = design.theta()
    other[:, PARAMETERS.index("anisotropy")] *= -1
    made = np.array([fitted.mean(one)[SECOND] for one in other])
    assert made == pytest.approx(30.0 * scaled(other)[:, 1], abs=6.0), "as was made of their counterparts"


def test_limp_cloth_is_as_on_the_finest_mesh(made_up: tuple[Design, Emulator]) -> None:
    design, fitted = made_up
    limp = design.theta()[design.theta()[:, 0] < LIMP - 0.5]
    error = np.array([fitted.mean(one)[SIZE] for one in limp]) - 1000.0
    assert error.mean() == pytest.approx(20.0, abs=8.0)


def test_what_other_laws_and_meshes_change_is_doubted(made_up: tuple[Design, Emulator]) -> None:
    """Beyond the noise of few samples: twice the scatter by a law, three times by a mesh, and nothing else."""
    _, fitted = made_up
    for end in fitted.discrepancy:
        assert end[NUMBER, NUMBER] == pytest.approx(2.0**2, rel=0.35)
        assert end[BESIDE, BESIDE] == pytest.approx(3.0**2 / 2, rel=0.35)  # real and imaginary parts are pooled
    others = [column for column in FREE if column not in (SIZE, NUMBER)]
    assert np.mean([end[others, others] for end in fitted.discrepancy]) < 0.1
