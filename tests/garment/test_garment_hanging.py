"""Skirts on a waist: steps, air, the body, coming to rest, a moving waist."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy import ndarray
from worn_skirts import SIZE, fitted_skirts, laid_skirts, skirt_cloth

from cusick_bench.garment import (
    STILL,
    Body,
    Fitting,
    GarmentError,
    SkirtSize,
    WaistMotion,
    a_line_skirt,
    circular_skirt,
    hang,
    walk,
)
from cusick_bench.garment.fitting import AT_REST, State
from cusick_bench.garment.measurement import measure
from cusick_bench.sim.engine.dynamics.drop import drop


@pytest.mark.parametrize("draws", [1, 2])
def test_on_a_still_waist_the_steps_are_those_of_a_drop(draws: int):
    skirt = circular_skirt(SIZE, 180)
    fitting = fitted_skirts(skirt, skirt_cloth(spread=0.2), draws, drag=0.0)
    laid = laid_skirts(skirt, draws)
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
    fitting = fitted_skirts(skirt, body=Body(hip=0.13), drag=0.0)
    laid, glide = laid_skirts(skirt, 1), Gliding()
    still, moving = fitting.start(laid), State(laid, np.broadcast_to([0.7, -0.4, 0.0], laid.shape).copy())
    for _ in range(12):
        still, _ = fitting.step(still, STILL, 0.03)
        moving, _ = fitting.step(moving, glide, 0.03)
    np.testing.assert_allclose(moving.positions - glide.pose(0.36)[1], still.positions, atol=1e-8)
    assert np.abs(still.positions - laid).max() > 0.02


def about_the_axis(angle: float) -> ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])


@dataclass(frozen=True)
class Spinning(WaistMotion):
    """A waist that turns evenly, without end."""

    def pose(self, time: float) -> tuple[ndarray, ndarray]:
        return about_the_axis(5.0 * time), np.zeros(3)


def test_a_skirt_that_turns_with_its_waist_hangs_as_in_a_twirl_the_better_the_shorter_the_steps():
    """Cloth that turns evenly is held out by its inertia; steps are straight: the error falls with their size."""
    skirt = circular_skirt(SIZE, 180)
    fitting = fitted_skirts(skirt, drag=0.0)
    twirled = fitting.start(laid_skirts(skirt, 1))
    for _ in range(200):
        twirled, _ = fitting.step(twirled, STILL, 0.04, twirl=5.0)
    errors = []
    for h in (0.02, 0.01):
        turned = State(twirled.positions, 5.0 * np.cross([0, 0, 1.0], twirled.positions))
        for _ in range(round(0.6 / h)):
            turned, _ = fitting.step(turned, Spinning(), h)
        errors.append(np.abs(turned.positions @ Spinning().pose(0.6)[0] - twirled.positions)[0, skirt.hem].mean())
    assert errors[0] < 0.02
    assert errors[1] < 0.65 * errors[0]


@dataclass(frozen=True)
class Turned(WaistMotion):
    """A waist that stands still, turned by 2 rad."""

    def pose(self, time: float) -> tuple[ndarray, ndarray]:
        return about_the_axis(2.0), np.zeros(3)


def test_a_turned_wearer_wears_the_skirt_as_one_who_faces_the_front():
    skirt, body = a_line_skirt(SIZE, 180), Body(hip=0.15)
    fitting, laid, turn = fitted_skirts(skirt, skirt_cloth(3e-6), body=body), laid_skirts(skirt, 1), Turned().pose(0)[0]
    front, turned = fitting.start(laid), fitting.start(laid @ turn.T)
    for _ in range(25):
        front, _ = fitting.step(front, STILL, 0.03)
        turned, _ = fitting.step(turned, Turned(), 0.03)
    np.testing.assert_allclose(turned.positions @ turn, front.positions, atol=1e-8)
    assert (body.depth(front.positions[0, ~skirt.waist])[0] > 0).any()  # it lies on the hips


def test_in_thick_air_the_hem_sinks_at_its_terminal_speed():
    skirt = circular_skirt(SIZE, 180)
    fitting = fitted_skirts(skirt, drag=100.0)
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
            state, _ = fitted_skirts(skirt, drag=drag).step(state, Gliding(), 0.02)
        trails.append(state.positions[0, skirt.hem].mean(0)[:2] - skirt.start[skirt.hem].mean(0)[:2])
    held_back = (trails[0] - trails[1]) @ [0.7, -0.4]
    assert held_back > 0.005


def test_a_skirt_of_twice_the_size_of_cloth_as_stiff_for_its_size_hangs_alike():
    """Lengths by 2: bending by 8, membrane stiffness by 2, time by sqrt 2; then every step is the same."""
    small, big = (circular_skirt(SkirtSize(0.11 * s, 0.4 * s, 0.25 * s), 180) for s in (1, 2))
    ends = []
    for skirt, s in ((small, 1), (big, 2)):
        fitting = fitted_skirts(skirt, skirt_cloth(bending=1e-5 * s**3, stretch=300.0 * s, shear=60.0 * s), drag=0.0)
        state = fitting.start(s * laid_skirts(small, 1))
        for _ in range(15):
            state, _ = fitting.step(state, STILL, 0.04 * np.sqrt(s))
        ends.append(state.positions / s)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)


def test_cloth_slides_over_the_body_and_stays_outside():
    skirt, body = a_line_skirt(SIZE, 250), Body(hip=0.14)
    rest, resting = hang(fitted_skirts(skirt, skirt_cloth(3e-6), body=body), laid_skirts(skirt, 1), seconds=12.0)
    without, _ = hang(fitted_skirts(skirt, skirt_cloth(3e-6)), laid_skirts(skirt, 1), seconds=12.0)
    free = ~skirt.waist
    assert resting.all()
    assert body.depth(rest.positions[0, free])[0].max() < 1e-3
    assert body.depth(without.positions[0, free])[0].max() > 0.01
    assert (body.depth(rest.positions[0, free])[0] > 0).any()  # it is worn, not hung in the air


def test_cloth_that_flies_at_the_body_stops_at_its_surface_within_a_step():
    """Neither inside, where it would end by its velocity, nor thrown back."""
    skirt, body, h = a_line_skirt(SIZE, 180), Body(hip=0.13), 0.02
    fitting = fitted_skirts(skirt, skirt_cloth(3e-6), body=body)
    outside, normal = body.depth(skirt.start)
    inwards = np.where(skirt.waist[:, None], 0.0, (outside - 0.02)[:, None] * normal / h)
    state, _ = fitting.step(State(skirt.start[None], inwards[None]), STILL, h)
    depth, _ = body.depth(state.positions[0, ~skirt.waist])
    assert body.depth(skirt.start + h * inwards)[0].max() > 0.015
    assert depth.max() < 2e-3
    assert np.median(depth) > -0.01


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
    fitting, laid, h = fitted_skirts(skirt), laid_skirts(skirt, 1), 1e-6
    still, twirled = (fitting.step(fitting.start(laid), STILL, h, twirl=twirl)[0].velocities for twirl in (0.0, 5.0))
    expected = np.where(skirt.waist[:, None], 0.0, h * 5.0**2 * laid[0] * [1, 1, 0])
    np.testing.assert_allclose((twirled - still)[0], expected, atol=1e-3 * h)


def test_a_step_in_which_cloth_flies_past_itself_is_made_in_parts():
    skirt = circular_skirt(SIZE, 180)
    fitting, laid = fitted_skirts(skirt), laid_skirts(skirt, 1)
    slow, fast = (State(laid, np.where(skirt.waist[:, None], 0.0, [0, 0, -v]) * np.ones_like(laid)) for v in (0.1, 40))
    np.testing.assert_array_equal(
        fitting.advance(slow, STILL, 0.02)[0].positions, fitting.step(slow, STILL, 0.02)[0].positions
    )
    parts = fast
    for _ in range(8):
        parts, _ = fitting.step(parts, STILL, 0.02 / 8)
    np.testing.assert_array_equal(fitting.advance(fast, STILL, 0.02)[0].positions, parts.positions)


def test_a_limp_skirt_comes_to_rest_lower_and_with_no_hem_tucked_under(monkeypatch: pytest.MonkeyPatch):
    skirt, cloth = circular_skirt(SIZE, 700), skirt_cloth(1e-6)
    fitting, laid = fitted_skirts(skirt, cloth, draws=2), laid_skirts(skirt, 2)
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
    fitting = fitted_skirts(skirt, body=Body(hip=0.13))
    rest, _ = hang(fitting, laid_skirts(skirt, 1))
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
    fitting = fitted_skirts(skirt, body=Body(hip=0.13))
    rest, _ = hang(fitting, laid_skirts(skirt, 1))
    _, frames = walk(fitting, rest, WaistMotion(turn=3.0, period=1.6, seconds=1.6), settle=0.0)
    radius = np.hypot(*np.moveaxis(frames[:, 0, skirt.hem, :2], -1, 0)).mean(-1)
    assert radius.max() > radius[0] + 0.02


@pytest.mark.parametrize("seconds", [1.3, 1.65])
def test_a_motion_begins_and_ends_at_rest_wherever_in_its_period(seconds: float):
    motion, step = WaistMotion(sway=0.1, turn=1.0, period=1.2, seconds=seconds), 1e-4
    for time in (0.0, seconds):
        before, after = (motion.pose(time + sign * step) for sign in (-1, 1))
        assert np.abs(after[1] - before[1]).max() < 1e-2 * step  # [m/s] times a step; in between .5 m/s
        assert np.abs(after[0] - before[0]).max() < 1e-1 * step


def test_skirts_that_a_twirl_holds_up_do_not_rest_however_slow_they_are():
    skirt = circular_skirt(SIZE, 180)
    state, resting = hang(fitted_skirts(skirt), laid_skirts(skirt, 1), seconds=1e-6, step_seconds=1e-6)
    assert state.speeds().max() < AT_REST
    assert not resting.any()


def test_cloths_of_another_skirt_and_senseless_numbers_are_refused():
    skirt, other = circular_skirt(SIZE, 180), circular_skirt(SIZE, 250)
    fitting, laid = fitted_skirts(skirt, draws=2), laid_skirts(skirt, 2)
    p, still = fitting.parameters, State(laid, np.zeros_like(laid))
    for refused, message in (
        (lambda: Fitting.of(other, p), r"batch with stretch of shape \(2, 4\d\d, 6, 4\), got \(2, 3\d\d, 6, 4\); draw"),
        (lambda: Fitting.of(skirt, p.member(0)), "cloths of this skirt must be a batch"),
        (lambda: Fitting.of(skirt, p, drag=-1.0), "drag of the air must be >= 0 1/s and finite, got -1"),
        (lambda: Fitting.of(skirt, p, gravity=-9.8), "gravity must be > 0 m/s2 and finite, got -9.8"),
        (lambda: hang(fitting, laid[:1]), r"finite with shape \(2, 194, 3\), got shape \(1, 194, 3\)"),
        (lambda: hang(fitting, np.nan * laid), r"finite with shape \(2, 194, 3\), got NaN"),
        (lambda: hang(fitting, laid, seconds=np.nan), "seconds must be > 0 s and finite, got nan"),
        (lambda: hang(fitting, laid, step_seconds=-0.02), "step_seconds must be > 0 s and finite, got -0.02"),
        (lambda: walk(fitting, State(laid[:1], 0 * laid[:1]), WaistMotion()), "positions of the skirts must be"),
        (lambda: walk(fitting, still, WaistMotion(), step_seconds=0.0), "step_seconds must be > 0 s"),
        (lambda: walk(fitting, still, WaistMotion(), settle=-1.0), "settle must be >= 0 s and finite"),
        (lambda: walk(fitting, still, WaistMotion(), every=0), "every >= 1, got 0.8 s and 0"),
    ):
        with pytest.raises(GarmentError, match=message):
            refused()


def test_limp_cloth_hangs_close_and_in_more_folds_than_stiff_cloth():
    skirt = circular_skirt(SIZE, 350)
    found = []
    for bending in (3e-6, 2e-3):
        rest, _ = hang(
            fitted_skirts(skirt, skirt_cloth(bending)), laid_skirts(skirt, 1), seconds=6.0, step_seconds=0.04
        )
        found.append(measure(skirt, rest.positions[0]))
    assert found[0].hem_radius_m < 0.8 * found[1].hem_radius_m
    assert found[0].folds > found[1].folds
    assert found[0].projected_area_m2 < 0.7 * found[1].projected_area_m2
    assert found[0].hem_depth_m > found[1].hem_depth_m
