"""Every world: nulls with folds that look like cloth, the same bytes from the same seed, effects that show."""

import json
from functools import cache
from itertools import islice

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.suite.design import DRAWN, EFFECTS, MULTIPLES, OUTSIDE, plan_suite
from cusick_bench.withheld.world.photograph import PIXEL
from cusick_bench.withheld.world.registry import DEFAULT, WORLDS, world_of
from cusick_bench.withheld.world.true_case import TrueCase

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

SMALL = {"paper": (150, 30), "published": (200, 30), "polar": (72, 25)}
"""Mesh size and number of steps at which a drop takes a fraction of a second and has folds."""


@cache
def pictures(world, *causes, seed=3, count=2):
    """The first pictures of a case: one face twice, then the other face twice, sample after sample."""
    vertices, steps = SMALL[world]
    named = {name: dict(value) for name, value in causes}
    return list(islice(TrueCase((seed, 2), named, vertices, steps, world_name=world).pictures(2), count))


def drape_coefficient(picture):
    covered = (255 - picture.levels.astype(float)).sum() / 255 * PIXEL**2
    return (covered / np.pi - PLATE_RADIUS**2) / (CLOTH_RADIUS**2 - PLATE_RADIUS**2)


def rim_waves(picture, directions=120):
    """Amplitudes of the harmonics of the outline's radius [m]."""
    y, x = np.mgrid[:256, :256] - 127.5
    sector = np.floor(np.arctan2(-y, x) / (2 * np.pi) * directions).astype(int) % directions
    area = np.bincount(sector.ravel(), (1 - picture.levels / 255.0).ravel(), directions) * PIXEL**2
    radius = np.sqrt(2 * area / (2 * np.pi / directions))
    return 2 * np.abs(np.fft.rfft(radius)) / directions


def test_worlds_are_registered_under_their_names():
    assert set(WORLDS) == set(SMALL)
    assert DEFAULT in WORLDS
    assert all(world_of(name).name == name for name in WORLDS)
    with pytest.raises(WithheldError, match="world must be one of paper, published, polar, got 'mars'"):
        world_of("mars")


@pytest.mark.parametrize("world", sorted(SMALL))
def test_a_null_is_a_cloth_with_folds(world):
    """Two pictures of one face differ less than those of two faces or two samples, all near the image's middle."""
    taken = pictures(world, count=5)
    assert [(one.sample, one.capture) for one in taken] == [(1, 1), (1, 2), (1, 3), (1, 4), (2, 1)]
    for one in taken:
        assert 0.1 < drape_coefficient(one) < 0.95
        waves = rim_waves(one)
        assert 4e-4 < waves[3:16].max() < 0.03
        assert waves[1] < 0.01
    first, again, turned = (one.levels.astype(float) for one in taken[:3])
    assert 0 < np.abs(first - again).mean() < np.abs(first - turned).mean()
    assert np.abs(first - taken[4].levels).mean() > 0.5


@pytest.mark.parametrize("world", sorted(SMALL))
def test_worlds_have_no_preferred_direction(world):
    """The mean outline of nulls of several fabrics is as wide as high, and its middle is the image's."""
    taken = [pictures(world, seed=seed, count=1)[0] for seed in range(3, 8)]
    shade = np.mean([1 - one.levels / 255.0 for one in taken], axis=0)
    y, x = np.mgrid[:256, :256] - 127.5
    middle = np.array([(shade * x).sum(), (shade * y).sum()]) / shade.sum()
    assert np.abs(middle).max() < 1.5  # [px]
    wide, high = np.sqrt((shade * x**2).sum()), np.sqrt((shade * y**2).sum())
    assert wide == pytest.approx(high, rel=0.04)


@pytest.mark.parametrize("world", sorted(SMALL))
def test_the_same_seed_gives_the_same_pictures_and_another_one_others(world):
    vertices, steps = SMALL[world]
    again = next(TrueCase((3, 2), {}, vertices, steps, world_name=world).pictures(1))
    np.testing.assert_array_equal(again.levels, pictures(world)[0].levels)
    assert np.abs(pictures(world, seed=4, count=1)[0].levels.astype(float) - again.levels).mean() > 0.5


def test_worlds_differ_in_all_that_laboratories_and_cloths_differ_in():
    worlds = [world_of(name) for name in WORLDS]
    for trait in ("laying_length", "laying_height", "stretch", "shear", "hardening", "stiffness_spread", "shift"):
        assert len({getattr(world.population, trait) for world in worlds}) == len(worlds), trait
    assert len({world.camera for world in worlds}) == len(worlds)
    found = [pictures(name)[0].levels.astype(float) for name in WORLDS]
    assert min(np.abs(found[i] - found[j]).mean() for i, j in ((0, 1), (0, 2), (1, 2))) > 0.5


@pytest.mark.parametrize("world", sorted(SMALL))
@pytest.mark.parametrize("name", ["camera-offset", "density-bias", "draught"])
def test_an_effect_of_imaging_of_the_cloth_and_of_no_list_shows(world, name):
    draw = (EFFECTS | OUTSIDE)[name]
    value = draw.parameters(4 * draw.typical, np.random.default_rng(0))
    base, acting = pictures(world), pictures(world, (name, tuple(value.items())))
    changed = [np.abs(a.levels.astype(float) - b.levels).mean() for a, b in zip(acting, base, strict=True)]
    assert max(changed) > 0.25
    if name == "camera-offset":
        moved = (acting[0].vertices - base[0].vertices)[:, :2]
        assert np.hypot(*moved.mean(0)) == pytest.approx(abs(value["shift"]), rel=0.5)


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - {"self-contact"}) + sorted(OUTSIDE))
def test_a_law_acts_in_the_polar_world_and_is_absent_at_zero(name):
    draw = (EFFECTS | OUTSIDE)[name]
    value = draw.parameters(4 * draw.typical, np.random.default_rng(0))
    absent = pictures("polar", (name, tuple((value | {draw.severity: 0.0}).items())))
    for without, plain in zip(absent, pictures("polar"), strict=True):
        np.testing.assert_allclose(without.vertices, plain.vertices, atol=2e-9)
    acting = pictures("polar", (name, tuple(value.items())))
    changed = [np.abs(a.levels.astype(float) - b.levels).mean() for a, b in zip(acting, absent, strict=True)]
    assert max(changed) > 0.25, changed


@pytest.mark.parametrize("world", sorted(SMALL))
def test_suites_hold_what_their_world_can_do(world):
    counts = {"null": 2, "single": len(DRAWN) * len(MULTIPLES), "pair": 10, "unknown": len(OUTSIDE) * len(MULTIPLES)}
    plans = plan_suite(5, counts, world_name=world)
    acting = {name for plan in plans for name in plan.causes}
    assert acting == (set(DRAWN) | set(OUTSIDE)) & set(world_of(world).laws)
    if world == DEFAULT:
        assert plans == plan_suite(5, counts)


def test_the_command_notes_the_world_and_does_not_mix_two(tmp_path):
    few = ["--nulls", "1", "--singles", "0", "--pairs", "0", "--unknown", "0", "--vertices", "100", "--samples", "1"]
    where = ["--out", str(tmp_path / "cases"), "--labels", str(tmp_path / "labels"), "--workers", "1", "--seed", "5"]
    made = CliRunner().invoke(app, ["withheld", "generate", *few, *where, "--world", "polar", "--json"])
    assert made.exit_code == 0, made.output
    assert json.loads((tmp_path / "labels" / "suite.json").read_text())["world"] == "polar"
    assert "polar" not in "".join(path.read_text() for path in tmp_path.rglob("cases/**/*.[cj]s*"))
    other = CliRunner().invoke(app, ["withheld", "generate", *few, *where, "--world", "published"])
    assert other.exit_code == 2
    assert "belongs to another suite" in other.stderr
    none = CliRunner().invoke(app, ["withheld", "generate", *few, *where, "--world", "mars"])
    assert none.exit_code == 2
    assert "world must be one of paper, published, polar" in none.stderr
