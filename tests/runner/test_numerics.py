"""Numbers of every part of the numerics are those of its version: who changes them raises it (`support/golden.py`)."""

from dataclasses import replace

import pytest
from golden import PATH, changes, goldens, stored

from cusick_bench.problem import SPACES
from cusick_bench.runner.labels import PARTS_OF_SAMPLES
from cusick_bench.runner.numerics import REST_SHAPE, SPRINGS, cell_numerics
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.solvers.registry import make_solver, registered

GOLDENS = goldens()
pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


@pytest.mark.parametrize("part", GOLDENS)
def test_numbers_are_those_of_the_version(part):
    golden, kept = GOLDENS[part], stored().get(part)
    write = f"run `python tests/support/golden.py --write` and commit {PATH.name}"
    assert kept is not None, f"{part} has no golden numbers yet; {write}"
    assert kept["versions"] == dict(golden.versions), f"{part} or what it uses has a new version; {write}"
    wrong = changes(golden, kept)
    others = ", ".join(name for name in golden.versions if name != part)
    assert not wrong, "\n".join(
        [
            f"numbers of {part} have changed and its version has not: bump the version of {part}, or undo the change",
            *([f"(where one of these fails here too, bump that one: {others})"] if others else []),
            *wrong,
        ]
    )


def test_every_solver_has_golden_numbers():
    """Of a family such as NLopt's some members stand for all: they share one class."""
    checked = {part.removeprefix("solver ") for part in GOLDENS if part.startswith("solver ")}
    families = {name.partition(":")[0] for name in checked if name.startswith("nlopt:")}
    lacking = {name for name in registered() if name not in checked and name.partition(":")[0] not in families}
    assert lacking == set()


@pytest.mark.parametrize(
    ("solver", "asked", "used"),
    [("homo", "homo", "homo"), ("homo", "field", "field"), ("bdp-field", "homo", "field"), ("null:disc", "field", "")],
)
def test_a_cell_has_the_version_of_the_space_that_it_is_in(solver, asked, used):
    versions = cell_numerics(make_solver(solver), DrapeSettings(), space=asked)
    found = {name: number for name, number in versions.items() if name.startswith("space ")}
    assert found == ({f"space {used}": SPACES[used].version} if used and SPACES[used].version > 1 else {})


def test_cells_on_springs_alone_have_the_version_of_springs():
    solver = make_solver("homo")
    assert "springs" not in cell_numerics(solver, DrapeSettings())
    assert cell_numerics(solver, DrapeSettings(support="springs"))["springs"] == SPRINGS


def test_cells_with_a_rest_shape_and_effects_have_the_version_of_where_it_lies():
    solver, bent = make_solver("homo"), DrapeSettings(rest_amplitude=1e-3)
    for settings, causes in ((DrapeSettings(), ("off-centre:shift=0.002",)), (bent, ())):
        assert "rest shape" not in cell_numerics(solver, settings, causes)
    assert cell_numerics(solver, bent, ("off-centre:shift=0.002",))["rest shape"] == REST_SHAPE


def test_parts_that_only_some_samples_need_are_known_as_such():
    """Cells of one run differ in them; the camera is that of the whole data set."""
    solver, settings, causes = make_solver("bdp-field"), DrapeSettings(), ("creep",)
    every = {"both_faces": True, "repeats": True, "series": True}
    more = cell_numerics(solver, settings, causes, **every).keys() - cell_numerics(solver, settings, causes).keys()
    assert "series" not in cell_numerics(solver, settings, series=True), "only effects depend on it"
    assert more == set(PARTS_OF_SAMPLES)


def test_a_changed_number_is_found():
    golden = GOLDENS["test functions"]
    kept = {"values": golden.values()}
    assert changes(golden, kept) == []
    name = next(iter(kept["values"]))
    moved = {name: [1.00001 * number for number in kept["values"][name]]}
    assert changes(replace(golden, values=lambda: kept["values"] | moved), kept) != []
    assert changes(replace(golden, values=lambda: moved), kept) != []  # a number that is no longer there
