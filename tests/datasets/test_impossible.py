"""Silhouettes that no cloth on the plate can show stop what would compute from them; odd but possible ones do not."""

import json
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from toy_cloths import draw, wavy_profile, write_image, write_toy
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.audit.audit import audit
from cusick_bench.datasets.impossible import ImpossibleSilhouettes, impossible, require_possible
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.sim.effects import registered

FABRIC = "data/Fabric 7"
PICTURE = f"{FABRIC}/silhouettes/Fabric_7_Sample_1_Capture_1.png"
OTHER = f"{FABRIC}/silhouettes/Fabric_7_Sample_2_Capture_1.png"
DRAPE = wavy_profile(8)


@pytest.fixture
def lab(tmp_path) -> Path:
    root = write_toy(tmp_path / "my lab", captures=1, meshes=False)
    (root / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\n7,0.2,0.0004\n")
    return root


def _photograph() -> np.ndarray:
    """A cloth lit from one side, with texture, on a table that darkens towards the corners."""
    rows, columns = np.indices((256, 256))
    weave = 0.08 * np.sin(columns / 2.0) * np.sin(rows / 2.0)
    cloth = 0.72 + 0.1 * (columns - 128) / 128 + weave
    table = 0.15 + 0.2 * np.hypot(columns - 128, rows - 128) / 181
    return np.where(draw(DRAPE) >= 0.5, cloth, table)


def _block(value: float, rows: slice, columns: slice) -> np.ndarray:
    pixels = draw(DRAPE)
    pixels[rows, columns] = value
    return pixels


IMPOSSIBLE: dict[str, tuple[str, Callable[[], np.ndarray]]] = {
    "grey cloth": ("image-grey", lambda: 0.8 * draw(DRAPE)),
    "grey ground": ("image-grey", lambda: 0.1 + 0.9 * draw(DRAPE)),
    "ground a little grey": ("image-grey", lambda: 0.008 + 0.992 * draw(DRAPE)),
    "photograph": ("image-grey", _photograph),
    "at the border": ("touches-border", lambda: draw(DRAPE, centre=(127.5, 215.0))),
    "beyond its own size": ("radius-beyond-cloth", lambda: draw(DRAPE, scale=1000.0)),
    "not covering the plate": ("shrunken-image", lambda: draw(DRAPE, scale=300.0)),
    "a hole": ("hole", lambda: _block(0.0, slice(120, 128), slice(150, 158))),
    "two pieces": ("two-blobs", lambda: _block(1.0, slice(5, 25), slice(5, 25))),
    "far off centre": ("far-off-centre", lambda: draw(DRAPE, centre=(155.5, 127.5))),
    "nothing": ("empty-image", lambda: 0.0 * draw(DRAPE)),
    "cloth and ground exchanged": ("inverted-image", lambda: 1.0 - draw(DRAPE)),
}
POSSIBLE = {
    "clean": lambda: draw(DRAPE),
    "ground one level from white": lambda: 0.004 + 0.996 * draw(DRAPE),
    "soft edge": lambda: np.clip(0.5 + (draw(DRAPE, scale=723.0) + draw(DRAPE, scale=735.0) - 1) / 3, 0, 1).round(),
    "a speck": lambda: _block(1.0, slice(10, 13), slice(126, 129)),
    "a pin hole": lambda: _block(0.0, slice(120, 123), slice(150, 153)),
    "11 px off centre": lambda: draw(DRAPE, centre=(127.5, 139.0)),
    "scale 10 % off": lambda: draw(DRAPE, scale=795.0),
    "a shrunken picture": lambda: draw(DRAPE, scale=540.0),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_impossible_silhouettes_are_refused_and_named(lab, case):
    kind, make = IMPOSSIBLE[case]
    write_image(lab / PICTURE, make())
    dataset = load(lab)
    assert {(fault.path, fault.kind) for fault in impossible(dataset, range(len(dataset)))} >= {(PICTURE, kind)}
    assert audit(lab).impossible == (PICTURE,)
    with pytest.raises(
        ImpossibleSilhouettes, match="1 of the silhouettes to be used shows no cloth on its plate"
    ) as one:
        require_possible(dataset, range(len(dataset)))
    assert PICTURE in str(one.value)
    assert f"data audit '{lab}'" in str(one.value)
    assert "--force" in str(one.value)
    assert require_possible(dataset, [1, 2]) == ()  # the picture is not used
    forced = require_possible(dataset, range(len(dataset)), force=True)
    assert any(PICTURE in fault and f"({kind})" in fault for fault in forced)


@pytest.mark.parametrize("case", POSSIBLE)
def test_odd_but_possible_silhouettes_pass(lab, case):
    write_image(lab / PICTURE, POSSIBLE[case]())
    dataset = load(lab)
    assert require_possible(dataset, range(len(dataset))) == ()
    assert audit(lab).impossible == ()


def test_limits_go_with_the_protocol(lab):
    """The same drapes at twice the pixels, beside the middle of larger images, are as possible as before."""
    protocol = {"image_size_px": 512, "px_per_m": 1000, "centre_px": [240, 262], "foreground": "light"}
    (lab / "protocol.json").write_text(json.dumps(protocol))
    pixels = draw(DRAPE, size=512, centre=(240.0, 262.0), scale=1000.0)
    for sample in (1, 2, 3):
        write_image(lab / FABRIC / "silhouettes" / f"Fabric_7_Sample_{sample}_Capture_1.png", 1 - pixels)
    dataset = load(lab)
    assert require_possible(dataset, range(3)) == ()
    write_image(lab / PICTURE, 1 - np.roll(pixels, 45, axis=1))
    (fault,) = impossible(load(lab), range(3))
    assert (fault.path, fault.kind) == (PICTURE, "far-off-centre")


def test_the_shipped_set_is_not_measured(tmp_path, monkeypatch):
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path / "none"))
    dataset = load("synthetic")
    assert impossible(dataset, range(len(dataset))) == []
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_every_picture_of_the_release_is_possible(real_data):
    assert audit(real_data).impossible == ()


def _command(*arguments: str):
    return CliRunner().invoke(app, list(arguments))


def test_run_stops_before_anything_is_simulated_unless_forced(lab, tmp_path):
    write_image(lab / OTHER, _photograph())
    arguments = (
        "run",
        "--data",
        str(lab),
        "--solver",
        "null:disc",
        "--vertices",
        "97",
        "--out",
        str(tmp_path / "runs"),
    )
    refused = _command(*arguments)
    assert refused.exit_code == 2
    assert not list((tmp_path / "runs").rglob("result.json"))
    forced = _command(*arguments, "--force")
    assert forced.exit_code == 0
    record = json.loads((tmp_path / "runs" / "run.json").read_text())
    assert len(record["forced"]) == 1
    assert record["forced"][0].startswith(f"{OTHER}: not black and white: ")


def test_a_diagnosis_refuses_what_it_would_use_and_notes_what_was_forced(lab):
    write_image(lab / PICTURE, _photograph())
    dataset = load(lab)
    with pytest.raises(ImpossibleSilhouettes, match=r"not black and white.*--force"):
        read_captures(dataset, "fabric_7")
    captures = read_captures(dataset, "fabric_7", force=True)
    assert len(captures) == 3
    assert any(note.startswith(f"forced: {PICTURE}: not black and white") for note in captures.notes)


def test_diagnose_and_paper_tables_stop_too(lab, tmp_path):
    write_image(lab / PICTURE, _photograph())
    out = tmp_path / "out"
    refused = _command("diagnose", str(lab), "--samples", "0", "--out", str(out))
    assert refused.exit_code == 2
    assert not list(out.rglob("diagnosis.json"))
    others = sorted(set(registered()) - {"creep"})  # to save time
    options = ("--samples", "0", *(word for name in others for word in ("--without-effect", name)))
    forced = _command("diagnose", str(lab), *options, "--out", str(out), "--force")
    assert forced.exit_code == 0
    document = json.loads((out / "fabric_7" / "diagnosis.json").read_text())
    assert any(note.startswith(f"forced: {PICTURE}") for note in document["notes"])
    again = ["cusick-bench", "diagnose", str(lab), "--fabric", "fabric_7", *options, "--seed", "0", "--force"]
    assert shlex.split(document["made"]["command"]) == again
    table = _command("paper", "table-1", "--data", str(lab), "--solver", "null:disc", "--out", str(tmp_path / "table"))
    assert table.exit_code == 2
    assert not list((tmp_path / "table").rglob("result.json"))


@pytest.mark.parametrize(("damage", "option"), [("two pieces", "--force"), ("no picture", "--quiet")])
def test_a_picture_that_cannot_be_read_stops_a_run_before_it_is_fitted(lab, tmp_path, damage, option):
    """The fit used up its budget, and failed when it was to be scored; `--force` had been the advice."""
    if damage in IMPOSSIBLE:
        write_image(lab / OTHER, IMPOSSIBLE[damage][1]())
        with pytest.raises(ImpossibleSilhouettes, match="; --force takes all but those that show no single cloth"):
            require_possible(load(lab), range(3))
    else:
        (lab / OTHER).write_bytes(damage.encode())
    out = tmp_path / "runs"
    options = ("--solver", "null:disc", "--vertices", "97", "--out", str(out))
    refused = _command("run", "--data", str(lab), *options, option)
    assert refused.exit_code == 2
    assert f"{OTHER}: " in refused.output.replace("\n", "")
    assert not list(out.rglob("result.json"))


def test_a_picture_that_a_diagnosis_leaves_out_is_not_said_to_be_forced(lab):
    write_image(lab / PICTURE, IMPOSSIBLE["two pieces"][1]())
    captures = read_captures(load(lab), "fabric_7", force=True)
    assert len(captures) == 2
    assert [note.partition(":")[0] for note in captures.notes] == ["left out"]
