"""Options arrive where their help pages say: what is computed is caught, and nothing is."""

from dataclasses import astuple
from math import radians
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.design import Design
from cusick_bench.diagnosis.options import Options
from cusick_bench.identify.options import Options as IdentifyOptions
from cusick_bench.metrics.stiffness import cloth_stiffness
from cusick_bench.photographs.preparation.setting_text import SettingText
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings
from cusick_bench.sim.engine.settings import DrapeSettings

EFFECTS = ("plate-tilt:angle=2,direction=40", "camera-scale:error=0.03")
CLOTH = "--density 0.21 --bending 1e-5,2e-5,3e-5 --stretch 250 --shear 50"

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch):
    """asked(where, words): what a command asks of the function at that place, which stops it."""

    def ask(where: str, words: str) -> SimpleNamespace:
        caught: list[SimpleNamespace] = []

        def stopped(*given, **named):
            caught.append(SimpleNamespace(given=given, named=named))
            raise KeyboardInterrupt

        monkeypatch.setattr(f"cusick_bench.{where}", stopped)
        result = CliRunner().invoke(app, words.split())
        assert len(caught) == 1, result.output
        return caught[0]

    return ask


def test_of_a_run(asked, make_lab, tmp_path: Path):
    data = make_lab([1e-5, 2e-5])
    words = (
        f"run --data {data} --cloth fabric_2 --protocol leave-one-sample-out --force --solver homo,search=2 "
        "--space homo --loss profile --budget 9 --seconds 60 --seeds 2 --seed 7 --vertices 120 "
        "--mode equilibrium --steps 21 --law paper --clamp whole --camera pinhole --renderer soft --laying random "
        f"--workers 3 --shard 2/2 --with-effect {EFFECTS[0]} --with-effect {EFFECTS[1]} --out {tmp_path / 'out'}"
    )
    caught = asked("runner.run", words)
    source, cells, out = caught.given
    assert (source.data, out) == (str(data), tmp_path / "out")
    assert (caught.named["workers"], caught.named["force"]) == (3, True)
    planned = caught.named["grid"]
    assert cells == planned[1::2]
    assert [(cell.solver, cell.cloth, cell.protocol) for cell in planned] == [
        ("homo,search=2", "fabric_2", "leave-one-sample-out")
    ] * 6
    assert sorted({cell.seed for cell in planned}) == [7, 8]
    drape = DrapeSettings(law="paper", mode="equilibrium", steps=21, clamp="whole")
    settings = ProblemSettings("homo", 120, drape, "pinhole", "soft", "profile", "random", Budget(9, 60), EFFECTS)
    assert {cell.settings for cell in planned} == {settings}


def test_of_a_run_by_law_plate(asked, make_lab, tmp_path: Path):
    words = f"run --data {make_lab([1e-5])} --solver homo --law plate --membrane given --out {tmp_path}"
    _, cells, _ = asked("runner.run", words).given
    assert {cell.settings.drape for cell in cells} == {DrapeSettings(law="plate", membrane="given")}


@pytest.mark.parametrize(
    ("law", "option", "own"),
    [
        ("plate", "--membrane given --poisson 0.2", {"membrane": "given"}),
        ("paper", "--clamp whole", {"clamp": "whole"}),
        ("published", "--clamp whole", {"clamp": "whole"}),
    ],
)
def test_of_a_simulation(asked, law, option: str, own: dict):
    words = (
        f"simulate {CLOTH} --law {law} {option} --heterogeneity 0.3 --laying-height 0.002 --rest-height 0.003 "
        f"--vertices 120 --steps 21 --draws 5 --seed 7 --with-effect {EFFECTS[0]}"
    )
    drawn, count, _, out = asked("cli.simulate.simulate._simulated", words).given
    shapes = {"laying_amplitude": 2e-3, "rest_amplitude": 3e-3, "seed": 7}
    assert drawn.simulator.settings == DrapeSettings(law=law, steps=21, **own, **shapes)
    assert (drawn.heterogeneity, drawn.seed, count, out) == (0.3, 7, 5, None)
    assert [cause.effect.name for cause in drawn.causes] == ["plate-tilt"]
    cloth = drawn.cloth
    assert (float(cloth.density), float(cloth.poisson)) == (0.21, 0.2 if law == "plate" else 0.0)
    found = cloth_stiffness(cloth.stretch, cloth.bending, law, poisson=float(cloth.poisson))
    assert found.stretch == pytest.approx([250, 250, 50])
    assert found.bending == pytest.approx([3e-5, 1e-5, 2e-5])  # warp, weft, bias


def test_of_a_simulation_at_rest(asked):
    words = f"simulate {CLOTH} --law paper --mode equilibrium --self-contact 0.002 --vertices 120"
    drawn, *_ = asked("cli.simulate.simulate._simulated", words).given
    assert drawn.simulator.settings == DrapeSettings(law="paper", mode="equilibrium", self_contact=2e-3)


def test_of_a_table_of_the_paper(asked, make_lab, tmp_path: Path):
    words = (
        f"paper table-2 --data {make_lab([1e-5])} --force --solver homo --vertices 120 --budget 9 --mode equilibrium "
        f"--steps 21 --law plate --membrane given --second-law paper --workers 3 --out {tmp_path}"
    )
    caught = asked("cli.fit.paper.run_planned", words)
    drapes = (
        DrapeSettings(law="plate", mode="equilibrium", steps=21, membrane="given"),
        DrapeSettings(law="paper", mode="equilibrium", steps=21, clamp="whole"),
    )
    cells = caught.given[1]
    assert [cell.settings for cell in cells] == [
        ProblemSettings("homo", 120, drape, "parallel", budget=Budget(9)) for drape in drapes
    ]
    assert caught.named == {"workers": 3, "force": True}


def test_of_an_identification(asked, make_lab, tmp_path: Path):
    words = (
        f"identify {make_lab([1e-5])} --cloth fabric_1 --force --weight 0.2kg/m2 --weights w.csv --cloth-diameter 24cm "
        "--plate-diameter 12cm --captures 1=down --camera-height 2m --printed-ruler 149mm --image-size 300 "
        f"--solver bdp --budget 30 --vertices 120 --steps 21 --samples 5 --seed 7 --atlas a.npz --out {tmp_path}"
    )
    caught = asked("identify.identify.begin", words)
    _, out, options, text, size = caught.given
    assert options == IdentifyOptions(
        cloths=("fabric_1",), solver="bdp", vertices=120, steps=21, budget=30, samples=5, seed=7, force=True
    )
    assert text == SettingText(
        weight=("0.2kg/m2",), weights=Path("w.csv"), cloth_diameter="24cm", plate_diameter="12cm", captures="1=down",
        camera_height="2m", printed_ruler="149mm",
    )  # fmt: skip
    assert (out, size, caught.named["atlas"]) == (tmp_path, 300, Path("a.npz"))


def test_of_a_diagnosis(asked, tmp_path: Path):
    words = (
        "diagnose synthetic --fabric fabric_2 --samples 5 --without-effect creep --without-effect off-centre --seed 7"
    )
    captures, _, _, options, _ = asked("diagnosis.data_set.data_set_diagnosis", f"{words} --out {tmp_path}").given
    assert list(captures) == ["fabric_2"]
    assert options == Options(samples=5, always=True, without=("creep", "off-centre"), seed=7)


def test_of_controls(asked, tmp_path: Path):
    words = "diagnose-controls synthetic --fabric fabric_2 --control shift --halves 3 --without-effect creep --seed 7"
    caught = asked("diagnosis.controls.run.controlled", f"{words} --workers 3 --out {tmp_path / 'controls.csv'}")
    under, _, _, options = caught.given
    assert (under.name, under.halves, under.seed) == ("fabric_2", 3, 7)
    assert (options.samples, options.without, options.seed) == (0, ("creep",), 7)
    assert (caught.named["names"], caught.named["workers"]) == (["shift"], 3)


def test_of_withheld_answers(asked, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)  # where the command tries whether it can write
    (tmp_path / "case").mkdir()
    words = f"withheld answer {tmp_path} --samples 5 --without-effect creep --seed 7 --workers 3 --out a.json"
    caught = asked("withheld.answers.blind.answer_suite", words)
    assert caught.given[:2] == (tmp_path, Path("a.json"))
    assert caught.given[3] == Options(samples=5, always=False, without=("creep",), seed=7)
    assert caught.named["workers"] == 3


def test_of_a_suite(asked, tmp_path: Path):
    words = (
        "withheld generate --seed 7 --nulls 1 --singles 2 --pairs 3 --unknown 4 --multiple 2 --multiple 4 "
        "--world polar --vertices 450 --samples 5 --workers 3 "
        f"--out {tmp_path / 'cases'} --labels {tmp_path / 'labels'}"
    )
    caught = asked("withheld.suite.generate.generate", words)
    suite, out, labels = caught.given
    assert suite.counts == {"null": 1, "single": 2, "pair": 3, "unknown": 4}
    assert (suite.seed, suite.vertices, suite.samples, suite.world, suite.multiples) == (7, 450, 5, "polar", (2.0, 4.0))
    assert (out, labels, caught.named["workers"]) == (tmp_path / "cases", tmp_path / "labels", 3)


def test_of_an_atlas(asked, tmp_path: Path):
    numbers = {
        "points": 61, "stiff-points": 12, "effect-points": 13, "fine-points": 14, "finest-points": 15,
        "fine-effect-points": 16, "law-points": 17, "one-mesh-points": 18, "samples": 5, "vertices": 120,
    }  # fmt: skip
    words = " ".join(f"--{name} {number}" for name, number in numbers.items())
    folder, design = asked("diagnosis.atlas.drapes.build", f"atlas build --out {tmp_path} {words}").given
    assert folder == tmp_path
    assert design == Design(**{name.replace("-", "_"): number for name, number in numbers.items()})


def test_of_a_calibration_of_posteriors(asked):
    words = "posterior-calibration --solver bdp --fits 3 --budget 30 --law paper --vertices 120 --seed 7 --workers 5"
    plan, lacking, workers = asked("benchmark.posterior_calibration.calibration.calibration_fits", words).given
    assert astuple(plan) == ("bdp", 3, 120, 30.0, "paper", 7)
    assert (lacking, workers) == ([0, 1, 2], 5)


def test_of_optimisers(asked):
    words = "optimisers --function hartmann6 --dimension 60 --evaluations 40 --runs 3 --solver sobol --seed 7"
    (plan, *_) = asked("cli.fit.optimisers.compare", words).given
    assert astuple(plan) == ("hartmann6", 60, 40, 3, ("sobol",), 7)


def test_of_a_skirt(asked):
    words = (
        "garment skirt --heterogeneity 0.2 --name red --kind a-line --waist 0.12 --length 0.4 --hem 0.3 --hip 0.14 "
        "--draws 3 --laying-height 0.02 --vertices 300 --seed 7 --dynamic --motion turn "
        "--amplitude 60 --period 1.5 --duration 2"
    )
    cloth, wearing, _ = asked("garment.wearing.wear", f"{words} {CLOTH}").given
    assert (wearing.kind, wearing.vertices, wearing.draws) == ("a-line", 300, 3)
    assert (wearing.laying_height, wearing.seed) == (0.02, 7)
    assert (wearing.size.waist, wearing.size.length, wearing.size.hem) == (0.12, 0.4, 0.3)
    assert (wearing.body.waist, wearing.body.hip) == (0.12, 0.14)
    assert wearing.motion.turn == pytest.approx(radians(60))
    assert (wearing.motion.sway, wearing.motion.period, wearing.motion.seconds) == (0.0, 1.5, 2.0)
    assert (cloth.name, cloth.density) == ("red", 0.21)
    found = cloth_stiffness(torch.from_numpy(cloth.stretch[0]), torch.from_numpy(cloth.bending[0]), cloth.law)
    assert found.stretch == pytest.approx([250, 250, 50])
    assert found.bending == pytest.approx([3e-5, 1e-5, 2e-5])
    assert cloth.bending_sd == pytest.approx(0.2)
