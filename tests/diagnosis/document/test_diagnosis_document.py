"""The diagnosis document: in the file as in memory; a damaged file is refused with the place of what is wrong."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.document.answer import (
    Answer,
    BudgetShare,
    Closure,
    NextMeasurement,
    StatedCause,
    Unexplained,
)
from cusick_bench.diagnosis.document.build import refused_document
from cusick_bench.diagnosis.document.laboratory import LaboratoryDocument, laboratory_document, write_laboratory
from cusick_bench.diagnosis.document.model import (
    BaseParameters,
    Cause,
    DataCounts,
    DiagnosisDocument,
    EffectSet,
    Fit,
    Gap,
    GroupGap,
    MappedLocation,
    ParameterValue,
    Profile,
    Profiles,
    Provenance,
    Resolution,
    StatisticRow,
)
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.laboratory.shared_effects import Laboratory
from cusick_bench.diagnosis.measure.captures import Captures, captures_from_profiles

FULL = DiagnosisDocument(
    fabric="fabric <7>",
    headline="Something \N{GREEK SMALL LETTER THETA}.",
    verdict="effect",
    gap=Gap(base=0.1 + 0.2, floor=-0.01, p=0.0025, effect=None, groups={"size": GroupGap(gap=1e-300, floor=0.1)}),
    causes=(
        Cause(
            effect="creep",
            stage="history",
            probability=0.9,
            acting=0.95,
            parameters={"loss": ParameterValue(value=0.4, unit="1", ci90=(0.3, 0.5))},
            summary="The cloth sinks.",
            named=True,
        ),
    ),
    set90=("creep",),
    where=MappedLocation(
        stage={"history": 0.9},
        map=((1 / 64,) * 16,) * 4,
        angle_deg=(22.5, 405.0),
        localisable=True,
        null_map=((1 / 64,) * 16,) * 4,
        null_p=0.02,
        resolution=Resolution(angle_deg=45.0, radius_m=0.03),
    ),
    next=(NextMeasurement(name="weigh", what="Weigh it.", bits=0.3, about=("creep",)),),
    effects=("creep",),
    budget=(BudgetShare(effect="creep", share=0.7, ci90=(0.6, 0.8)),),
    unexplained=Unexplained(share=0.3, ci90=(0.2, 0.4)),
    sets=(EffectSet(effects=("creep",), probability=0.9),),
    fit=Fit(base=3.1, novelty_p=0.4, misfit=0.7),
    with_effect=("creep:loss=0.4",),
    base=BaseParameters(bending=-7.1),
    data=DataCounts(samples=3, captures=6, up=3, down=3, later=0, areal_density_kg_m2=0.2),
    statistics=(StatisticRow(name="mean_radius", group="size", unit="m", up=0.13, base=0.12, z=4.0),),
    profiles=Profiles(data=(Profile(sample=1, side="up", radii_m=(0.12, 0.13)),)),
    provenance=Provenance(version="1", command="cusick-bench diagnose", atlas="19 effects"),
)


def damaged(path: Path, place: tuple[str | int, ...], value: Any) -> Path:
    """The full document's file with one value replaced."""
    content = json.loads(json.dumps(FULL.content()))
    target = content
    for key in place[:-1]:
        target = target[key]
    target[place[-1]] = value
    path.write_text(json.dumps(content))
    return path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    FULL.write(tmp_path / "diagnosis.json")
    read = DiagnosisDocument.read(tmp_path / "diagnosis.json")
    assert read == FULL
    read.write(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "diagnosis.json").read_bytes()


def test_lists_of_effects_are_read_also_where_they_are_empty(tmp_path: Path) -> None:
    for effect in ([], ["creep"], ["creep", "plate-tilt"], "creep", None):
        file = damaged(tmp_path / "diagnosis.json", ("closure",), {"effect": effect})
        expected = () if effect is None else (effect,) if isinstance(effect, str) else tuple(effect)
        assert DiagnosisDocument.read(file).closure.effect == expected


def test_nothing_is_left_of_the_gap_where_no_effect_takes_a_share() -> None:
    assert FULL.share_left == 0.3
    assert FULL.model_copy(update={"budget": ()}).share_left is None
    assert FULL.model_copy(update={"unexplained": Unexplained()}).share_left is None
    assert "share_left" not in FULL.content()


def test_keys_of_the_file() -> None:
    """Files of earlier versions, and programs that read them, rely on these."""
    content = FULL.content()
    assert list(content["causes"][0]) == [
        "effect", "class", "probability", "acting", "parameters", "summary", "named",
    ]  # fmt: skip
    assert content["made"]["command"] == "cusick-bench diagnose"
    assert content["gap"]["base"] == 0.1 + 0.2  # to the last digit
    assert content["where"]["angle_deg"] == [22.5, 405.0]
    assert "notes" not in content  # never given


def test_what_is_missing_is_unknown() -> None:
    """And keys that no field has, from a later version, are passed over."""
    read = DiagnosisDocument.parse('{"fabric": "a", "verdict": "none", "later": 1}', "here")
    assert read == DiagnosisDocument(fabric="a", verdict="none")
    assert read.gap.base is None
    assert read.where.map is None
    assert read.statistics == ()


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (
            ("verdict",),
            "maybe",
            r"verdict: .*'several', 'ambiguous', 'unknown' or 'refused', got 'maybe'",
        ),
        (("causes", 0, "probability"), "high", r"causes\[0\]\.probability: .*number, got 'high'"),
        (("causes", 0, "probability"), 1.2, r"causes\[0\]\.probability: .*less than or equal to 1"),
        (("causes", 0, "effect"), None, r"causes\[0\]\.effect: .*string, got None"),
        (("causes", 0), 3, r"causes\[0\]: "),
        (("gap", "base"), True, r"gap\.base: .*number, got True"),
        (("gap", "base"), 10**400, "too large: it has 401 digits"),
        (("gap", "p"), float("nan"), "NaN is no JSON number; write null"),
        (("gap", "groups"), [], r"gap\.groups: "),
        (("where", "angle_deg"), [1.0], r"where\.angle_deg\[1\]: Field required"),
        (("where", "map"), [[0.0] * 16] * 3, r"where\.map: .*at least 4 items"),
        (("where", "map", 2), [0.0] * 17, r"where\.map\[2\]: .*at most 16 items"),
        (("data", "samples"), 2.5, r"data\.samples: .*integer"),
        (("profiles", "data", 0, "side"), "left", r"profiles\.data\[0\]\.side: "),
        (("profiles", "data", 0, "radii_m", 1), None, r"profiles\.data\[0\]\.radii_m\[1\]: .*number, got None"),
        (("fabric",), "\ud800", "no valid diagnosis"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, message: str
) -> None:
    with pytest.raises(DiagnosisError, match=message) as caught:
        DiagnosisDocument.read(damaged(tmp_path / "diagnosis.json", place, value))
    assert "diagnosis.json" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "cannot be read as JSON"),
        ("[]", "is no valid diagnosis"),
        ("null", "is no valid diagnosis"),
        ('{"fabric": "a"', "cannot be read as JSON"),
        ("[" * 100_000, "is nested deeper than 64 levels"),
        ("\xff", "must be UTF-8 text, got byte 0xff"),
    ],
)
def test_what_is_no_document_is_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "diagnosis.json"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(DiagnosisError, match=rf"diagnosis\.json:? {message}"):
        DiagnosisDocument.read(path)


def test_no_file_no_document(tmp_path: Path) -> None:
    with pytest.raises(DiagnosisError, match=r"nothing\.json: cannot be read .*; give a diagnosis\.json"):
        DiagnosisDocument.read(tmp_path / "nothing.json")


def test_documents_stay_as_they_are() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        FULL.verdict = "none"  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValidationError, match="finite"):
        StatedCause(effect="creep", probability=0.5, parameters={"loss": float("inf")})


def test_a_refusal_has_the_keys_of_any_diagnosis() -> None:
    """Who reads the gap or the named effects of many fabrics meets no fabric without them."""
    found = refused_document("a", "one sample only", command="", version="1").content()
    keys = {"effects", "groups", "budget", "unexplained", "gap", "causes", "set90", "where", "closure", "next"}
    assert found.keys() >= keys
    assert (found["verdict"], found["refused"], found["effects"], found["causes"]) == (
        "refused", "one sample only", [], [],
    )  # fmt: skip
    assert found["closure"] == {"effect": [], "fraction": None, "ci90": None}
    assert (found["unexplained"]["share"], found["gap"]["base"], found["where"]["map"]) == (None, None, None)
    assert DiagnosisDocument.parse(json.dumps(found), "here").content() == found


def test_an_answer_holds_what_was_given() -> None:
    answer = Answer(verdict="unknown", causes=(StatedCause(effect="unknown", probability=1.0),), refused="no samples")
    expected = {"verdict": "unknown", "causes": [{"effect": "unknown", "probability": 1.0}], "refused": "no samples"}
    assert answer.content() == expected
    assert Answer.parse(json.dumps(expected), "here") == answer


@pytest.mark.parametrize(
    ("written", "read"), [(None, ()), ("creep", ("creep",)), (["creep", "cut-size"], ("creep", "cut-size"))]
)
def test_closures_of_earlier_files_name_one_effect(written: Any, read: tuple[str, ...]) -> None:
    assert Closure.parse(json.dumps({"effect": written, "fraction": 0.5}), "here").effect == read


def _pictures(fabric: str, radii: np.ndarray, protocol: Protocol | None = None) -> Captures:
    numbers = np.arange(len(radii))
    return captures_from_profiles(
        radii, sample=numbers, side=["up"] * len(radii), capture=numbers * 0 + 1, fabric=fabric, protocol=protocol
    )


def test_the_laboratory_of_an_earlier_run_does_not_stay_where_there_is_none(tmp_path: Path) -> None:
    write_laboratory(LaboratoryDocument(fabrics=("a", "b"), effects=()), tmp_path)
    assert json.loads((tmp_path / "laboratory.json").read_text())["fabrics"] == ["a", "b"]
    write_laboratory(None, tmp_path)
    write_laboratory(None, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_laboratory_says_which_pictures_count_twice_and_what_its_lengths_are_in() -> None:
    radii = 0.12 + 0.01 * np.random.default_rng(1).random((9, 360))
    captures = {
        "fabric_2": _pictures("fabric_2", radii[:6]),
        "cotton": _pictures("cotton", radii[4:7]),
        "wool": _pictures("wool", radii[7:]),
    }
    (note,) = laboratory_document(Laboratory(tuple(captures), (), {}), captures).notes
    assert note.startswith("fabric_2 and cotton share 2 pictures")
    small = {name: _pictures(name, radii[7:] * 0.8, Protocol(cloth_radius_m=0.12)) for name in ("wool", "silk")}
    lengths, shared = laboratory_document(Laboratory(tuple(small), (), {}), small).notes
    assert lengths.endswith("for this one, of 120 mm, multiply them by 0.8")
    assert shared.startswith("wool and silk share 2 pictures")
    alone = {"wool": captures["wool"], "fabric_2": captures["fabric_2"]}
    assert laboratory_document(Laboratory(tuple(alone), (), {}), alone).notes == ()
