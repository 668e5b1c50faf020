"""Planning a grid: every cell once, keys that follow what decides the numbers, and what is refused."""

from dataclasses import fields, replace

import pytest
from small_grid import SMALL

from cusick_bench.problem import Budget, ProblemError
from cusick_bench.runner import Cell, ProblemSettings, RunnerError, plan, shard
from cusick_bench.sim.effects.boundary.plate_tilt import PlateTilt
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import CusickError

pytestmark = pytest.mark.usefixtures("one_thread")


def test_every_solver_meets_every_cloth_and_seed(dataset):
    cells = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], seeds=[0, 1], settings=SMALL)
    assert len({cell.key for cell in cells}) == len(cells) == 4
    assert {(cell.solver, cell.seed) for cell in cells} == {
        (solver, seed) for solver in ("homo", "null:disc") for seed in (0, 1)
    }
    assert all(len(cell.train) == 1 and len(cell.test) == 2 for cell in cells)


def test_a_solver_is_run_once_however_it_is_spelled(dataset):
    spellings = ["bdp,draws=5,steps=4", "bdp, steps = 4, draws=5", "bdp,draws=5,steps=4,search=8", "bdp,draws=5"]
    cells = plan(dataset, solvers=spellings, cloths=["fabric_1"], settings=SMALL)
    assert [cell.solver for cell in cells] == ["bdp,draws=5,steps=4", "bdp,draws=5"]
    (spaced,) = plan(dataset, solvers=[" bdp , draws = 5, steps=4 "], cloths=["fabric_1"], settings=SMALL)
    assert spaced.key == cells[0].key


def test_a_laid_shape_is_refused_where_it_is_a_parameter(dataset):
    settings = replace(SMALL, laying="random")
    with pytest.raises(RunnerError, match="laying must be image in the space field"):
        plan(dataset, solvers=["homo", "bdp-field"], cloths=["fabric_1"], settings=settings)
    homo, null = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], settings=settings)
    assert homo.settings.laying == null.settings.laying == "random"
    assert plan(dataset, solvers=["null:disc"], settings=replace(settings, space="field"))


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"drape": DrapeSettings(law="plate", mode="equilibrium")}, "got mode equilibrium"),
        ({"causes": ("self-contact:thickness=0.001",)}, "got self-contact"),
    ],
)
def test_a_brisk_pace_is_refused_where_nothing_is_dropped(dataset, changed, why):
    settings = replace(SMALL, **changed)
    with pytest.raises(RunnerError, match=f"pace brisk is for drops, {why}"):
        plan(dataset, solvers=["bdp-field,pace=brisk"], cloths=["fabric_1"], settings=settings)
    assert plan(dataset, solvers=["bdp-field"], cloths=["fabric_1"], settings=settings)


def test_key_follows_whatever_decides_the_numbers(dataset, monkeypatch):
    def key(solver="homo", seed=0, settings=SMALL, cloth="fabric_1"):
        return plan(dataset, solvers=[solver], cloths=[cloth], seeds=[seed], settings=settings)[0].key

    others = {
        key(solver="homo,search=3"),
        key(seed=1),
        key(settings=ProblemSettings(vertices=120, drape=DrapeSettings(steps=20), budget=Budget(8))),
        key(settings=ProblemSettings(vertices=100, drape=DrapeSettings(steps=21), budget=Budget(8))),
        key(settings=ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(9))),
    }
    assert key() == key()
    assert len(others | {key()}) == 6
    before = key()
    monkeypatch.setattr("cusick_bench.sim.engine.NUMERICS_VERSION", 99)
    assert key() != before


OTHER_SETTINGS = {
    "space": "field",
    "vertices": 120,
    "drape": DrapeSettings(steps=21),
    "camera": "pinhole",
    "renderer": "soft",
    "loss": "profile",
    "laying": "random",
    "budget": Budget(9),
    "causes": ("plate-tilt:angle=2",),
}
OTHER_DRAPES = {
    "law": "published",
    "mode": "equilibrium",
    "steps": 21,
    "step_seconds": 0.04,
    "gravity": 9.7,
    "plate_radius": 0.08,
    "support": "springs",
    "clamp": "whole",
    "laying_amplitude": 2e-3,
    "laying_length": 0.02,
    "rest_amplitude": 1e-3,
    "rest_length": 0.02,
    "tolerance": 1e-8,
    "iterations": 400,
    "backend": "splu",
}
NOT_ALONE = {"pace", "membrane", "self_contact"}  # of DrapeSettings, which take another law or mode
SEED = {"seed"}  # replaced by the cell's


def test_no_setting_is_left_out_of_the_key(dataset):
    """Cells that differ in one setting would be taken for each other, and the first one's numbers for both."""

    def key(settings: ProblemSettings) -> str:
        return plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=settings)[0].key

    assert OTHER_SETTINGS.keys() == {field.name for field in fields(ProblemSettings)}
    assert OTHER_DRAPES.keys() | NOT_ALONE | SEED == {field.name for field in fields(DrapeSettings)}
    plate = replace(SMALL, drape=replace(SMALL.drape, law="plate"))
    resting = replace(SMALL, drape=replace(SMALL.drape, mode="equilibrium"))
    pairs = {name: (SMALL, replace(SMALL, **{name: value})) for name, value in OTHER_SETTINGS.items()}
    pairs |= {
        f"drape.{name}": (whole, replace(whole, drape=replace(whole.drape, **{name: value})))
        for whole, changed in (
            (SMALL, OTHER_DRAPES),
            (plate, {"pace": "brisk", "membrane": "given"}),
            (resting, {"self_contact": 1e-3}),
        )
        for name, value in changed.items()
    }
    assert [name for name, (one, other) in pairs.items() if key(one) == key(other)] == []


def test_cells_are_named_by_a_mended_clamp_only(dataset):
    """Records of before there was a choice say nothing of it: their hinges were whole, and their names stay."""

    def cell(**changes) -> Cell:
        drape = DrapeSettings(steps=20, **changes)
        settings = ProblemSettings(vertices=100, drape=drape, budget=Budget(8))
        return plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=settings)[0]

    drapes = {name: cell(clamp=name).record()["settings"]["drape"] for name in ("half", "whole")}
    assert drapes["half"] == drapes["whole"] | {"clamp": "half"}
    assert "clamp" not in drapes["whole"]
    assert cell().key == cell(clamp="half").key != cell(clamp="whole").key
    assert cell().problem_hash() != cell(clamp="whole").problem_hash()
    for other in ({"law": "published"}, {"support": "springs"}):
        assert cell(**other).key == cell(**other, clamp="whole").key


@pytest.mark.parametrize(
    ("part", "touched"),
    [
        ("cusick_bench.solvers.variational.bdp.Bdp.version", {"bdp"}),
        ("cusick_bench.sim.render.NUMERICS_VERSION", {"homo", "bdp"}),
        ("cusick_bench.problem.NUMERICS_VERSION", {"homo", "bdp"}),
        ("cusick_bench.metrics.NUMERICS_VERSION", {"homo", "bdp", "null:disc"}),
        ("cusick_bench.sim.contact.NUMERICS_VERSION", set()),
        ("cusick_bench.sim.effects.NUMERICS_VERSION", set()),
    ],
)
def test_a_new_version_touches_only_cells_that_use_the_part(dataset, monkeypatch, part, touched):
    def keys():
        cells = plan(dataset, solvers=["homo", "bdp", "null:disc"], cloths=["fabric_1"], settings=SMALL)
        return {cell.solver: cell.key for cell in cells}

    before = keys()
    monkeypatch.setattr(part, 99)
    after = keys()
    assert {solver for solver in before if before[solver] != after[solver]} == touched


def test_effects_and_contact_count_where_they_are_simulated(dataset):
    with_cause = ProblemSettings(vertices=100, causes=("plate-tilt:angle=2",), budget=Budget(8))
    homo, disc = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], settings=with_cause)
    assert {"effects", "contact"} <= homo.record()["numerics"].keys()
    assert disc.record()["numerics"].keys() == {"datasets", "metrics", "solver null:disc"}
    apart = ProblemSettings(vertices=100, drape=DrapeSettings(mode="equilibrium", self_contact=1e-3))
    (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=apart)
    assert "contact" in cell.record()["numerics"]


def test_a_new_version_of_an_effect_touches_only_cells_with_it(dataset, monkeypatch):
    def cell(cause: str) -> Cell:
        settings = ProblemSettings(vertices=100, causes=(cause,), budget=Budget(8))
        return plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=settings)[0]

    tilted, near = cell("plate-tilt:angle=2"), cell("perspective")
    monkeypatch.setattr(PlateTilt, "version", 2)
    assert dict(cell("plate-tilt:angle=2").numerics) == dict(tilted.numerics) | {"effect plate-tilt": 2}
    assert cell("plate-tilt:angle=2").key != tilted.key
    assert cell("perspective").key == near.key


def test_shards_are_the_whole_once(dataset):
    cells = plan(dataset, solvers=["null:disc", "null:copy"], seeds=[0, 1, 2], settings=SMALL)
    parts = [shard(cells, f"{part}/4") for part in (1, 2, 3, 4)]
    assert sorted(cell.key for part in parts for cell in part) == sorted(cell.key for cell in cells)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "-1/2", ""])
def test_shard_must_be_a_fraction(text):
    with pytest.raises(RunnerError, match="i/n"):
        shard([], text)


def test_density_is_needed_before_anything_is_simulated(dataset):
    with pytest.raises(CusickError, match=r"areal density.*fabric_2.*fabrics\.csv"):
        plan(dataset, solvers=["null:disc", "homo"], cloths=["fabric_2"], settings=SMALL)
    assert plan(dataset, solvers=["null:disc"], cloths=["fabric_2"], settings=SMALL)


def test_errors_before_the_start(dataset):
    with pytest.raises(CusickError, match="unknown cloth"):
        plan(dataset, solvers=["homo"], cloths=["silk"])
    with pytest.raises(CusickError, match="unknown solver"):
        plan(dataset, solvers=["hobo"])
    with pytest.raises(RunnerError, match="no solver given"):
        plan(dataset, solvers=[])
    with pytest.raises(ProblemError, match="unknown space 'cubic'"):
        ProblemSettings(space="cubic")
