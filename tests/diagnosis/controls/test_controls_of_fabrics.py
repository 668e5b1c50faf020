"""Controls of whole fabrics, and the command."""

import csv
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up_controls import CLOTH, some_judgements
from other_laboratory import write_laboratory, write_protocol
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.diagnosis.controls import run
from cusick_bench.diagnosis.controls.known_answers import CONTROLS, SHIFT_DIRECTION
from cusick_bench.diagnosis.controls.reading import REFUSED, Estimate, Reading
from cusick_bench.diagnosis.controls.run import controlled
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import Captures


class TestCommand:
    def test_fabrics_that_a_table_has_are_not_done_again(self, tmp_path, monkeypatch):
        """Stopped at the second fabric, and begun again."""
        done, out = [], tmp_path / "controls.csv"

        def controlled(under, *args, **options):
            if under.name == "fabric_2" and not done.count("fabric_2"):
                done.append("fabric_2")
                raise KeyboardInterrupt
            done.append(under.name)
            return [replace(one, fabric=under.name) for one in some_judgements()]

        monkeypatch.setattr(run, "controlled", controlled)
        asked = ["diagnose-controls", "synthetic", "--fabric", "fabric_1", "--fabric", "fabric_2", "--out", str(out)]
        assert CliRunner().invoke(app, asked).exit_code != 0
        again = CliRunner().invoke(app, [*asked, "--json"])
        assert again.exit_code == 0, again.output
        assert done == ["fabric_1", "fabric_2", "fabric_2"]
        fabrics = [one["fabric"] for one in json.loads(again.stdout)["controls"]]
        assert fabrics == ["fabric_1"] * len(some_judgements()) + ["fabric_2"] * len(some_judgements())

    def test_a_page_that_a_kill_left_behind_its_table_is_written_again(self, tmp_path, monkeypatch):
        found = [replace(one, fabric=CLOTH) for one in some_judgements()]
        monkeypatch.setattr(run, "controlled", lambda *_, **__: found)
        out = tmp_path / "controls.csv"
        asked = ["diagnose-controls", "synthetic", "--fabric", CLOTH, "--out", str(out)]
        assert CliRunner().invoke(app, asked).exit_code == 0
        page = out.with_suffix(".md").read_text()
        out.with_suffix(".md").unlink()
        again = CliRunner().invoke(app, asked)
        assert again.exit_code == 0, again.output
        assert out.with_suffix(".md").read_text() == page

    def test_a_table_of_other_options_is_not_replaced_without_a_word(self, tmp_path, monkeypatch):
        found = [replace(one, fabric=CLOTH) for one in some_judgements()]
        monkeypatch.setattr(run, "controlled", lambda *_, **__: found)
        asked = ["diagnose-controls", "synthetic", "--fabric", CLOTH, "--out", str(tmp_path / "controls.csv")]
        for more, told in (([], False), ([], False), (["--seed", "1"], True)):
            done = CliRunner().invoke(app, [*asked, *more])
            assert done.exit_code == 0, done.output
            assert ("is of other options, data, atlas or code" in " ".join(done.stderr.split())) == told

    def test_other_data_of_the_same_name_are_controlled_anew(self, tmp_path, monkeypatch):
        done, data = [], write_laboratory(tmp_path / "lab", RELEASE, samples=6)

        def controlled(under, *args, **options):
            done.append(under.name)
            return [replace(one, fabric=under.name) for one in some_judgements()]

        monkeypatch.setattr(run, "controlled", controlled)
        asked = ["diagnose-controls", str(data), "--out", str(tmp_path / "controls.csv")]
        for protocol, times in ((RELEASE, 1), (RELEASE, 1), (replace(RELEASE, px_per_m=720.0), 2)):
            write_protocol(data, protocol)
            again = CliRunner().invoke(app, asked)
            assert again.exit_code == 0, again.output
            assert done == ["fabric_3"] * times

    @pytest.mark.slow
    def test_a_shift_of_one_fabric_from_end_to_end(self, tmp_path):
        out = tmp_path / "controls.csv"
        chosen = ["--fabric", CLOTH, "--control", "shift", "--workers", "1", "--out", str(out), "--json"]
        done = CliRunner().invoke(app, ["diagnose-controls", "synthetic", *chosen])
        assert done.exit_code == 0, done.output
        written = json.loads(done.stdout)
        small, large = written["controls"]
        assert (small["strength"], large["strength"]) == ("smaller", "larger")
        assert large["largest_shift"] == pytest.approx(2 * small["largest_shift"], rel=0.05)
        assert large["largest_shift"] > 5
        assert large["probability"] > large["probability_before"]
        assert large["planted"] == pytest.approx(3 / 723)
        assert large["estimated"] == pytest.approx(3 / 723, rel=0.5)
        with out.open() as file:
            lines = list(csv.DictReader(file))
        assert [line["control"] for line in lines if line["row"] == "control"] == ["shift", "shift"]
        assert "diagnose-controls synthetic --fabric fabric_2" in out.with_suffix(".md").read_text()

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["--control", "shfit"], "no control is called 'shfit'; use shift, scale"),
            (["--out", "table.txt"], "must end in .csv"),
            (["--fabric", "fabric_99"], "fabric_99"),
        ],
    )
    def test_bad_input_is_refused(self, arguments, message):
        done = CliRunner().invoke(app, ["diagnose-controls", "synthetic", *arguments])
        assert done.exit_code == 2
        assert message in done.stderr

    def test_too_few_samples_are_told_with_their_number(self, make_lab, tmp_path):
        lab, out = make_lab([1e-5], samples=3), tmp_path / "controls.csv"
        asked = ["diagnose-controls", str(lab), "--out", str(out)]
        assert "has 6 samples, from which on" in CliRunner().invoke(app, asked).stderr
        done = CliRunner().invoke(app, [*asked, "--fabric", "fabric_1", "--control", "halves"])
        assert done.exit_code == 2
        assert "none of halves can be tried on fabric_1" in done.stderr
        assert "(halves) 6 samples that are not there" in done.stderr

    def test_controls_that_no_fabric_allows_are_no_empty_table(self, tmp_path):
        out = tmp_path / "controls.csv"
        asked = ["diagnose-controls", "synthetic", "--fabric", CLOTH, "--control", "slip", "--out", str(out)]
        for _ in range(2):
            done = CliRunner().invoke(app, asked)
            assert done.exit_code == 2
            assert f"none of slip can be tried on {CLOTH}" in done.stderr
            assert not out.exists()

    def test_every_control_has_a_line_in_the_docs(self):
        from cusick_bench.diagnosis.controls import known_answers

        assert all(f"    {name}" in (known_answers.__doc__ or "") for name in CONTROLS)


class TestRun:
    """Which diagnoses are made, with one that answers at once."""

    @pytest.fixture
    def diagnosed(self, monkeypatch) -> list[Captures]:
        seen: list[Captures] = []

        def diagnose(captures, emulator, calibration, options):
            seen.append(captures)
            if len(set(captures.side)) == 1:
                raise DiagnosisError("one face only")
            return _answer(captures)

        monkeypatch.setattr(run, "diagnose", diagnose)
        monkeypatch.setattr(run, "read", lambda answer: answer)
        return seen

    def test_every_picture_set_is_diagnosed_once(self, under_control, diagnosed):
        told: list[float] = []
        made = controlled(
            under_control, None, None, names=["shift", "faces", "halves"],  # pyright: ignore[reportArgumentType]
            progress=lambda what, share: told.append(share),
        )  # fmt: skip
        assert len(diagnosed) == 3 + 2 + 2  # as it is and either face; shifts; halves
        assert told[-1] == 1.0
        found = {one.control: one for one in made}
        assert found["shift"].hit == "yes"
        assert found["shift"].estimate_right == "yes"
        assert found["halves"].verdict_before == REFUSED
        assert found["halves"].hit == "yes"

    def test_pictures_that_nothing_was_planted_in_are_compared_with_none(self, under_control, diagnosed):
        """A series over time has no pictures without its drift: no change is known, which is not a change of 0."""
        table = under_control.data.table
        series = table[(table["side"] == "up") & (table["capture"] == table["capture"].min())]
        table = pd.concat([series.assign(observation=number) for number in (1, 2, 3)], ignore_index=True)
        over_time = replace(under_control, data=replace(under_control.data, table=table))
        made = controlled(over_time, None, None, names=["observations"])  # pyright: ignore[reportArgumentType]
        assert [one.control for one in made] == ["observations"] * 2
        assert all(np.isnan(one.largest_shift) for one in made)

    def test_what_is_planted_shows_also_where_the_diagnosis_is_refused(self, under_control, diagnosed, monkeypatch):
        def refuse(captures, emulator, calibration, options):
            raise DiagnosisError("not today")

        monkeypatch.setattr(run, "diagnose", refuse)
        made = controlled(under_control, None, None, names=["shift"])  # pyright: ignore[reportArgumentType]
        assert [(one.verdict, one.hit) for one in made] == [(REFUSED, "no")] * 2
        assert all(one.largest_shift > 1 for one in made)


def _answer(captures: Captures) -> Reading:
    """Names an offset where outlines lie towards the planted direction, and estimates it by their first harmonic."""
    first = 2 * np.fft.rfft(captures.radii, axis=1)[:, 1].conj().mean() / captures.radii.shape[1]
    estimates = {"camera-offset": Estimate(abs(first), float(np.rad2deg(np.angle(first))))}
    angle = np.deg2rad(SHIFT_DIRECTION)
    along = (first * np.exp(-1j * angle)).real
    named = frozenset({"camera-offset"} if along > 1e-3 else ())
    return Reading("effect" if named else "none", 0.01, named, {frozenset(): 1.0}, estimates)
