"""Which way up the pictures of the lower face are."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_cloths import write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.laboratory import turn_over as module
from cusick_bench.diagnosis.inference.laboratory.turn_over import WAYS, TurnOver, Way, read_as, turn_over
from cusick_bench.diagnosis.inference.sets import fabric_sets
from cusick_bench.diagnosis.measure.captures import Captures, read_captures

DEGREES = np.arange(360)


@pytest.fixture(scope="module")
def lopsided() -> Captures:
    """A simulated fabric that lies 6 mm aside in the camera's frame, and is drawn out along 20 degrees of the cloth."""
    plain = read_captures(load("synthetic"), "fabric_2")
    lean = 6e-3 * np.cos(np.deg2rad(DEGREES - 40))
    drawn_out = np.empty_like(plain.radii)
    np.put_along_axis(drawn_out, plain.seen_at(), 4.5e-3 * np.cos(2 * np.deg2rad(DEGREES - 20))[None], axis=1)
    return replace(plain, radii=plain.radii + lean + drawn_out)


def test_ways_are_their_own_inverses_and_leave_the_upper_face(lopsided: Captures) -> None:
    up = lopsided.side == "up"
    for way in WAYS:
        once = read_as(lopsided, way)
        assert np.array_equal(once.radii[up], lopsided.radii[up])
        assert np.array_equal(read_as(once, way).radii, lopsided.radii)
        assert way == "as-said" or not np.array_equal(once.radii, lopsided.radii)
    both = read_as(read_as(lopsided, "mirrored-x"), "mirrored-y")
    assert np.array_equal(both.radii, read_as(lopsided, "other-axis").radii)


def test_the_other_axis_is_what_the_protocol_means_by_it(lopsided: Captures) -> None:
    about_x = replace(lopsided, protocol=Protocol(turn_over="about x"))
    assert np.allclose(read_as(lopsided, "other-axis").cloth_frame(), about_x.cloth_frame())


@pytest.mark.slow
def test_mirrored_pictures_are_found(lopsided: Captures, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fabric_sets, "HIDDEN", {})  # fewer beginnings, for time
    emulator, calibration = load_atlas()
    found = turn_over([read_as(lopsided, "mirrored-x")], emulator, calibration)
    assert found.told == "mirrored-x"
    assert found.wrong
    assert set(found.total) == set(WAYS)


def test_log_densities_of_fabrics_add_up_and_need_a_margin_that_grows() -> None:
    one: dict[Way, float] = {"as-said": 0.0, "other-axis": -30.0, "mirrored-x": 8.0, "mirrored-y": -30.0}
    assert TurnOver({"a": one}, {}).told is None
    assert not TurnOver({"a": one}, {}).wrong
    two = TurnOver({"a": one, "b": one}, {})
    assert (two.told, two.wrong) == ("mirrored-x", True)  # 16 nat, of 14
    assert two.least == pytest.approx(10 * 2**0.5)
    level: dict[Way, float] = {"as-said": 0.0, "other-axis": -30.0, "mirrored-x": 20.0, "mirrored-y": 19.0}
    assert (TurnOver({"a": level}, {}).told, TurnOver({"a": level}, {}).wrong) == (None, True)
    sure: dict[Way, float] = {"as-said": 0.0, "other-axis": -11.0, "mirrored-x": -12.0, "mirrored-y": -13.0}
    assert TurnOver({"a": sure}, {}).told == "as-said"


def test_one_face_tells_nothing(lopsided: Captures) -> None:
    emulator, calibration = load_atlas()
    found = turn_over([lopsided.select(lopsided.side == "up")], emulator, calibration)
    assert not found.by_fabric
    assert found.refused == {"fabric_2": "no pictures face down"}


class TestCommand:
    @pytest.fixture
    def answered(self, monkeypatch: pytest.MonkeyPatch) -> dict[Way, float]:
        """Nat of each way that the comparison is made to give."""
        nat: dict[Way, float] = {"as-said": 0.0, "other-axis": 40.0, "mirrored-x": 3.0, "mirrored-y": 1.0}
        monkeypatch.setattr(module, "turn_over", lambda captures, *given, **more: TurnOver({"fabric_1": nat}, {}))
        return nat

    def test_the_other_axis_comes_with_its_remedy(self, answered: dict[Way, float]) -> None:
        done = CliRunner().invoke(app, ["diagnose-turn-over", "synthetic", "--fabric", "fabric_1"])
        assert done.exit_code == 0, done.output
        assert 'about the other axis: write "turn_over": "about x"' in " ".join(done.output.split())
        assert "40.0" in done.output

    def test_json(self, answered: dict[Way, float]) -> None:
        done = CliRunner().invoke(app, ["diagnose-turn-over", "synthetic", "--fabric", "fabric_1", "--json"])
        found = json.loads(done.stdout)
        assert (found["told"], found["wrong"], found["total"]) == ("other-axis", True, answered)

    def test_a_draw_is_said(self, answered: dict[Way, float]) -> None:
        answered["other-axis"] = 2.0
        done = CliRunner().invoke(app, ["diagnose-turn-over", "synthetic", "--fabric", "fabric_1"])
        assert "do not tell" in done.output

    def test_a_fabric_of_one_face_is_an_error(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(
            module, "turn_over", lambda captures, *given, **more: TurnOver({}, {"fabric_1": "no pictures face down"})
        )
        done = CliRunner().invoke(app, ["diagnose-turn-over", "synthetic", "--fabric", "fabric_1"])
        assert done.exit_code != 0
        assert "no pictures face down" in " ".join(done.output.split())

    def test_pictures_that_count_twice_are_named(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        nat = dict(zip(WAYS, (0.0, -12.0, -30.0, -40.0), strict=True))
        found = TurnOver({"fabric_7": nat, "fabric_8": nat}, {})
        monkeypatch.setattr(module, "turn_over", lambda captures, *given, **more: found)
        write_toy(tmp_path, fabrics=(7, 9), meshes=False)
        for picture in sorted((tmp_path / "data" / "Fabric 7" / "silhouettes").iterdir()):
            again = tmp_path / "data" / "Fabric 8" / "silhouettes" / picture.name.replace("Fabric_7", "Fabric_8")
            again.parent.mkdir(parents=True, exist_ok=True)
            again.write_bytes(picture.read_bytes())
        for options in ([], ["--json"]):
            done = CliRunner().invoke(app, ["diagnose-turn-over", str(tmp_path), *options])
            assert done.exit_code == 0, done.output
            assert "fabric_7 and fabric_8 share 12 pictures" in done.stdout

    def test_a_fabric_whose_pictures_cannot_be_used_does_not_stop_the_others(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        found = TurnOver({"fabric_7": dict(zip(WAYS, (0.0, -12.0, -30.0, -40.0), strict=True))}, {})
        monkeypatch.setattr(module, "turn_over", lambda captures, *given, **more: found)
        write_toy(tmp_path, fabrics=(7, 9), meshes=False)
        for picture in (tmp_path / "data" / "Fabric 9" / "silhouettes").iterdir():
            picture.write_bytes(b"no picture")
        done = CliRunner().invoke(app, ["diagnose-turn-over", str(tmp_path), "--json"])
        assert done.exit_code == 0, done.output
        assert "fabric_9" in json.loads(done.stdout)["refused"]
