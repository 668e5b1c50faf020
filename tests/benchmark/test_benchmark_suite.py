"""The benchmark keeps what it has measured, and tells how far it is in the units of its plan."""

import json

import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark import suite
from cusick_bench.benchmark.plan import FULL, Plan, work
from cusick_bench.benchmark.suite import PARTS, benchmark, scaling
from cusick_bench.benchmark.text import _sizes
from cusick_bench.cli import app

QUICK_SECONDS = 300  # on two quiet cores


@pytest.fixture
def stopped_at_the_second_mesh(monkeypatch):
    """A benchmark that is interrupted once one mesh is measured."""

    def measure(vertices, plan, done):
        if vertices != plan.vertices[0]:
            raise KeyboardInterrupt
        done(f"{vertices} vertices: drop", 1.0)
        return {"vertices": vertices, "cases": {}}

    monkeypatch.setattr(suite, "measure_mesh", measure)


def test_the_quick_plan_takes_minutes_and_the_full_one_longer():
    assert work(Plan()) < QUICK_SECONDS < work(Plan(**FULL))


def test_every_part_is_kept_once_it_is_measured(monkeypatch):
    cases = {key: {"median_s": 0.02} for key in ("equilibrium, warm, +gradient", "silhouette+gradient", "drop")}
    ratios = {key: {"median": 1.3} for key in ("drop / floor", "drop+gradient / floor")}
    ratios |= {f"batch of 16{kind} / 16 drops": {"median": 0.7} for kind in ("", ", lockstep")}
    mesh = {"vertices": 1205, "ratios": ratios, "cases": cases}
    monkeypatch.setattr(suite, "measure_mesh", lambda vertices, plan, done: mesh)
    monkeypatch.setattr(suite, "gradient_errors", lambda vertices, law: [])
    monkeypatch.setattr(suite, "start_up", lambda law: 1.0)
    steps = {"vertices": 1205, "ratio": {"median": 1.5}}
    monkeypatch.setattr(suite, "measure_laws", lambda plan, done: {"meshes": [steps], "equal_error": None})
    compared = {"times_faster": {"median": 2.0}, "times_leaner": 3.0}
    monkeypatch.setattr(suite.Comparison, "measure", lambda self, rounds: compared)
    kept = []
    document = benchmark(Plan(vertices=(1205,)), keep=lambda document: kept.append(list(document["missing"])))
    assert kept == [list(PARTS), *(list(PARTS[part:]) for part in range(1, len(PARTS) + 1)), []]
    assert document["ratios"]["plain autograd / engine, time"] == 2.0
    met = {row["target"]: row["met"] for row in document["targets"]}
    assert met["drop / floor"]
    assert not met["times faster than plain autograd"]
    assert met["step, plate / paper, 1205 vertices"]
    assert {name: value for name, value in met.items() if "batch" in name} == {
        "batch of 16, lockstep / 16 drops, 1205 vertices": False
    }


def test_tables_do_not_replace_the_document_of_the_same_name(tmp_path):
    done = CliRunner().invoke(app, ["benchmark", "--out", str(tmp_path / "b.md")], env={"COLUMNS": "400"})
    assert done.exit_code == 2
    assert "the tables would replace the document" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [[], ["--runner-cells", "40"]])
def test_a_folder_is_no_document(words, tmp_path):
    done = CliRunner().invoke(app, ["benchmark", *words, "--out", str(tmp_path)], env={"COLUMNS": "400"})
    assert done.exit_code == 2
    assert f"is a folder; name the document in it, for instance {tmp_path / 'benchmark.json'}" in done.stderr


def test_sizes_for_a_reference_want_one(tmp_path):
    words = ["--reference-vertices", "480", "--out", str(tmp_path / "b.json")]
    done = CliRunner().invoke(app, ["benchmark", *words], env={"COLUMNS": "400"})
    assert done.exit_code == 2
    assert "--reference-vertices is about the table that --reference names" in done.stderr


@pytest.mark.parametrize(
    ("words", "option", "beside"),
    [
        (
            ["--runner-cells", "40", "--vertices", "297"],
            "--vertices",
            "--runner-cells, which measures the runner alone",
        ),
        (["--runner-cells", "40", "--law", "paper"], "--law", "--runner-cells"),
        (["--runner-cells", "40", "--full"], "--full", "--runner-cells"),
        (
            ["--device-only", "--device", "cpu:torch", "--gradient-vertices", "97"],
            "--gradient-vertices",
            "--device-only",
        ),
    ],
)
def test_options_that_would_do_nothing_are_refused(words: list[str], option: str, beside: str, tmp_path):
    done = CliRunner().invoke(app, ["benchmark", *words, "--out", str(tmp_path / "b.json")], env={"COLUMNS": "400"})
    assert done.exit_code == 2
    assert f"{option} does nothing beside {beside}" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_is_named_twice_is_measured_once(monkeypatch, tmp_path):
    plans = []

    def stop(plan, done, keep):
        plans.append(plan)
        raise KeyboardInterrupt

    monkeypatch.setattr(suite, "benchmark", stop)
    words = ["--vertices", "1205", "--vertices", "297", "--vertices", "1205", "--batch", "8", "--batch", "8"]
    CliRunner().invoke(app, ["benchmark", *words, "--out", str(tmp_path / "b.json")])
    assert [(plan.vertices, plan.batches, plan.device_batches) for plan in plans] == [((1205, 297), (8,), (8,))]


def test_batches_that_are_left_out_are_told(monkeypatch, tmp_path):
    """One that was asked for was not in the document, and nothing said why."""

    def stop(plan, done, keep):
        raise KeyboardInterrupt

    monkeypatch.setattr(suite, "benchmark", stop)
    words = ["--vertices", "297", "--vertices", "2699", "--batch", "16", "--batch", "500"]
    done = CliRunner().invoke(app, ["benchmark", *words, "--out", str(tmp_path / "b.json")], env={"COLUMNS": "400"})
    (told,) = [line for line in done.stderr.splitlines() if "not measured" in line]
    assert told.startswith("batches of 500 with 2699 vertices are not measured on the CPU")


def test_one_size_has_no_exponent():
    meshes = [{"vertices": 1205, "cases": {"drop": {"median_s": seconds}}} for seconds in (0.2, 0.21)]
    assert scaling(meshes) is None
    assert scaling([*meshes, {"vertices": 2410, "cases": {"drop": {"median_s": 0.41}}}]) == pytest.approx(1, abs=0.01)


def test_an_interrupted_benchmark_says_where_its_parts_lie(stopped_at_the_second_mesh, tmp_path):
    out = tmp_path / "parts" / "benchmark.json"
    done = CliRunner().invoke(app, ["benchmark", "--out", str(out)], env={"COLUMNS": "400"})
    assert done.exit_code == 130
    kept = json.loads(out.read_text())
    assert [mesh["vertices"] for mesh in kept["meshes"]] == [Plan().vertices[0]]
    assert kept["missing"] == list(PARTS)
    assert str(out) in "".join(done.stderr.split("\n"))
    assert "meshes, device, laws" in done.stderr


def test_a_quiet_benchmark_does_not_say_what_it_writes(tmp_path, monkeypatch):
    monkeypatch.setattr(suite, "benchmark", lambda plan, done, keep: {"missing": []})
    monkeypatch.setattr("cusick_bench.benchmark.text.markdown", lambda document, command: "")
    for words, told in ((["-q"], False), ([], True)):
        done = CliRunner().invoke(app, ["benchmark", "--out", str(tmp_path / "b.json"), "--json", *words])
        assert done.exit_code == 0, done.output
        assert ("wrote" in done.stderr) == told


def test_tables_show_drapes_in_seconds_steps_in_milliseconds_and_memory_in_megabytes():
    cases, phases = {"drop": {"median_s": 0.25}}, {"factorisation": {"median_s": 0.0025}}
    ratios, memory = {"drop / floor": {"median": 1.3}}, {"kept": 3e8, "checkpointed": 5e7}
    mesh = {"vertices": 1205, "cases": cases, "phases": phases, "ratios": ratios, "memory_bytes": memory}
    text = "\n".join(_sizes([mesh]))
    for line in ("| drop | 0.250 (1.30) |", "| factorisation | 2.50 |", "| kept | 300 |", "| checkpointed | 50 |"):
        assert line in text, line
