"""Skirts: sewn patterns, a moving waist, the body, draws of cloth, and the command."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy import ndarray
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.garment import (
    STILL,
    Body,
    Cloth,
    Fitting,
    GarmentError,
    Skirt,
    SkirtSize,
    WaistMotion,
    a_line_skirt,
    circular_skirt,
    cloth_of_cell,
    cloth_of_numbers,
    hang,
    spread,
    walk,
)
from cusick_bench.garment.fitting import AIR, State
from cusick_bench.garment.measurement import measure
from cusick_bench.problem import FieldSpace, StiffnessPrior
from cusick_bench.problem.field_space import CLOTH, TRAITS, cloth_tables
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.obj import read_obj
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.elements import elements_of
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError

SIZE = SkirtSize(waist=0.11, length=0.4, hem=0.25)


def _cloth(bending: float = 1e-5, spread: float = 0.0, **numbers: float) -> Cloth:
    return cloth_of_numbers(density=0.2, bending=(bending, bending, bending), spread=spread, **numbers)


def _laid(skirt: Skirt, draws: int, amplitude: float = 0.005) -> ndarray:
    fields = [smooth_field(amplitude, 0.08, np.random.default_rng(i)) for i in range(draws)]
    return np.stack([skirt.laid(field) for field in fields])


def _fitting(
    skirt: Skirt, cloth: Cloth | None = None, draws: int = 1, body: Body | None = None, drag: float = AIR
) -> Fitting:
    parameters = (cloth or _cloth()).draw(skirt.mesh, draws, np.random.default_rng(0))
    return Fitting.of(skirt, parameters, body=body, drag=drag)


# Sewn meshes


def _halves_apart(mesh: Mesh, turn: bool) -> tuple[Mesh, ndarray]:
    """A disc cut in two along its middle: the right half lies elsewhere in the pattern, turned by 90 degrees or not."""
    right = mesh.corners.mean(1)[:, 0] > 0
    pattern = mesh.corners.copy()
    moved = np.stack([-pattern[..., 1], pattern[..., 0]], -1) if turn else pattern
    pattern[right] = moved[right] + [0.7, -0.2]
    return Mesh(mesh.material, mesh.faces, pattern), right


def _forces(mesh: Mesh, stretch: ndarray, bending: ndarray) -> ndarray:
    system = DrapeSystem(mesh, "paper", 9.8, np.hypot(*mesh.material.T) < 0.05, np.zeros(mesh.vertices))
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.2 * mesh.areas / 3, 3), mesh.vertices)
    x = 1.03 * mesh.flat + np.random.default_rng(0).normal(0, 2e-3, (mesh.vertices, 3))
    return system.forces(x, x, Parameters(stretch, bending, mass, np.zeros(len(mesh.hinges))), exact=True)[0]


def test_a_seam_that_joins_what_was_one_piece_changes_nothing():
    mesh, bending = disc_mesh(150), np.array([2e-5, 1e-5, 3e-5])[None, :, None].repeat(5, 2)
    stretch = np.tile([150.0, 3.0, 90.0, 40.0], (1, 6, 1))
    expected, found = (_forces(m, stretch, bending) for m in (mesh, _halves_apart(mesh, turn=False)[0]))
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_a_panel_cut_across_the_grain_has_warp_and_weft_swapped():
    mesh, bending = disc_mesh(150), np.full((1, 3, 5), 1e-5)
    sewn, right = _halves_apart(mesh, turn=True)
    table = np.column_stack([np.full(6, 150.0), np.full(6, 3.0), np.linspace(50, 100, 6), np.full(6, 40.0)])
    swapped = table[[0, 5, 4, 3, 2, 1]][:, [2, 1, 0, 3]]
    expected = _forces(mesh, np.where(right[:, None, None], swapped, table), bending)
    found = _forces(sewn, table[None], bending)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(_forces(mesh, table[None], bending) - expected).max() > 0.01 * np.abs(expected).max()


def test_a_hinge_on_a_seam_bends_in_the_mean_direction_of_both_panels():
    mesh = disc_mesh(150)
    sewn, right = _halves_apart(mesh, turn=True)
    whole, e = elements_of(mesh), elements_of(sewn)
    direction, before = (el.direction_low + el.direction_fraction for el in (e, whole))
    sides = right[_hinge_faces(sewn)]
    seam = sides[:, 0] != sides[:, 1]
    assert seam.any()
    np.testing.assert_allclose(direction[seam], 1.0)  # d on one side, 2 - d on the other
    np.testing.assert_allclose(direction[sides.all(1)], 2 - before[sides.all(1)], atol=1e-12)
    np.testing.assert_allclose(e.hinge_weight, whole.hinge_weight, rtol=1e-9)


def _hinge_faces(mesh: Mesh) -> ndarray:
    """The two faces of every hinge, by looking for them."""
    sets = {frozenset(face): number for number, face in enumerate(mesh.faces.tolist())}
    return np.array([[sets[frozenset((a, b, c))], sets[frozenset((a, b, d))]] for a, b, c, d in mesh.hinges.tolist()])


def test_a_pattern_must_fit_the_faces():
    mesh = disc_mesh(150)
    with pytest.raises(SimulationError, match="pattern must be finite with shape"):
        Mesh(mesh.material, mesh.faces, np.full_like(mesh.corners, np.nan))
    with pytest.raises(SimulationError, match="counter-clockwise"):
        Mesh(mesh.material, mesh.faces, mesh.corners[:, ::-1])


# Cutting


@pytest.mark.parametrize("make", [circular_skirt, a_line_skirt])
def test_skirts_are_tubes_of_the_asked_size(make):
    skirt = make(SIZE, 300)
    mesh = skirt.mesh
    assert abs(mesh.vertices - 300) < 45
    assert mesh.vertices - len(mesh.edges) + len(mesh.faces) == 0  # Euler: a sheet with one hole
    rim = len(mesh.edges) - len(mesh.hinges)
    assert rim == len(skirt.hem) + skirt.waist.sum()
    waist, hem = skirt.start[skirt.waist], skirt.start[skirt.hem]
    np.testing.assert_allclose(np.hypot(*waist[:, :2].T), 0.11, atol=1e-12)
    np.testing.assert_allclose(waist[:, 2], 0, atol=1e-12)
    outer = 0.51 if make is circular_skirt else 0.25
    np.testing.assert_allclose(np.hypot(*hem[:, :2].T), outer, atol=1e-12)
    area = np.pi * (0.11 + outer) * 0.4  # mantle of a truncated cone, flat or not
    assert mesh.areas.sum() == pytest.approx(area, rel=0.02)


def test_the_a_line_cone_is_free_of_strain_up_to_its_chords():
    """A cone is developable, so edges are as long in space as in the pattern, but for arcs replaced by chords."""
    errors = []
    for vertices in (200, 800):
        skirt = a_line_skirt(SIZE, vertices)
        space, flat = skirt.start[skirt.mesh.faces], skirt.mesh.corners
        lengths = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=-1) for x in (space, flat)]
        errors.append(np.abs(lengths[0] / lengths[1] - 1).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.4 * errors[0]


def test_a_line_panels_have_their_warp_down_the_middle_of_front_and_back():
    skirt = a_line_skirt(SIZE, 400)
    corner = skirt.mesh.corners
    matrices = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], 2)
    place = skirt.start[skirt.mesh.faces]
    edges = np.stack([place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]], 2)
    warp = (edges @ np.linalg.inv(matrices))[:, :, 0]
    centre = place.mean(1)
    middle = np.abs(centre[:, 0]) < 0.02
    assert (centre[middle, 1] > 0).any()
    assert (centre[middle, 1] < 0).any()
    assert (np.abs(warp[middle, 0]) < 0.12).all()
    assert (warp[middle, 2] < -0.8).all()


# Mechanics


@pytest.mark.parametrize("draws", [1, 2])
def test_on_a_still_waist_the_steps_are_those_of_a_drop(draws: int):
    skirt = circular_skirt(SIZE, 180)
    fitting = _fitting(skirt, _cloth(spread=0.2), draws, drag=0.0)
    laid = _laid(skirt, draws)
    expected = drop(fitting.system, fitting.parameters, laid, steps=10, step_seconds=0.05).positions[-1]
    state = fitting.start(laid)
    for _ in range(10):
        state, _ = fitting.step(state, STILL, 0.05)
    np.testing.assert_allclose(state.positions, expected, atol=1e-9)


@dataclass(frozen=True)
class Gliding(WaistMotion):
    """A waist that glides and turns not."""

    def pose(self, time: float) -> tuple[ndarray, ndarray]:
        return np.eye(3), np.array([0.7, -0.4, 0.0]) * time


def test_a_gliding_skirt_falls_as_one_at_rest_does():
    skirt = a_line_skirt(SIZE, 180)
    fitting = _fitting(skirt, body=Body(hip=0.13), drag=0.0)
    laid, glide = _laid(skirt, 1), Gliding()
    still, moving = fitting.start(laid), State(laid, np.broadcast_to([0.7, -0.4, 0.0], laid.shape).copy())
    for _ in range(12):
        still, _ = fitting.step(still, STILL, 0.03)
        moving, _ = fitting.step(moving, glide, 0.03)
    np.testing.assert_allclose(moving.positions - glide.pose(0.36)[1], still.positions, atol=1e-8)
    assert np.abs(still.positions - laid).max() > 0.02


def test_in_thick_air_the_hem_sinks_at_its_terminal_speed():
    skirt = circular_skirt(SIZE, 180)
    fitting = _fitting(skirt, drag=100.0)
    state = fitting.start(skirt.start[None])
    for _ in range(20):
        state, _ = fitting.step(state, STILL, 0.01)
    np.testing.assert_allclose(state.velocities[0, skirt.hem, 2], -9.8 / 100.0, rtol=0.02)


def test_air_holds_back_a_skirt_that_is_carried_along():
    skirt = a_line_skirt(SIZE, 180)
    trails = []
    for drag in (0.0, 10.0):
        state = State(skirt.start[None], np.broadcast_to([0.7, -0.4, 0.0], (1, *skirt.start.shape)).copy())
        for _ in range(5):
            state, _ = _fitting(skirt, drag=drag).step(state, Gliding(), 0.02)
        trails.append(state.positions[0, skirt.hem].mean(0)[:2] - skirt.start[skirt.hem].mean(0)[:2])
    held_back = (trails[0] - trails[1]) @ [0.7, -0.4]
    assert held_back > 0.005


def test_a_skirt_of_twice_the_size_of_cloth_as_stiff_for_its_size_hangs_alike():
    """Lengths by 2: bending by 8, membrane stiffness by 2, time by sqrt 2; then every step is the same."""
    small, big = (circular_skirt(SkirtSize(0.11 * s, 0.4 * s, 0.25 * s), 180) for s in (1, 2))
    ends = []
    for skirt, s in ((small, 1), (big, 2)):
        fitting = _fitting(skirt, _cloth(bending=1e-5 * s**3, stretch=300.0 * s, shear=60.0 * s), drag=0.0)
        state = fitting.start(s * _laid(small, 1))
        for _ in range(15):
            state, _ = fitting.step(state, STILL, 0.04 * np.sqrt(s))
        ends.append(state.positions / s)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)


def test_cloth_slides_over_the_body_and_stays_outside():
    skirt, body = a_line_skirt(SIZE, 250), Body(hip=0.14)
    rest, resting = hang(_fitting(skirt, _cloth(3e-6), body=body), _laid(skirt, 1), seconds=12.0)
    without, _ = hang(_fitting(skirt, _cloth(3e-6)), _laid(skirt, 1), seconds=12.0)
    free = ~skirt.waist
    assert resting.all()
    assert body.depth(rest.positions[0, free])[0].max() < 1e-3
    assert body.depth(without.positions[0, free])[0].max() > 0.01
    assert (body.depth(rest.positions[0, free])[0] > 0).any()  # it is worn, not hung in the air


def test_the_normal_of_the_body_is_the_gradient_of_its_depth():
    body = Body(waist=0.1, hip=0.16, hip_depth=0.2)
    points = np.random.default_rng(0).uniform([-0.2, -0.2, -0.25], [0.2, 0.2, -0.001], (50, 3))
    at = np.hypot(*points[:, :2].T)
    points[:, :2] *= (body.radius(points[:, 2]) / at)[:, None]  # on the surface, where depth is a distance
    depth, normal = body.depth(points)
    np.testing.assert_allclose(depth, 0, atol=1e-12)
    for axis in range(3):
        step = 1e-7 * np.eye(3)[axis]
        slope = (body.depth(points + step)[0] - body.depth(points - step)[0]) / 2e-7
        np.testing.assert_allclose(slope, -normal[:, axis], atol=1e-6)


def test_a_twirl_pulls_every_vertex_outwards_by_its_radius():
    skirt = circular_skirt(SIZE, 180)
    fitting, laid, h = _fitting(skirt), _laid(skirt, 1), 1e-6
    still, twirled = (fitting.step(fitting.start(laid), STILL, h, twirl=twirl)[0].velocities for twirl in (0.0, 5.0))
    expected = np.where(skirt.waist[:, None], 0.0, h * 5.0**2 * laid[0] * [1, 1, 0])
    np.testing.assert_allclose((twirled - still)[0], expected, atol=1e-3 * h)


def test_a_step_in_which_cloth_flies_past_itself_is_made_in_parts():
    skirt = circular_skirt(SIZE, 180)
    fitting, laid = _fitting(skirt), _laid(skirt, 1)
    slow, fast = (State(laid, np.where(skirt.waist[:, None], 0.0, [0, 0, -v]) * np.ones_like(laid)) for v in (0.1, 40))
    np.testing.assert_array_equal(
        fitting.advance(slow, STILL, 0.02)[0].positions, fitting.step(slow, STILL, 0.02)[0].positions
    )
    parts = fast
    for _ in range(8):
        parts, _ = fitting.step(parts, STILL, 0.02 / 8)
    np.testing.assert_array_equal(fitting.advance(fast, STILL, 0.02)[0].positions, parts.positions)


def test_a_limp_skirt_comes_to_rest_lower_and_with_no_hem_tucked_under(monkeypatch: pytest.MonkeyPatch):
    skirt, cloth = circular_skirt(SIZE, 700), _cloth(1e-6)
    fitting, laid = _fitting(skirt, cloth, draws=2), _laid(skirt, 2)
    rest, resting = hang(fitting, laid)
    monkeypatch.setattr("cusick_bench.garment.fitting.TWIRL", 0.0)
    dropped, _ = hang(fitting, laid)
    assert resting.all()

    def energy(x: ndarray) -> ndarray:
        return fitting.system.evaluate(x, x, fitting.parameters, exact=False).energy()

    assert (energy(rest.positions) < energy(dropped.positions)).all()
    highest = rest.positions[:, skirt.hem, 2].max(1)  # of the hem
    assert (highest < -0.7 * SIZE.length).all()
    assert (dropped.positions[:, skirt.hem, 2].max(1) > highest).all()


def test_the_waist_follows_its_motion_and_the_hem_trails_behind():
    skirt = a_line_skirt(SIZE, 180)
    fitting = _fitting(skirt, body=Body(hip=0.13))
    rest, _ = hang(fitting, _laid(skirt, 1))
    motion = WaistMotion(sway=0.06, turn=0.5, period=1.0, seconds=1.5)
    times, frames = walk(fitting, rest, motion, settle=0.1)
    assert times[-1] == pytest.approx(1.6)
    for time, x in zip(times, frames[:, 0], strict=True):
        rotation, shift = motion.pose(time)
        np.testing.assert_allclose(x[skirt.waist], skirt.start[skirt.waist] @ rotation.T + shift, atol=1e-12)
    waist, hem = (frames[:, 0, part].mean(1)[:, 0] for part in (np.flatnonzero(skirt.waist), skirt.hem))
    assert np.ptp(waist) > 0.08
    assert np.abs(hem - hem[0] - waist + waist[0]).max() > 0.01
    np.testing.assert_array_equal(motion.pose(2.0)[0], np.eye(3))
    np.testing.assert_array_equal(motion.pose(2.0)[1], 0)


def test_a_turning_waist_spreads_the_skirt():
    skirt = circular_skirt(SIZE, 180)
    fitting = _fitting(skirt, body=Body(hip=0.13))
    rest, _ = hang(fitting, _laid(skirt, 1))
    _, frames = walk(fitting, rest, WaistMotion(turn=3.0, period=1.6, seconds=1.6), settle=0.0)
    radius = np.hypot(*np.moveaxis(frames[:, 0, skirt.hem, :2], -1, 0)).mean(-1)
    assert radius.max() > radius[0] + 0.02


def test_limp_cloth_hangs_close_and_in_more_folds_than_stiff_cloth():
    skirt = circular_skirt(SIZE, 350)
    found = []
    for bending in (3e-6, 2e-3):
        rest, _ = hang(_fitting(skirt, _cloth(bending)), _laid(skirt, 1), seconds=6.0, step_seconds=0.04)
        found.append(measure(skirt, rest.positions[0]))
    assert found[0].hem_radius_m < 0.8 * found[1].hem_radius_m
    assert found[0].folds > found[1].folds
    assert found[0].projected_area_m2 < 0.7 * found[1].projected_area_m2
    assert found[0].hem_depth_m > found[1].hem_depth_m


# Numbers


def test_a_flat_skirt_has_a_drape_coefficient_of_one_and_no_folds():
    skirt = circular_skirt(SIZE, 2000)
    found = measure(skirt, skirt.start)
    assert found.drape_coefficient == pytest.approx(1, abs=0.005)
    assert found.hem_radius_m == pytest.approx(0.51)
    assert found.projected_area_m2 == pytest.approx(np.pi * 0.51**2, rel=0.005)
    assert (found.folds, found.hem_depth_m) == (0, 0)


def test_a_skirt_that_hangs_straight_down_has_a_drape_coefficient_of_zero():
    skirt = circular_skirt(SIZE, 1000)
    radius = np.hypot(*skirt.start[:, :2].T)
    x = np.column_stack([skirt.start[:, :2] * (0.11 / radius)[:, None], 0.11 - radius])
    found = measure(skirt, x)
    assert found.drape_coefficient == pytest.approx(0, abs=0.005)
    assert (found.hem_radius_m, found.hem_depth_m) == pytest.approx((0.11, 0.4))


@pytest.mark.parametrize("folds", [3, 11])
def test_folds_of_a_waved_hem_are_counted(folds: int):
    skirt = circular_skirt(SIZE, 2000)
    angle = np.arctan2(skirt.start[:, 1], skirt.start[:, 0])
    x = skirt.start.copy()
    x[:, :2] *= (0.6 + 0.1 * np.cos(folds * angle))[:, None]
    found = measure(skirt, x)
    assert found.folds == folds
    assert found.fold_amplitude_m == pytest.approx(0.051 / np.sqrt(2), rel=0.02)


def test_the_spread_of_draws_that_differ_by_a_known_shift():
    skirt = circular_skirt(SIZE, 200)
    x = skirt.start + np.array([-0.01, 0.0, 0.01])[:, None, None] * [0, 0, 1]
    found = spread(x, [measure(skirt, each) for each in x])
    assert found["vertex_sd_rms_m"] == pytest.approx(0.01)
    assert found["sd"]["hem_depth_m"] == pytest.approx(0.01)
    assert found["sd"]["hem_radius_m"] == pytest.approx(0)
    assert np.isnan(spread(x[:1], [measure(skirt, x[0])])["vertex_sd_rms_m"])


# Cloth


def test_draws_scatter_every_entry_of_every_element_about_the_median():
    mesh = circular_skirt(SIZE, 400).mesh
    p = _cloth(spread=0.3).draw(mesh, 3, np.random.default_rng(1))
    logs = np.log(p.bending / 1e-5)
    assert logs.shape == (3, len(mesh.hinges), 3, 5)
    assert logs.mean() == pytest.approx(0, abs=0.01)
    assert logs.std() == pytest.approx(0.3, rel=0.03)
    assert np.corrcoef(logs[0, :, 0, 0], logs[0, :, 0, 1])[0, 1] == pytest.approx(0, abs=0.12)
    assert p.mass.sum(1) == pytest.approx(0.2 * mesh.areas.sum())


def test_drawn_stretch_tables_are_positive_definite():
    cloth = replace(_cloth(), stretch=np.tile([10.0, 9.0, 10.0, 5.0], (1, 6, 1)), stretch_sd=np.full((6, 4), 1.0))
    c = cloth.draw(circular_skirt(SIZE, 200).mesh, 2, np.random.default_rng(0)).stretch
    assert (c[..., 0] * c[..., 2] > c[..., 1] ** 2).all()


def _cell(folder: Path, *, law: str = "paper", **arrays: ndarray) -> Path:
    folder.mkdir()
    record = {"cloth": "wool_red", "solver": "homo", "settings": {"drape": {"law": law}}}
    (folder / "cell.json").write_text(json.dumps(record))
    tables = {"stretch": np.tile([150.0, 1.0, 150.0, 30.0], (6, 1)), "bending": np.full((3, 5), 2e-5)}
    np.savez_compressed(
        folder / "prediction.npz", allow_pickle=False, **({**tables, "density": np.array(0.27)} | arrays)
    )
    return folder


def _posterior(**changes: ndarray) -> dict[str, ndarray]:
    return {"posterior_mean": np.zeros(39), "posterior_scale": np.full(39, 0.4)} | changes


def test_a_fit_of_shared_tables_is_scattered_by_the_given_spread(tmp_path: Path):
    cloth = cloth_of_cell(_cell(tmp_path / "a"), spread=0.2)
    assert (cloth.name, cloth.source, cloth.density) == ("wool_red", "spread", 0.27)
    assert (cloth.bending_sd == 0.2).all()
    np.testing.assert_array_equal(cloth.bending, np.full((1, 3, 5), 2e-5))


@pytest.mark.parametrize(("found_by", "hangs_by"), [("plate", "paper"), ("paper", "paper"), ("published", "published")])
def test_tables_of_law_plate_hang_by_law_paper(found_by: str, hangs_by: str, tmp_path: Path):
    cloth = cloth_of_cell(_cell(tmp_path / "a", law=found_by))
    assert cloth.law == hangs_by
    np.testing.assert_array_equal(cloth.bending, np.full((1, 3, 5), 2e-5))


def test_a_result_of_an_unknown_law_is_refused(tmp_path: Path):
    with pytest.raises(GarmentError, match="law must be plate, paper or published, got 'silk'"):
        cloth_of_cell(_cell(tmp_path / "a", law="silk"))


def test_a_posterior_brings_its_own_median_and_spread(tmp_path: Path):
    cloth = cloth_of_cell(_cell(tmp_path / "a", **_posterior()), spread=0.2)
    assert cloth.source == "posterior"
    prior = StiffnessPrior("paper", 0.27)
    logs = np.log(cloth.draw(circular_skirt(SIZE, 600).mesh, 2, np.random.default_rng(0)).bending).reshape(-1, 15)
    assert logs.mean(0) == pytest.approx(prior.bending_median.ravel(), abs=0.05)
    expected = 0.4 * np.sqrt((prior.bending_root**2).sum(1))
    assert logs.std(0) == pytest.approx(expected, rel=0.1)


def test_every_garment_is_of_one_cloth_of_a_posterior_over_cloths(tmp_path: Path):
    cloths = np.zeros((3, CLOTH))
    cloths[:, FieldSpace.trait_entry("bending")] = [-1.0, 0.0, 1.0]
    cloth = cloth_of_cell(_cell(tmp_path / "a", law="plate", posterior_cloths=cloths), spread=0.0)
    assert cloth.source == "cloths"
    drawn = cloth.draw(circular_skirt(SIZE, 200).mesh, 40, np.random.default_rng(0))
    assert (drawn.bending == drawn.bending[:, :1]).all()  # the same all over a garment
    levels, counts = np.unique(np.log(drawn.bending[:, 0, 0, 0]).round(9), return_counts=True)
    assert np.diff(levels) == pytest.approx([TRAITS["bending"].sd] * 2)
    assert counts.min() > 4
    stiff = drawn.bending[:, 0, 0, 0].argmax()
    assert drawn.bending[stiff, 0] == pytest.approx(cloth.bending[2])
    scattered = cloth.spread_by(0.3).draw(circular_skirt(SIZE, 400).mesh, 2, np.random.default_rng(0))
    assert np.log(scattered.bending).std(1) == pytest.approx(0.3, rel=0.15)


def test_tables_of_cloths_are_those_of_specimens_without_fields():
    space = FieldSpace(disc_mesh(100), StiffnessPrior("paper", 0.2))
    tau = torch.zeros(space.dimension, dtype=torch.float64)
    tau[: len(tau) // 10] = torch.linspace(-1, 1, len(tau) // 10)
    tau[space.specimen_level.start :] = 0
    material = space.specimen(tau).material
    stretch, bending = cloth_tables(space.prior, tau[None, :CLOTH])
    np.testing.assert_allclose(material.stretch, stretch.expand_as(material.stretch), rtol=1e-12)
    np.testing.assert_allclose(material.bending, bending.expand_as(material.bending), rtol=1e-12)


def test_tables_per_element_are_dealt_out_at_random(tmp_path: Path):
    levels = np.array([1e-5, 2e-5, 4e-5, 8e-5])
    cloth = cloth_of_cell(_cell(tmp_path / "a", bending=levels[:, None, None] * np.ones((4, 3, 5))))
    assert cloth.source == "elements"
    drawn = cloth.draw(circular_skirt(SIZE, 300).mesh, 1, np.random.default_rng(0)).bending[0]
    assert (drawn == drawn[:, :1, :1]).all()
    share = (drawn[:, 0, 0] == levels[:, None]).mean(1)
    assert share.sum() == 1
    assert (np.abs(share - 0.25) < 0.06).all()


def test_a_strained_garment_has_the_stretch_stiffness_that_the_fit_has_at_rest(tmp_path: Path):
    fits = {"one": {"stretch": np.arange(1.0, 25.0).reshape(6, 4)}, "posterior": _posterior()}
    fits["cloths"] = {"posterior_cloths": np.random.default_rng(0).normal(size=(3, CLOTH))}
    for name, arrays in fits.items():
        stretch = cloth_of_cell(_cell(tmp_path / name, **arrays)).stretch
        np.testing.assert_array_equal(stretch, np.broadcast_to(stretch[:, :1], stretch.shape))
        assert name != "one" or stretch[0, 0].tolist() == [1, 2, 3, 4]


BAD_CELLS = {
    "no stretch, bending": {"stretch": None, "bending": None},
    "posterior is of another problem": _posterior(posterior_scale=np.ones(15)),
    "posterior_scale must be finite and >= 0": _posterior(posterior_scale=np.full(39, -1.0)),
    "belongs to another problem": {"bending": np.ones((5, 3))},
    "belong to another problem": {"stretch": np.ones((7, 6, 4)), "faces": np.zeros((9, 3), int)},
    "posterior_cloths must be finite": {"posterior_cloths": np.zeros((4, 7))},
    "positive stiffness": {"bending": np.full((3, 5), np.nan)},
    "areal density must be": {"density": np.array(0.0)},
}


@pytest.mark.parametrize("message", BAD_CELLS)
def test_a_result_that_is_no_cloth_is_refused(message: str, tmp_path: Path):
    folder = _cell(tmp_path / "a", **{key: value for key, value in BAD_CELLS[message].items() if value is not None})
    if message.startswith("no stretch"):
        np.savez_compressed(folder / "prediction.npz", train_image=np.zeros((4, 4)), density=np.array(0.2))
    with pytest.raises(GarmentError, match=message):
        cloth_of_cell(folder)


def test_a_damaged_or_hostile_prediction_is_refused(tmp_path: Path):
    folder = _cell(tmp_path / "a")
    whole = (folder / "prediction.npz").read_bytes()
    (folder / "prediction.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GarmentError, match="cannot read"):
        cloth_of_cell(folder)
    np.savez(folder / "prediction.npz", stretch=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(GarmentError, match="cannot read"):
        cloth_of_cell(folder)
    (folder / "prediction.npz").unlink()
    with pytest.raises(GarmentError, match="no prediction"):
        cloth_of_cell(folder)


# The command

NUMBERS = ["--density", "0.2", "--bending", "1e-5"]
SMALL = ["--vertices", "160", "--length", "0.3", "--hem", "0.2", "--hip", "0.13"]


def _run(*arguments: str):
    return CliRunner().invoke(app, ["garment", "skirt", *arguments])


def test_command_writes_meshes_pictures_motion_and_numbers(tmp_path: Path):
    result = _run(
        *NUMBERS, *SMALL, "--kind", "a-line", "--draws", "2", "--dynamic", "--duration", "0.4", "--out",
        str(tmp_path / "out"), "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    folder = tmp_path / "out"
    assert json.loads((folder / "summary.json").read_text())["spread"] == document["spread"]
    assert [draw["draw"] for draw in document["draws"]] == [0, 1]
    assert 0.1 < document["spread"]["mean"]["hem_radius_m"] < 0.2
    assert document["spread"]["vertex_sd_rms_m"] > 0
    positions, faces = read_obj(folder / "draw_0001.obj")
    assert len(positions) == document["vertices"]
    assert len(faces) == document["faces"]
    with np.load(folder / "motion.npz") as motion:
        assert motion["positions"].shape == (document["motion"]["frames"], 2, document["vertices"], 3)
        np.testing.assert_allclose(motion["positions"][0, 1], positions, atol=1e-5)
    for name in ("draw_0000.png", "draw_0000_above.png", "draw_0000_front.png", "turntable.png", "motion.png"):
        with Image.open(folder / name) as picture:
            assert np.asarray(picture.convert("L")).min() < 200  # not empty
    with Image.open(folder / "turntable.gif") as animation:
        assert sum(1 for _ in ImageSequence.Iterator(animation)) == 18


def test_command_gives_the_same_numbers_for_the_same_seed_and_others_for_another(tmp_path: Path):
    cell = str(_cell(tmp_path / "a", **_posterior()))
    same, again, other = (
        json.loads(_run("--from", cell, *SMALL, "--draws", "2", "--seed", seed, "--json").stdout)
        for seed in ("3", "3", "4")
    )
    assert same["draws"] == again["draws"] != other["draws"]
    assert same["draws"][0] != dict(same["draws"][1], draw=0)
    assert same["stiffness_from"] == "posterior"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give either --from RESULT"),
        (["--from", "nowhere", *NUMBERS], "give either --from RESULT"),
        (["--from", "nowhere"], "no result at nowhere"),
        (["--density", "0.2"], "both --density and --bending"),
        (["--density", "-1", "--bending", "1e-5"], "areal density must be from 0.005 to 5.0 kg/m2, got -1"),
        (["--density", "0.2", "--bending", "1,2"], "one number or three"),
        ([*NUMBERS, "--law", "plate"], "skirts hang by law paper"),
        ([*NUMBERS, "--law", "published"], "tables are for law paper"),
        ([*NUMBERS, "--draws", "0"], "number of draws must be at least 1"),
        ([*NUMBERS, "--waist", "0.3"], "wider than its waist"),
        ([*NUMBERS, "--length", "-1"], "length must be > 0"),
        ([*NUMBERS, "--kind", "a-line", "--hip", "0.4"], "must fit into the skirt"),
        ([*NUMBERS, "--hip", "0.05"], "waist <= hip"),
        ([*NUMBERS, "--vertices", "20"], "at least 150 vertices"),
        ([*NUMBERS, "--heterogeneity", "-0.1"], "spread of log stiffness"),
        ([*NUMBERS, "--dynamic", "--period", "0"], "period and duration > 0"),
    ],
)
def test_command_refuses_bad_input(arguments: list[str], message: str):
    result = _run(*arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
