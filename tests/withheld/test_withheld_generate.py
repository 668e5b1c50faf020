"""Withheld suites: sealed, resumable, the same from the same seed, and nothing in a case tells its label."""

import hashlib
import json
import shutil
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.files.digest import folder_digest
from cusick_bench.files.errors import FolderInUse
from cusick_bench.sim.effects import registered
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.seal import holds, published_files, salt_of, seal, sealed
from cusick_bench.withheld.suite import design
from cusick_bench.withheld.suite import generate as generate_module
from cusick_bench.withheld.suite.design import DRAWN, EFFECTS, MULTIPLES, OUTSIDE, plan_suite
from cusick_bench.withheld.suite.detectable import DetectableSeverities, read_detectable
from cusick_bench.withheld.suite.generate import Suite, generate
from cusick_bench.withheld.suite.labels import label_of
from cusick_bench.withheld.world.registry import world_of

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

COUNTS = {"null": 1, "single": 1, "pair": 1, "unknown": 1}


def suite(seed=8, **more):
    return Suite(seed, COUNTS, vertices=120, samples=1, **more)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished suite: folders of cases and of labels."""
    folder = tmp_path_factory.mktemp("withheld")
    generate(suite(), folder / "cases", folder / "labels")
    return folder / "cases", folder / "labels"


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def labels_of(folder):
    return json.loads((folder / "labels.json").read_text())


def test_a_case_is_a_data_set_in_the_public_layout(made):
    cases, _ = made
    folders = sorted(cases.glob("case_*"))
    assert [folder.name for folder in folders] == sorted(plan.case for plan in suite().plans())
    for case in folders:
        data = load(str(case))
        assert list(data.index["capture"]) == [1, 2, 3, 4]
        assert list(data.index["side"]) == ["up", "up", "down", "down"]
        assert 0.05 < data.index["areal_density"].iloc[0] < 0.35
        image = data.sample(0).image
        assert image.shape == (256, 256)
        assert image[128, 128] > 0.98
        assert image[0, 0] < 0.02


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_suite(made, tmp_path):
    cases, labels = made
    generate(suite(), tmp_path / "cases", tmp_path / "labels", workers=1)
    assert contents(tmp_path / "cases") == contents(cases)
    assert contents(tmp_path / "labels") == contents(labels)
    other = {plan.case: plan.causes for plan in suite(9).plans()}
    assert other != {plan.case: plan.causes for plan in suite().plans()}


@pytest.mark.slow
def test_processes_write_the_same_bytes(made, tmp_path):
    generate(suite(), tmp_path / "cases", tmp_path / "labels", workers=2)
    assert contents(tmp_path / "cases") == contents(made[0])


def test_a_generation_that_was_stopped_goes_on(made, tmp_path, monkeypatch):
    cases, labels = made
    copy, secret = tmp_path / "cases", tmp_path / "labels"
    shutil.copytree(cases, copy)
    shutil.copytree(labels, secret)
    shutil.rmtree(copy / "case_0002")
    (copy / ".case_0002.part" / "Fabric 1").mkdir(parents=True)  # what a killed process leaves
    written, told = [], []
    write = generate_module.write_case
    monkeypatch.setattr(
        generate_module, "write_case", lambda s, plan, out: written.append(plan.case) or write(s, plan, out)
    )
    generate(suite(), copy, secret, step=told.append)
    assert written == ["case_0002"]
    assert sorted(told) == [f"case_000{i}" for i in (1, 2, 3, 4)]
    assert contents(copy) == contents(cases)


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_a_second_process_is_refused_while_cases_are_made(tmp_path, monkeypatch):
    """It would remove the case that the first one is writing, which would then appear with a part of its pictures."""
    folders, refused = (tmp_path / "cases", tmp_path / "labels"), []

    def write(suite: Suite, plan: design.Plan, out: Path) -> str:
        with pytest.raises(FolderInUse, match=f"another process is writing into {folders[0]}; wait for it, or stop it"):
            generate(suite, *folders)
        refused.append(plan.case)
        (out / plan.case).mkdir()
        return plan.case

    monkeypatch.setattr(generate_module, "write_case", write)
    generate(suite(), *folders)
    assert len(refused) == 4
    generate(suite(), *folders)  # and let in afterwards


@pytest.mark.parametrize("recorded", [True, False])
def test_a_suite_that_other_code_began_is_not_gone_on_with(made, tmp_path, monkeypatch, recorded):
    """Its cases would be of two versions; a suite of before versions were kept may be of any."""
    cases, labels = (shutil.copytree(folder, tmp_path / folder.name) for folder in made)
    if recorded:
        monkeypatch.setattr(generate_module, "NUMERICS_VERSION", 99)
    else:
        document = json.loads((labels / "suite.json").read_text())
        del document["numerics"]
        (labels / "suite.json").write_text(json.dumps(document))
    assert len(generate(suite(), cases, labels)) == 4  # there is nothing left to make
    shutil.rmtree(cases / "case_0002")
    with pytest.raises(WithheldError, match=r"must be made by the same code.*finish it with the code that began it"):
        generate(suite(), cases, labels)
    assert not (cases / "case_0002").exists()


def test_every_label_is_sealed_before_any_answer(made):
    cases, labels = made
    published = json.loads((cases / "commitment.json").read_text())["cases"]
    found = labels_of(labels)
    assert set(found) == set(published) == {path.name for path in cases.glob("case_*")}
    for case, label in found.items():
        assert holds(label, published[case])
        plain = {key: value for key, value in label.items() if key not in ("salt", "sha256")}
        text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
        assert published[case] == hashlib.sha256((label["salt"] + text).encode()).hexdigest()
        assert not holds(label | {"severity": 1e9}, published[case])
        assert not holds(label | {"salt": "0" * 32}, published[case])
        assert not holds(label, "0" * 64)


def test_the_files_of_every_case_are_sealed_when_all_are_there(made, tmp_path):
    cases = shutil.copytree(made[0], tmp_path / "cases")
    sealed_files = published_files(cases / "commitment.json")
    assert sealed_files == {case.name: folder_digest(case) for case in cases.glob("case_*")}
    generate(suite(), cases, made[1])
    picture = next((cases / "case_0003").rglob("*.jpg"))
    picture.write_bytes(picture.read_bytes() + b" ")
    with pytest.raises(WithheldError, match="the files of case_0003 have another SHA-256"):
        generate(suite(), cases, made[1])


def test_what_a_file_manager_leaves_in_a_case_does_not_break_its_seal(made, tmp_path):
    """macOS puts .DS_Store into every folder that is looked at, Windows and disks of a network their thumbnails."""
    cases = shutil.copytree(made[0], tmp_path / "cases")
    for left in (".DS_Store", "Thumbs.db", "desktop.ini", "@eaDir/a.jpg", "__MACOSX/._a.jpg", "Fabric 1/@eaDir/a.jpg"):
        path = cases / "case_0003" / left
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"Bud1")
    generate(suite(), cases, made[1])
    (cases / "case_0003" / "Fabric 1" / "a.jpg").write_bytes(b"Bud1")
    with pytest.raises(WithheldError, match="the files of case_0003 have another SHA-256"):
        generate(suite(), cases, made[1])


def test_a_case_has_the_same_bytes_where_lines_of_text_end_otherwise(made, tmp_path, monkeypatch):
    """As on Windows, where a suite that was made again did not have the sealed bytes."""
    monkeypatch.setattr(
        Path, "write_text", lambda path, text, **options: path.write_bytes(_for_windows(text, **options))
    )
    written = tmp_path / generate_module.write_case(suite(), suite().plans()[0], tmp_path)
    assert contents(written) == contents(made[0] / written.name)


def _for_windows(text: str, encoding: str = "cp1252", newline: str | None = None, **_) -> bytes:
    return text.replace("\n", "\r\n" if newline is None else newline).encode(encoding)


def test_salts_depend_on_seed_and_case():
    salts = {salt_of(seed, case) for seed in (1, 2) for case in ("case_0001", "case_0002")}
    assert len(salts) == 4
    assert sealed({"effect": "none"}, "ab")["sha256"] == seal({"effect": "none", "sha256": "x"}, "ab")


def test_cases_hold_nothing_of_their_labels(made):
    cases, labels = made
    words = [*EFFECTS, *OUTSIDE, "severity", "seed"] + [label["salt"] for label in labels_of(labels).values()]
    for name, content in contents(cases).items():
        text = content.decode("latin-1") if not name.endswith(".jpg") else ""
        assert not [word for word in words if word in text or word in name], name
    names = {name.split("/", 1)[1] for name in contents(cases) if "/" in name}
    assert len(names) == 4 + 2  # the same files in every case
    protocols = {(case / "protocol.json").read_bytes() for case in cases.glob("case_*")}
    assert len(protocols) == 1


def test_times_of_files_tell_nothing(made):
    """How long a drape took tells whether a law with memory acted on it."""
    paths = [path for case in made[0].glob("case_*") for path in (case, *case.rglob("*"))]
    assert len(paths) == 4 * (1 + 2 + 4 + 2)
    assert len({path.stat().st_mtime_ns for path in paths}) == 1


def test_a_suite_of_world_published_is_of_one_version_of_its_law(tmp_path, monkeypatch):
    monkeypatch.setattr(generate_module, "write_case", lambda suite, plan, out: (out / plan.case).mkdir() or plan.case)
    folders = tmp_path / "cases", tmp_path / "labels"
    generate(suite(world="published"), *folders)
    (folders[0] / "case_0002").rmdir()
    monkeypatch.setattr(generate_module, "LAWS", {"paper": 1, "published": 2, "plate": 1})
    with pytest.raises(WithheldError, match=r"must be made by the same code.*law published 2"):
        generate(suite(world="published"), *folders)


@pytest.mark.parametrize("inner", ["cases/labels", "cases", "."])
def test_labels_stay_out_of_reach(tmp_path, inner):
    with pytest.raises(WithheldError, match="must lie in different folders"):
        generate(suite(), tmp_path / "cases", tmp_path / inner)
    assert not (tmp_path / "cases").exists()


def test_another_suite_is_not_mixed_in(made):
    cases, labels = made
    before = contents(cases)
    for other in (suite(9), suite(detectable=flat(creep=0.1))):
        with pytest.raises(WithheldError, match="belongs to another suite"):
            generate(other, cases, labels)
    assert contents(cases) == before


def test_cases_whose_labels_are_gone_get_no_labels_of_another_suite(made, tmp_path):
    """Labels that fit no case would stand there from then on, and refuse the right seed."""
    with pytest.raises(WithheldError, match=r"commitment.json belongs to another suite"):
        generate(suite(9), made[0], tmp_path / "labels")
    assert not (tmp_path / "labels").exists()


def test_effects_and_severities_are_spread_evenly_in_an_order_that_tells_nothing():
    singles = len(DRAWN) * len(MULTIPLES)
    plans = plan_suite(4, {"null": 60, "single": singles, "pair": 30, "unknown": 24})
    cells = Counter((name, plan.multiple) for plan in plans if plan.kind == "single" for name in plan.causes)
    assert len(cells) == singles
    assert set(cells.values()) == {1}
    assert all(len(plan.causes) == 2 for plan in plans if plan.kind == "pair")
    outside = Counter(name for plan in plans if plan.kind == "unknown" for name in plan.causes)
    assert outside == dict.fromkeys(OUTSIDE, 3)
    places = {
        kind: np.mean([p.number for p in plans if p.kind == kind]) for kind in ("null", "single", "pair", "unknown")
    }
    assert all(abs(place - 101) < 45 for place in places.values()), places
    assert [plan.case for plan in plans[:2]] == ["case_0001", "case_0002"]


def test_severities_of_single_effects_can_be_asked_for():
    counts = {"null": 2, "single": 2 * len(DRAWN), "pair": 0, "unknown": 2}
    plans = plan_suite(4, counts, multiples=(2.0, 4.0))
    single = [plan for plan in plans if plan.kind == "single"]
    assert Counter(plan.multiple for plan in single) == {2.0: len(DRAWN), 4.0: len(DRAWN)}
    suite = Suite(4, counts, multiples=(2.0, 4.0))
    assert suite.plans() == plans != Suite(4, counts).plans()


def flat(**severity: float) -> DetectableSeverities:
    """The same in every fabric."""
    return DetectableSeverities((0.0,), {name.replace("_", "-"): (value,) for name, value in severity.items()})


def test_severities_are_multiples_of_the_detectable_shift_where_it_is_known():
    plans = plan_suite(4, {"null": 0, "single": 88, "pair": 0, "unknown": 0}, flat(plate_tilt=0.7))
    for plan in plans:
        ((name, value),) = plan.causes.items()
        draw = EFFECTS[name]
        reference = {"plate-tilt": 0.7}.get(name, draw.typical)
        assert abs(value[draw.severity]) == pytest.approx(min(plan.multiple * reference, draw.most), rel=1e-3)
        label = label_of(plan).content()
        known = name == "plate-tilt"
        assert label.get("multiple") == (plan.multiple if known else None)
        assert label.get("multiple_of_typical") == (None if known else plan.multiple)


def test_the_detectable_shift_is_that_of_the_fabric():
    """A camera's offset that a limp cloth hides: only fabrics are drawn in which the multiple can be."""
    limp, stiff = -9.0, -4.0
    table = DetectableSeverities((limp, stiff), {"camera-offset": (0.012, 0.0005)})
    plans = plan_suite(6, {"null": 0, "single": 88, "pair": 0, "unknown": 0}, table)
    checked = 0
    for plan in (plan for plan in plans if "camera-offset" in plan.causes):
        stiffness = world_of("paper").fabric_of((6, plan.number), plan.attempt).stiffness
        share = (stiffness - limp) / (stiff - limp)
        here = 0.012 ** (1 - share) * 0.0005**share
        assert plan.causes["camera-offset"]["shift"] == pytest.approx(plan.multiple * here, rel=1e-3)
        assert plan.reference == "detectable"
        assert plan.multiple * here <= EFFECTS["camera-offset"].most
        checked += 1
    assert checked == 4


def test_where_no_fabric_shows_an_effect_severities_are_typical_ones():
    table = DetectableSeverities((-9.0, -4.0), {"plate-tilt": (None, 2.0)})
    plans = plan_suite(4, {"null": 0, "single": 84, "pair": 0, "unknown": 0}, table)
    assert {plan.reference for plan in plans} == {"typical"}
    assert table.at("plate-tilt", -4.0) == pytest.approx(2.0)
    assert table.at("plate-tilt", -5.0) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"stiffness": [], "severity": {}}', "levels that ascend"),
        ('{"stiffness": [1, 0], "severity": {}}', "levels that ascend"),
        ('{"stiffness": [0, 1], "severity": {"creep": [1]}}', "creep"),
        ('{"stiffness": [0], "severity": {"creep": [-1]}}', "are positive"),
        ('{"creep": 0.1}', "stiffness"),
    ],
)
def test_a_table_of_severities_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "detectable.json"
    path.write_text(text)
    with pytest.raises(WithheldError, match=message):
        read_detectable(path)


def test_a_table_of_severities_that_is_not_there_is_named_with_its_command(tmp_path):
    with pytest.raises(WithheldError, match=r"no file at .*detectable\.json; make it by `atlas power --out`"):
        read_detectable(tmp_path / "detectable.json")


def test_labels_have_the_agreed_form():
    plans = plan_suite(4, {"null": 1, "single": 88, "pair": 10, "unknown": 8})
    for plan in plans:
        label = label_of(plan).content()
        assert {"effect", "class", "severity", "parameters", "location", "oracle_closure"} <= set(label)
        if plan.kind == "null":
            assert label["effect"] == label["class"] == "none"
        if plan.kind == "unknown":
            assert label["effect"] == "unknown"
            assert label["name"] in OUTSIDE
        if plan.kind == "pair":
            assert len(label["effect"]) == len(label["severity"]) == len(label["location"]) == 2
        if plan.kind == "single":
            assert (label["location"] is not None) == (
                label["effect"].startswith("local-") or label["effect"] == "rim-stiffening"
            )
            if label["location"] and label["location"]["kind"] == "patch":
                (a, b), (inner, outer) = label["location"]["angle_deg"], label["location"]["radius_m"]
                value = label["parameters"]
                assert ((b - a) % 360) / 2 == pytest.approx((value["direction"] - a) % 360, abs=0.02)
                assert inner < value["radius"] < outer <= 0.15


@pytest.mark.parametrize(
    ("counts", "detectable", "message"),
    [
        ({"null": 0, "single": 0, "pair": 0, "unknown": 0}, None, "needs at least one case"),
        (COUNTS, {"gremlins": 1.0}, "known effects, got 'gremlins'"),
    ],
)
def test_a_suite_that_cannot_be_is_refused(counts, detectable, message):
    with pytest.raises(WithheldError, match=message):
        plan_suite(1, counts, detectable and flat(**detectable))


def test_severities_of_other_packages_effects_do_not_count(monkeypatch):
    """`atlas power` has a row for each effect of an atlas, and no world can do those of other packages."""
    monkeypatch.setattr(design, "registered", lambda: {**registered(), "weak-gravity": None})
    few = flat(**{"plate-tilt": 1.0})
    more = flat(**{"plate-tilt": 1.0, "weak-gravity": 0.1})
    assert plan_suite(1, COUNTS, more) == plan_suite(1, COUNTS, few)


def test_the_command_makes_a_suite_and_goes_on_without_being_told_the_seed(tmp_path):
    few = ["--nulls", "1", "--singles", "1", "--pairs", "0", "--unknown", "0", "--vertices", "120", "--samples", "1"]
    where = ["--out", str(tmp_path / "cases"), "--labels", str(tmp_path / "labels"), "--workers", "1", "--json"]
    first = CliRunner().invoke(app, ["withheld", "generate", *few, *where])
    assert first.exit_code == 0, first.output
    document = json.loads(first.stdout)
    assert len(document["cases"]) == 2
    seed = json.loads((tmp_path / "labels" / "suite.json").read_text())["seed"]
    assert seed > 2**64  # cannot be guessed
    assert str(seed) not in (tmp_path / "cases" / "commitment.json").read_text()
    shutil.rmtree(tmp_path / "cases" / "case_0001")
    again = CliRunner().invoke(app, ["withheld", "generate", *few, *where])
    assert again.exit_code == 0
    assert (tmp_path / "cases" / "case_0001").is_dir()
    within = CliRunner().invoke(
        app, ["withheld", "generate", *few, "--out", str(tmp_path), "--labels", str(tmp_path / "x")]
    )
    assert within.exit_code == 2
    assert "different folders" in within.stderr
