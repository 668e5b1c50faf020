"""What to do next, as a laboratory is told."""

import shlex
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from identify_command import SOLVER
from toy_cloths import image_path, write_toy

from cusick_bench.datasets import load
from cusick_bench.identify.document import Drapes
from cusick_bench.identify.fits import plan_fits
from cusick_bench.identify.options import Options
from cusick_bench.identify.words import fabric_next, laboratory_next


@pytest.fixture
def named_sets(lab, tmp_path) -> Path:
    """Two named sets, whose cloths have no number."""
    for name, fabric in (("cotton_green", 1), ("wool red", 3)):
        folder = tmp_path / "bnn_image_gt" / name
        folder.mkdir(parents=True)
        picture = lab / f"data/Fabric {fabric}/silhouettes/Fabric_{fabric}_Sample_1_Capture_1.jpg"
        shutil.copy(picture, folder / f"{name}_sample_1_Upward_Drape_1.jpg")
    return tmp_path


@pytest.mark.parametrize(
    ("missing", "advice"),
    [
        (
            "the fit failed: the cloth flies apart: net force 3.2 of the weight",
            "Repeat the command with another",
        ),
        (
            "null:disc has no physics and finds no stiffness; see `cusick-bench solvers`",
            "Repeat the command with a s",
        ),
        ("Fabric 2/1-1.png: the cloth is smaller than the plate", "Mend what the reason above names"),
    ],
)
def test_advice_fits_the_reason(lab, missing, advice):
    drapes = Drapes(samples=12, silhouettes=48, units=24)
    first = fabric_next(load(lab), "fabric_2", drapes, missing, None, 0)[0]
    assert first.startswith(advice)


def test_another_seed_fits_all_fabrics_again_as_the_advice_on_a_failed_fit_says(lab):
    dataset, options = load(lab), Options(solver=SOLVER)
    (advice,) = fabric_next(
        dataset, "fabric_1", Drapes(samples=3, silhouettes=3, units=3), "the fit failed: x", None, 0
    )[:1]
    assert "all fabrics are fitted again" in advice
    assert "--cloth fabric_1 and an --out of its own" in advice
    keys = [
        {cell.key for cell in plan_fits(dataset, dataset.cloths, one).cells.values()}
        for one in (options, replace(options, seed=1), replace(options, vertices=options.vertices + 100))
    ]
    assert len(set.union(*keys)) == sum(map(len, keys))


@pytest.mark.parametrize(("cloth", "advised"), [(0.15, False), (0.12, True), (0.18, True)])
def test_samples_for_a_diagnosis_are_of_the_size_that_it_knows(lab, cloth, advised):
    dataset = load(lab)
    dataset = replace(dataset, protocol=replace(dataset.protocol, cloth_radius_m=cloth))
    steps = [step for step in laboratory_next(dataset, None) if "ratio" in step]
    assert len(steps) == advised
    assert all(step.startswith("For a diagnosis drape samples of 300 mm over this plate") for step in steps)
    more = fabric_next(dataset, "fabric_2", Drapes(samples=1, silhouettes=4, units=2), "", None, 0)
    assert any(step.startswith("Cut 2 more samples") for step in more) != advised


def test_a_data_set_without_a_protocol_is_told_whose_sizes_it_has(lab, tmp_path):
    """Pictures at another scale than the release's had wrong drape coefficients, and nothing named the scale."""
    (step,) = (step for step in laboratory_next(load(lab), None) if "protocol.json" in step)
    assert "those of the public release (cloth 300 mm, plate 180 mm, 723 px/m)" in step
    described = shutil.copytree(lab, tmp_path / "lab")
    (described / "protocol.json").write_text("{}")
    for known in (described, described / "data", "synthetic"):
        assert not any("protocol.json" in step for step in laboratory_next(load(known), None))


def test_pictures_that_cannot_be_used_are_not_forced(lab):
    missing = "none of its pictures can be used; `cusick-bench data audit` says why"
    steps = fabric_next(load(lab), "fabric_2", Drapes(samples=3, silhouettes=3, units=0, unusable=3), missing, None, 0)
    assert steps[0].startswith("Look at 3 unusable pictures")
    assert not any("--force" in step for step in steps)


def test_samples_whose_pictures_cannot_be_used_are_not_to_be_cut_again(lab):
    for fabric, cut in (("fabric_1", False), ("fabric_2", True)):
        steps = fabric_next(load(lab), fabric, Drapes(samples=1, silhouettes=3, units=1, unusable=2), "", None, 0)
        assert any(step.startswith("Cut 2 more samples") for step in steps) is cut


def test_captures_without_a_number_are_to_be_numbered(lab, tmp_path):
    """Their face cannot be told by `captures` in protocol.json, which goes by the number."""
    for path in (lab / "data/Fabric 1/silhouettes").iterdir():
        (tmp_path / path.name.replace("_Capture_1", "")).write_bytes(path.read_bytes())
    steps = fabric_next(load(tmp_path), "fabric_1", Drapes(samples=3, silhouettes=3, units=3), "", None, 0)
    assert any(step.startswith("Number the captures in the names of the pictures") for step in steps)
    assert not any("protocol.json" in step for step in steps)


def test_samples_that_lack_a_face_are_named(tmp_path):
    """With both faces of one sample, nothing told that the others were not learned from, or tell no difference."""
    root = write_toy(tmp_path / "lab", samples=5, captures=4, meshes=False)
    drapes = Drapes(samples=5, silhouettes=20, units=10)

    def steps() -> list[str]:
        return [step for step in fabric_next(load(root), "fabric_7", drapes, "", None, 0) if " face " in step]

    assert steps() == []
    for sample, captures in ((2, (1, 2)), (4, (1, 2)), (5, (3, 4))):
        for capture in captures:
            image_path(root, sample, capture).unlink()
    up, down = steps()
    assert up.startswith("Picture samples 2, 4 face up as well: ")
    assert down.startswith("Picture sample 5 face down as well: ")


def test_a_named_set_is_weighed_by_its_name(named_sets):
    """Photographs have numbers: `--weight "0=180 g/m2"` would be refused."""
    missing = "its weight is not known, and a drape shows stiffness over weight only"
    (step, *_) = fabric_next(load(named_sets), "wool red", Drapes(samples=1, silhouettes=1, units=1), missing, None, 0)
    assert "with the weight: a line wool red,0.18, in fabrics.csv." in step
    (named_sets / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\nwool red,0.18,\n")
    dataset = load(named_sets)
    assert dataset.select(cloth="wool red").table["areal_density"].tolist() == [0.18]


def test_named_sets_are_as_many_fabrics_as_their_names(named_sets):
    def other_fabrics() -> bool:
        return any(step.startswith("Picture other fabrics") for step in laboratory_next(load(named_sets), None))

    assert not other_fabrics()
    shutil.rmtree(named_sets / "bnn_image_gt/wool red")
    assert other_fabrics()


def test_commands_in_advice_can_be_pasted(named_sets, monkeypatch):
    spaced = named_sets / "my lab"
    spaced.mkdir()
    (named_sets / "bnn_image_gt").rename(spaced / "bnn_image_gt")
    drapes = Drapes(samples=1, silhouettes=1, units=1, unusable=1)
    look, again, *_ = fabric_next(load(spaced), "wool red", drapes, "the fit failed: x", None, 0)
    assert shlex.split(look)[-4:] == ["cusick-bench", "data", "audit", str(spaced)]
    assert "--cloth 'wool red' and" in again
    dataset = load(spaced)
    monkeypatch.setattr(sys, "platform", "win32")
    look, again, *_ = fabric_next(dataset, "wool red", drapes, "the fit failed: x", None, 0)
    assert look.endswith(f'cusick-bench data audit "{spaced}"')
    assert '--cloth "wool red" and' in again
