"""The atlas: features, fits, the file that holds it, and the drapes that it is made of."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch
from numpy import ndarray
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas import drapes
from cusick_bench.diagnosis.atlas.base_model import DENSITY, LOW, PRIOR_MEAN, PRIOR_SD, BaseModel
from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS
from cusick_bench.diagnosis.atlas.design import BASE, FINE, FINEST, LIMP, NOT_SIMULATED, Design, at_fine
from cusick_bench.diagnosis.atlas.drapes import build, make_points, random_value
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.points import DESIGN_FILE, is_made, point_file, read_point, read_points, write_point
from cusick_bench.diagnosis.atlas.ridge import ridge
from cusick_bench.diagnosis.atlas.store import Calibration, load, load_uncalibrated, save
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.residuals.residual import against_base
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis
from cusick_bench.diagnosis.measure.features import SPREADS, features
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.files import BadFile
from cusick_bench.metrics.stiffness import BENDING_ROWS
from cusick_bench.sim import engine
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY
from cusick_bench.sim.effects import Parameter, Values, registered
from cusick_bench.sim.effects.imaging.camera_scale import CameraScale
from cusick_bench.sim.setup import Field, Setup

THETA = PRIOR_MEAN + PRIOR_SD * np.array([0.9, 0.2, 0.0, 0.0, 0.2, 0.1, 0.1, 0.0, 0.0])


def setups_with(samples: int, **numbers: float) -> list[Setup]:
    """Samples of the prior's mean cloth with some other numbers, always of the same random numbers."""
    theta = PRIOR_MEAN.copy()
    for name, value in numbers.items():
        theta[PARAMETERS.index(name)] = value
    return BaseModel(60).samples(theta, samples, (8,))


def heights(field: Field | None, stretched: float = 1.0) -> ndarray:
    """Values of a field all over the cloth, or over one that is so many times as large."""
    assert field is not None
    places = np.random.default_rng(5).uniform(-CLOTH_RADIUS, CLOTH_RADIUS, (400, 2))
    return field(torch.from_numpy(stretched * places)).numpy()


def test_the_mean_cloth_is_as_stiff_as_its_numbers_say() -> None:
    one = setups_with(1, bending=-6.5, anisotropy=0.7, bias=-0.3, growth=0.4, shear=4.0)[0]
    weight = DENSITY * GRAVITY
    warp, weft, bias = (one.material.bending.numpy()[BENDING_ROWS[name]] for name in ("warp", "weft", "bias"))
    mean = np.sqrt(warp * weft)
    assert np.log(mean[0] / (weight * CLOTH_RADIUS**3)) == pytest.approx(-6.5)
    np.testing.assert_allclose(np.log(weft / warp), 0.7)
    np.testing.assert_allclose(np.log(bias / mean), -0.3)
    for direction in (warp, weft, bias):
        assert np.log(direction[-1] / direction[0]) == pytest.approx(0.4), "sharply bent over hardly bent"
    assert np.log(one.material.stretch.numpy()[0, 3] / (weight * CLOTH_RADIUS)) == pytest.approx(4.0)


def test_samples_are_laid_and_curl_and_differ_as_their_numbers_say() -> None:
    """What a sample is born with stays when it is turned over; each face is laid anew."""
    made = setups_with(30, laying=-1.0, rest=0.5, between=0.6)
    assert [one.side for one in made] == ["up", "down"] * 30
    up, down = made[0::2], made[1::2]
    laid = np.array([[heights(one.laying) for one in face] for face in (up, down)])
    rest = np.array([[heights(one.rest) for one in face] for face in (up, down)])
    level = np.array([[heights(one.log_bending[1]) for one in face] for face in (up, down)])
    assert laid.std() == pytest.approx(1e-3 * np.exp(-1.0), rel=0.15)  # a little less, as it is nowhere too steep
    assert abs(np.corrcoef(laid[0].ravel(), laid[1].ravel())[0, 1]) < 0.2
    assert rest.std() == pytest.approx(3e-4 * np.exp(0.5), rel=0.15)
    np.testing.assert_array_equal(rest[0], rest[1])
    np.testing.assert_array_equal(level[0], level[1])
    assert np.ptp(level, axis=2).max() == 0, "the same all over the sample"
    assert level[0, :, 0].std() == pytest.approx(0.1 * np.exp(0.6), rel=0.35)
    assert abs(level[0, :, 0].mean()) < 0.1


def test_a_laid_shape_is_longer_by_its_number_and_never_too_steep() -> None:
    short, long = (setups_with(1, laying=-1.0, length=length)[0] for length in (0.0, np.log(2.0)))
    before, after = heights(short.laying), heights(long.laying, 2.0)
    assert np.corrcoef(before, after)[0, 1] == pytest.approx(1.0), "the same shape, of twice the length"
    steep = [heights(one.laying) for one in setups_with(12, laying=3.0, length=0.0)]
    assert 0.2 < np.std(steep) / 0.02 < 0.3, "20 mm of undulations 20 mm long would be"


def test_features_of_known_numbers() -> None:
    generator = np.random.default_rng(0)
    specimens = generator.standard_normal((400, 2, len(NAMES))) * 0.5 + 3.0
    specimens[:10, 1] = np.nan
    found = features(specimens, None)
    assert found.samples.tolist() == [400, 390]
    assert found.both == 390
    np.testing.assert_allclose(found.mean, 3.0, atol=0.15)
    expected = [np.log(0.5 * np.sqrt(len(columns))) for _, columns in SPREADS]
    np.testing.assert_allclose(found.spread, expected, atol=0.06)
    assert np.isnan(found.order).all()


def test_spread_is_unbiased_for_few_samples() -> None:
    generator = np.random.default_rng(1)
    values = [features(generator.standard_normal((3, 2, len(NAMES)))).spread[0] for _ in range(600)]
    assert abs(np.mean(values)) < 0.09  # ln 1 = 0; without correction it is -.15


def test_ridge_finds_what_is_there_and_shrinks_what_is_not() -> None:
    generator = np.random.default_rng(2)
    terms = np.column_stack([np.ones(300), generator.standard_normal((300, 9))])
    truth = np.zeros((10, 2))
    truth[:2, 0] = [1.0, 2.0]
    found = ridge(terms, terms @ truth + 0.1 * generator.standard_normal((300, 2)), 1)
    np.testing.assert_allclose(found.weights, truth, atol=0.05)
    np.testing.assert_allclose(found.residual, 0.01, rtol=0.3)


def test_atlas_is_kept_to_single_precision(emulator: Emulator, tmp_path: Path) -> None:
    save(tmp_path / "atlas.npz", emulator, Calibration(1.1, 7, discrepancy=0.2))
    again, calibration = load(tmp_path / "atlas.npz")
    assert calibration == Calibration(1.1, 7, discrepancy=0.2)
    np.testing.assert_allclose(again.mean(THETA), emulator.mean(THETA), rtol=1e-5)
    np.testing.assert_allclose(again.discrepancy, 0.2 * emulator.discrepancy, rtol=1e-5)
    assert again.responses.keys() == emulator.responses.keys()


def test_a_full_disk_leaves_the_atlas_of_before_and_a_file_of_the_same_stem(
    emulator: Emulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "atlas.tmp").write_text("mine")
    save(tmp_path / "atlas.npz", emulator, Calibration(1.1, 7))
    there = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert there["atlas.tmp"] == b"mine"

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        save(tmp_path / "atlas.npz", emulator, Calibration(1.2, 7))
    with pytest.raises(OSError, match="No space left"):
        write_point(tmp_path / "base.npz", np.zeros(0), np.zeros((1, 2, 3)))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == there


def test_effects_of_a_package_that_is_not_here_are_named(emulator: Emulator, tmp_path: Path) -> None:
    foreign = replace(emulator.responses["plate-radius"], effect="weak-gravity")
    own = replace(emulator, responses={**emulator.responses, "weak-gravity": foreign})
    save(tmp_path / "atlas.npz", own, Calibration())
    with pytest.warns(RuntimeWarning, match="no diagnosis will find them: weak-gravity; install the package"):
        again, _ = load(tmp_path / "atlas.npz")
    assert "weak-gravity" in again.responses  # of the package, once it is here


@pytest.mark.parametrize("damage", ["empty", "other", "absent"])
def test_damaged_atlas_is_refused(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "atlas.npz"
    if damage != "absent":
        path.write_bytes(b"" if damage == "empty" else b"PK not an archive")
    with pytest.raises(DiagnosisError, match="cannot be used"):
        load(path)


SMALL = Design(
    points=2, stiff_points=0, effect_points=0, fine_points=0, finest_points=0, fine_effect_points=0, law_points=0,
    one_mesh_points=0, samples=2, vertices=100,
)  # fmt: skip


def test_atlas_build_goes_on_where_it_was(tmp_path: Path, one_thread: None) -> None:
    build(tmp_path, SMALL)
    kept, lost = (point_file(tmp_path, point, BASE) for point in (0, 1))
    before = read_point(lost).statistics
    written, designed = (path.stat().st_mtime_ns for path in (kept, tmp_path / DESIGN_FILE))
    lost.unlink()
    told: list[tuple[int, int]] = []
    build(tmp_path, SMALL, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 2), (2, 2)]
    assert kept.stat().st_mtime_ns == written
    assert (tmp_path / DESIGN_FILE).stat().st_mtime_ns == designed
    design, points = read_points(tmp_path)
    assert design == SMALL
    assert list(points[BASE]) == [0, 1]
    np.testing.assert_array_equal(points[BASE][1].statistics, before)
    with pytest.raises(DiagnosisError, match="another design"):
        build(tmp_path, replace(SMALL, samples=3))


def test_points_do_not_depend_on_what_is_made_with_them(tmp_path: Path, one_thread: None) -> None:
    """An imaging effect sees the base drapes again, whether or not these are asked for too."""
    names = [BASE, "camera-scale", "plate-radius"]
    assert make_points(tmp_path / "together", SMALL, 0, names) == len(names)
    for name in names[1:]:
        make_points(tmp_path / "alone", SMALL, 0, [name])
        alone, together = (read_point(point_file(tmp_path / part, 0, name)) for part in ("alone", "together"))
        np.testing.assert_array_equal(alone.statistics, together.statistics)
        assert not np.array_equal(
            together.statistics, read_point(point_file(tmp_path / "together", 0, BASE)).statistics
        )


def test_design_makes_what_it_says() -> None:
    design = replace(
        SMALL, points=60, stiff_points=15, effect_points=4, fine_points=8, finest_points=8, fine_effect_points=4
    )
    tasks, limp = design.tasks(), set(np.flatnonzero(design.theta()[:, 0] < LIMP))
    effects = len(registered()) - len(NOT_SIMULATED)
    finest = {*range(8), 60, 61} & limp
    assert len(tasks) == 75 + 2 * (4 + 1) * effects + (8 + 2) + len(finest)
    assert tasks[0] == (0, BASE)
    assert {point for point, name in tasks if name == FINE} == {*range(8), 60, 61}
    assert {point for point, name in tasks if name == FINEST} == finest
    assert {point for point, name in tasks if name == at_fine("creep")} == {*range(4), 60}


def test_random_values_are_within_bounds() -> None:
    generator = np.random.default_rng(0)
    for one in registered().values():
        bounds = {parameter.name: (parameter.low, parameter.high) for parameter in one.parameters}
        for _ in range(20):
            values = random_value(one, generator)
            assert values.keys() == bounds.keys()
            assert all(low <= values[name] <= high for name, (low, high) in bounds.items())


class Drifting(CameraScale):
    """A camera that has crept since the first picture, with a size of narrow bounds."""

    name = "drifting"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *CameraScale.parameters,
        Parameter("size", "m", 0.014, 0.016, 0.015, "", role="size", default=0.015),
    )

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return super()._apply(setup, value) if setup.later else setup


def test_random_values_are_within_narrow_bounds() -> None:
    generator = np.random.default_rng(0)
    assert all(0.014 <= random_value(Drifting(), generator)["size"] <= 0.016 for _ in range(20))


class Draught(CameraScale):
    """What blows from one side, and never sucks."""

    name = "draught"
    located = "direction"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("speed", "1", 0.0, 3.0, 0.5, ""),
        Parameter("direction", "deg", -360.0, 360.0, 0.0, "", role="direction"),
    )


def test_an_effect_that_is_never_negative_is_drawn_above_zero_and_looked_for_all_around() -> None:
    generator = np.random.default_rng(0)
    assert all(random_value(Draught(), generator)["speed"] >= 0.35 for _ in range(40))
    assert Hypothesis(Draught(), "lab", 1.0).turn == 360


class Numbered(Drifting):
    """It goes by the number of the picture: every second one, the later one of its face."""

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return super()._apply(setup, value) if setup.capture in (2, 4) else setup


@pytest.mark.parametrize("kind", [Drifting, Numbered])
def test_an_effect_of_the_camera_may_act_with_time(
    kind: type[Drifting], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flat = lambda setups, kept: [torch.from_numpy(setup.mesh.flat) for setup in setups]  # noqa: E731
    monkeypatch.setattr(drapes, "drape_setups", flat)
    monkeypatch.setattr(drapes, "registered", lambda: {"drifting": kind()})
    make_points(tmp_path, SMALL, 0, [BASE, "drifting"])
    before, after = (read_point(point_file(tmp_path, 0, name)) for name in (BASE, "drifting"))
    size = NAMES.index("mean_radius")
    np.testing.assert_allclose(
        after.statistics[..., size] / before.statistics[..., size], 1 + after.value[0], rtol=1e-5
    )


def _made_up_points(folder: Path, name: str, value: ndarray, fabrics: int) -> None:
    """Points of 60 fabrics without effect, and of so many with one."""
    folder.mkdir()
    (folder / DESIGN_FILE).write_text('{"points": 60, "stiff_points": 0, "effect_points": 60}')
    generator, angle = np.random.default_rng(0), np.deg2rad(np.arange(360))
    for number in range(60):
        radii = 0.12 + 0.004 * np.cos(7 * angle + generator.uniform(0, 6, (2, 2, 1)))
        radii += 0.001 * np.cos(5 * angle + generator.uniform(0, 6, (2, 2, 1)))
        write_point(point_file(folder, number, BASE), np.zeros(0), radii)
        if number < fabrics:
            write_point(point_file(folder, number, name), value, 1.01 * radii)


def test_points_of_an_effect_that_has_changed_are_refused(tmp_path: Path) -> None:
    _made_up_points(tmp_path / "a", "camera-offset", np.array([0.001]), 1)
    with pytest.raises(BadFile, match=r"camera-offset.npz: .*parameters of camera-offset, 2, got 1.*delete it"):
        read_points(tmp_path / "a")


def test_points_of_other_code_are_refused_and_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_thread: None
) -> None:
    build(tmp_path, SMALL)
    effect = registered()["camera-scale"]
    scaled = point_file(tmp_path, 0, "camera-scale")
    make_points(tmp_path, SMALL, 0, [scaled.stem])
    assert is_made(scaled)
    monkeypatch.setattr(type(effect), "version", effect.version + 1)
    assert not is_made(scaled)
    with pytest.raises(BadFile, match=r"camera-scale.npz: must be made by .* \(.*effect camera-scale 2.*"):
        read_point(scaled)
    assert len(read_points(tmp_path)[1][BASE]) == SMALL.points, "the base has no effect"

    monkeypatch.setattr(engine, "NUMERICS_VERSION", engine.NUMERICS_VERSION + 1)
    with pytest.raises(BadFile, match="repeat `cusick-bench atlas build`"):
        read_points(tmp_path)
    told: list[tuple[int, int]] = []
    build(tmp_path, SMALL, progress=lambda done, total: told.append((done, total)))
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert len(read_points(tmp_path)[1][BASE]) == SMALL.points


def test_a_fit_says_what_it_leaves_out(tmp_path: Path) -> None:
    _made_up_points(tmp_path / "a", "camera-scale", np.array([0.01]), 40)
    result = CliRunner().invoke(app, ["atlas", "fit", str(tmp_path / "a"), "--out", str(tmp_path / "fitted.npz")])
    assert result.exit_code == 0, result.output
    assert "camera-scale (40)" in result.stderr
    assert "60 fabrics are few for means of 121 terms" in result.stderr
    assert "242 would do" in result.stderr


def test_a_check_of_the_fits_that_is_stopped_leaves_the_atlas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    _made_up_points(tmp_path / "a", "camera-scale", np.array([0.01]), 40)
    monkeypatch.setattr("cusick_bench.diagnosis.atlas.response_check.unexplained", stop)
    out = tmp_path / "fitted.npz"
    result = CliRunner().invoke(app, ["atlas", "fit", str(tmp_path / "a"), "--out", str(out), "--check"])
    assert result.exit_code == 130
    assert out.exists()
    assert f"interrupted: the atlas is written to {out}, but not checked" in result.stderr
    assert "nothing was written" not in result.stderr


def test_features_without_anything() -> None:
    nothing = features(np.full((2, 2, len(NAMES)), np.nan))
    with pytest.raises(DiagnosisError, match="at least one drape"):
        against_base(load_uncalibrated()[0], nothing)


def test_range_of_the_base_model_holds_its_prior() -> None:
    assert (LOW < PRIOR_MEAN - 1.2 * PRIOR_SD).all()
