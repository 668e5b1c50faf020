"""The page of a diagnosis: valid, self-contained, true to its document for every verdict, robust against what lacks."""

import re
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from made_up_diagnosis import (
    BASE,
    EMPTY,
    NO_PROFILES,
    causes,
    document,
    made_up_profiles,
    parsed,
    small_document,
    statistic,
)

from cusick_bench.report.diagnosis.page import diagnosis_page, write_diagnosis_page
from cusick_bench.report.diagnosis.sections.statistics import statistic_table
from cusick_bench.report.diagnosis.wording.number_format import percent


def page(content: dict, folder: Path) -> Page:
    return Page(write_diagnosis_page(parsed(content), folder / "diagnosis.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def profiles() -> dict[str, list[dict]]:
    return made_up_profiles()


VERDICTS = ("effect", "patch", "ambiguous", "unknown", "none")


@pytest.fixture(scope="module")
def pages(profiles, tmp_path_factory) -> dict[str, Page]:
    folder = tmp_path_factory.mktemp("pages")
    return {verdict: page(document(profiles, verdict), folder) for verdict in VERDICTS}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_page_asks_nothing_of_the_network_and_runs_nothing(pages, verdict):
    assert pages[verdict].asks_for() == []


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_graph_has_words_for_those_who_cannot_see_it(pages, verdict):
    graphs = [one for one in pages[verdict].all("svg") if one.get("aria-hidden") != "true"]
    assert len(graphs) >= 10
    for graph in graphs:
        assert graph["role"] == "img"
        assert len(graph["aria-label"] or "") > 15


def test_verdict_is_said_first_and_differs(pages):
    said = {"effect": "One cause found", "ambiguous": "Several causes possible", "unknown": "Unknown cause"}
    for verdict, words in (said | {"patch": "One cause found", "none": "No unmodelled effect"}).items():
        assert pages[verdict].text.index(words) < pages[verdict].text.index("Does simulation differ")
    assert "The cloth lay about 8 mm off" in pages["effect"].text
    # Without a headline, the verdict's own sentence.
    assert "no effect on the list explains" in pages["unknown"].text
    assert "within their natural spread" in pages["none"].text


def test_numbers_of_the_document_are_on_the_page(pages):
    text = pages["effect"].text
    for expected in ("0.087", "0.013", "6.9 times its floor", "p < .001", "83 %", "closes 78 %", "55 % to 93 %"):
        assert expected in text, expected
    assert "12 samples, 48 pictures (24 face up and 24 face down)" in text
    assert "cusick-bench diagnose DATA --fabric 7" in text
    assert "Fabric 7 (cotton <twill>)" in text
    assert "62 times in 100" in pages["none"].text


def test_the_gap_is_not_said_to_be_between_equal_numbers_of_samples(pages):
    """Half of a fabric's samples are unseen; how many are simulated is `--samples`."""
    caption = pages["effect"].text.split("The gap compares")[1].split("floor")[0]
    assert "unseen samples with those of simulated ones" in caption


def test_a_cloth_is_said_to_be_fitted_with_or_without_causes(pages, profiles, tmp_path):
    assert "Fitted without any cause." in pages["none"].text
    made = document(profiles) | {"effects": ["off-centre"], "with_effect": ["off-centre:shift=0.008,direction=40"]}
    assert "Fitted together with the likeliest causes." in page(made, tmp_path).text


def test_causes_are_ranked_and_the_likely_ones_explained(pages):
    text = pages["ambiguous"].text.split("What causes it?")[1]
    places = [text.index(name) for name in ("plate-radius", "cut-size", "camera-scale", "threshold")]
    assert places == sorted(places)
    assert text.count("in the 90 % set") == 4
    assert "error 1.0 mm" in text
    # Causes outside the set have no parameters that nobody should believe.
    assert "angle 1" not in pages["effect"].text.split("plate-tilt", 1)[1].split("unknown")[0]


def test_named_effects_come_first_with_the_probability_that_they_act(profiles, tmp_path):
    """Of two effects that act, one accounts for most; the other, with next to no chance of that, is as well named."""
    made = document(profiles) | {"verdict": "several", "effects": ["camera-offset", "rest-curvature"]}
    made["causes"] = causes(camera_offset=0.98, plate_tilt=0.01, rest_curvature=0.002, creep=0.001)
    acting = {"camera-offset": 0.97, "plate-tilt": 0.06, "rest-curvature": 0.99, "creep": 0.11}
    for cause in made["causes"]:
        cause["acting"] = acting[cause["effect"]]
    shown = diagnosis_page(parsed(made))
    cards = [(card.name, card.shown_probability, card.likely) for card in shown.causes.cards]
    assert cards == [
        ("rest-curvature", percent(0.99), True),
        ("camera-offset", percent(0.97), True),
        ("creep", percent(0.11), False),
        ("plate-tilt", percent(0.06), False),
    ]
    assert all(card.parameters and "named" in card.remarks for card in shown.causes.cards[:2])
    assert f"accounts for most with probability {percent(0.002)}" in shown.causes.cards[0].remarks
    assert [fact[:2] for fact in shown.verdict.facts if fact[0] == "acts"] == [
        ("acts", "rest-curvature"),
        ("acts", "camera-offset"),
    ]


def test_closure_that_may_be_nothing_is_said_so(pages):
    assert "may close nothing at all" in pages["patch"].text
    assert "may close nothing at all" not in pages["effect"].text
    assert "There is no gap to close" in pages["none"].text


def test_a_gap_that_was_not_measured_is_not_denied(tmp_path):
    made = small_document() | {"verdict": "none", "closure": {}, "gap": {"p": 0.6}}
    text = page(made, tmp_path).text
    assert "The gap was not measured" in text
    assert "Not given: the gap was not measured." in text
    assert "no gap to close" not in text


@pytest.mark.parametrize("verdict", ["ambiguous", "unknown"])
@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "cause was named that could be simulated"),
        (["plate-tilt:angle=3"], "Not given: the cause was not simulated"),
        (["plate-tilt:angle=3", "camera-scale:error=0.01"], "Not given: the causes were not simulated"),
    ],
)
def test_causes_that_stand_for_look_alikes_can_be_simulated(verdict, arguments, reason, tmp_path):
    """The likeliest of a group is held by models, though it is not named."""
    made = small_document() | {"verdict": verdict, "closure": {}, "with_effect": arguments, "effects": []}
    assert reason in page(made, tmp_path).text


def test_unknown_cause_sends_nobody_to_useless_measurements(tmp_path):
    text = page(document(NO_PROFILES, "unknown") | {"next": []}, tmp_path).text
    assert "separate known causes, and this is none of them" in text
    claims_nothing = EMPTY | {"verdict": "unknown", "set90": ["unknown"], "causes": causes(unknown=1.0)}
    assert "true cause is among these" not in page(claims_nothing, tmp_path).text


def test_a_floor_below_zero_makes_no_ratio(tmp_path):
    made = document(NO_PROFILES, "unknown") | {"gap": {"base": 0.81, "floor": -0.0073, "p": 0.0025}}
    text = page(made, tmp_path).text
    assert "0.81 floor −0.0073" in text
    assert "The gap exceeds its floor." in text
    assert "times its floor" not in text
    assert "2.5 times in 1000" in text
    tiny = page(made | {"gap": {"base": 0.85, "floor": 0.0013, "p": 0.0025}}, tmp_path).text
    assert "0.85 floor 0.0013" in tiny
    for left, words in ((0.6, "leaves less"), (0.9, "leaves no less")):
        held = page(made | {"gap": {"base": 0.81, "floor": -0.0073, "p": 0.0025, "effect": left}}, tmp_path).text
        assert f"The gap exceeds its floor; a cause {words}." in held
    assert "times its floor" not in tiny


def test_what_cannot_be_told_apart_has_its_reason(pages):
    told = pages["ambiguous"].text.split("What cannot be told apart")[1]
    assert "plate-radius, cut-size, camera-scale, threshold : all make every radius larger" in told
    assert "Nothing among the likely causes" in pages["effect"].text


def test_causes_that_these_drapes_leave_open_are_not_called_alike(tmp_path):
    made = document(NO_PROFILES, "ambiguous") | {"indistinguishable": []}
    told = page(made, tmp_path).text.split("What cannot be told apart")[1]
    assert "None by their nature" in told


def test_a_face_that_nobody_photographed_is_not_shown(profiles, tmp_path):
    """The models are draped on both faces all the same; only what there is data of can be compared."""
    made = document(profiles, "effect")
    assert page(made, tmp_path).text.count("face down") == 5  # data in words, table, mean, drapes, silhouette
    upper = [drape for drape in profiles["data"] if drape["side"] == "up"]
    made["profiles"] = profiles | {"data": upper}
    made["statistics"] = [one | {"down": None} for one in made["statistics"]]
    made["data"] = made["data"] | {"down": None}
    shown = page(made, tmp_path)
    assert "face down" not in shown.text
    assert "Every drape, face up." in shown.text
    labels = [one["aria-label"] for one in shown.all("svg") if one.get("aria-label")]
    assert not any("face down" in words for words in labels)


def test_not_every_drape_of_many_is_said_to_be_shown(profiles, tmp_path):
    assert "Every drape, face up and face down." in page(document(profiles), tmp_path).text
    many = [drape | {"sample": 10 * copy + drape["sample"]} for copy in range(5) for drape in profiles["base"]]
    shown = page(document(profiles | {"base": many}), tmp_path)
    assert "At most 24 drapes of each, evenly chosen, face up and face down." in shown.text
    labels = [one["aria-label"] or "" for one in shown.all("svg")]
    assert "Radius over angle of 24 of 30 drapes: base model" in labels
    assert "Radius over angle of every drape: data" in labels


def test_place_is_named_only_where_there_is_one(pages):
    assert "from 45° to 90°, 120 to 150 mm from the centre" in pages["patch"].text
    assert "No place on the cloth can be named: it acts along a direction" in pages["effect"].text
    assert {name for name, one in pages.items() if "Outlined" in one.text} == {"patch"}
    assert {name for name, one in pages.items() if "Arrow" in one.text} == {"effect"}


def test_the_arrow_is_that_of_the_effect_with_the_largest_shift(profiles):
    """Another named effect, which accounts for most, has another direction, or none."""
    made = document(profiles)
    for other in ("camera-scale", "camera-tilt"):
        made |= {"effects": [other, "off-centre"], "causes": causes(**{other: 0.7, "off-centre": 0.3})}
        for cause, direction in zip(made["causes"], (250.0, 40.0), strict=True):
            cause["parameters"].get("direction", {})["value"] = direction
        made["with_effect"] = ["off-centre:shift=0.008,direction=40", f"{other}:"]
        assert "Arrow: direction of the cause, 40° from warp." in diagnosis_page(parsed(made)).place.caption


def test_edges_of_what_is_not_localisable_are_not_drawn(tmp_path):
    made = small_document()
    made["where"] |= {"localisable": False, "why_not": "the map is as wide as under noise"}
    shown = page(made, tmp_path)
    assert "No place on the cloth can be named: the map is as wide as under noise" in shown.text
    assert "Outlined" not in shown.text


def test_page_is_small(profiles, tmp_path):
    assert write_diagnosis_page(parsed(document(profiles)), tmp_path / "new" / "page.html").stat().st_size < 200_000


def test_a_named_patch_stands_beside_the_map_of_noise_alone(profiles):
    made = document(profiles, "patch")
    section = diagnosis_page(parsed(made)).place
    assert "Noise alone gives so narrow a map in 1\u00a0% of cases." in section.caption
    assert "the same patch would be placed to within 68° and 30 mm of radius (median)" in section.caption
    assert section.null_map is not None
    assert "of the maps of noise alone" in section.null_map
    del made["where"]["resolution"], made["where"]["null_p"]
    assert section.caption.startswith(diagnosis_page(parsed(made)).place.caption)
    made["where"]["kind"] = ""
    assert diagnosis_page(parsed(made)).place.null_map is None


def _with_one_drape() -> dict:
    ring = (0.12 + 0.01 * np.cos(np.deg2rad(np.arange(0, 360, 20)))).tolist()
    drape = {"sample": 1, "side": "up", "radii_m": ring}
    return document({"data": [drape, drape | {"side": "down"}], "base": [drape], "effect": [drape]}, "patch")


def _numbers_replaced(value, new: float | None):
    """The document with every number that may be unknown replaced."""
    bounded = (
        "probability", "stage", "p", "map", "null_map", "null_p", "samples", "captures", "up", "down", "later",
        "sample", "radii_m",
    )  # fmt: skip
    if isinstance(value, dict):
        counts = "captures" in value
        return {
            key: one if key in bounded and (counts or key not in ("up", "down")) else _numbers_replaced(one, new)
            for key, one in value.items()
        }
    if isinstance(value, list):
        return (
            None
            if new is None and value and isinstance(value[0], float)
            else [_numbers_replaced(one, new) for one in value]
        )
    return new if isinstance(value, float) else value


@pytest.mark.parametrize("odd", [None, 0.0, -1e12, 1e300])
def test_unknown_and_odd_numbers_still_give_a_page(odd, tmp_path):
    shown = page(_numbers_replaced(_with_one_drape(), odd), tmp_path)
    assert "One cause found" in shown.text
    values = " ".join(str(value) for _, attributes in shown.tags for value in attributes.values())
    words = f"{shown.text} {values}".lower().split()
    assert not [word for word in words if re.fullmatch(r"[^a-z]*(nan|inf)[^a-z]*", word)]


@pytest.mark.parametrize("lacking", ["base", "floor", "p", "effect", "groups"])
def test_a_gap_of_which_something_is_unknown_is_shown(lacking):
    made = small_document() | {"statistics": []}
    del made["gap"][lacking]
    section = diagnosis_page(parsed(made)).gap
    assert (section.graph is None) == (lacking == "base")
    assert section.has_floor == (lacking != "floor")


def test_simulated_drapes_of_too_few_samples_are_shown_without_a_gap(profiles, tmp_path):
    made = document(profiles)
    text = page(made | {"gap": {"p": 0.01}, "closure": {}}, tmp_path).text
    assert "too few samples to leave some unseen" in text
    assert "samples are too few" in text
    assert "no drapes were simulated." not in text


def test_an_empty_diagnosis_says_what_is_not_known(tmp_path):
    text = page(EMPTY, tmp_path).text
    for expected in (
        "unnamed fabric",
        "gap was not measured",
        "no map was made",
        "No causes were weighed",
        "No profiles",
    ):
        assert expected in text, expected


def test_hostile_words_stay_words(tmp_path):
    hostile = '"><script>alert(1)</script>$x$ \x00\n'

    def poisoned(value):
        if isinstance(value, dict):
            return {
                hostile if key in BASE["gap"]["groups"] else key: one if key == "side" else poisoned(one)
                for key, one in value.items()
            }
        if isinstance(value, list):
            return [poisoned(one) for one in value]
        return hostile if isinstance(value, str) else value

    made: dict = {key: poisoned(one) for key, one in small_document().items()} | {"verdict": "effect"}
    shown = page(made, tmp_path)
    assert not shown.all("script")
    assert shown.text.count("alert(1)") > 10


def test_causes_that_act_together_are_named_together(tmp_path):
    made = small_document() | {"verdict": "several", "effects": ["local-stiff-patch", "creep"]}
    made["closure"]["effect"] = ["local-stiff-patch", "creep"]
    text = page(made, tmp_path).text
    assert text.index("Several causes found") < text.index("Does simulation differ")
    assert "One cause found" not in text
    assert "local-stiff-patch + creep close 31" in text
    assert "with all causes" in text


def test_a_cause_is_one_without_simulations_and_where_several_are_possible(tmp_path):
    made = small_document()
    made["closure"] = {"effect": None, "fraction": None, "ci90": None}
    assert "One cause found" in page(made, tmp_path).text
    closure = {"effect": "local-mass-patch", "fraction": 0.31, "ci90": None}
    text = page(small_document() | {"verdict": "ambiguous", "closure": closure}, tmp_path).text
    assert "Several causes possible" in text
    assert "local-mass-patch closes 31" in text


def test_values_with_causes_are_called_after_all_of_them(profiles):
    """Beside the named set the likeliest of look-alikes takes part, without simulations as well."""
    made = document(profiles) | {"verdict": "several", "effects": ["off-centre"], "closure": {}}
    made |= {"groups": [["threshold", "cut-size"]]}
    made |= {"with_effect": ["off-centre:shift=0.008,direction=40", "threshold:shift=0.001"]}
    assert diagnosis_page(parsed(made)).statistics.cause == "off-centre + threshold"


def test_budget_of_the_gap(tmp_path):
    made = small_document()
    assert "Budget of the gap" not in page(made, tmp_path).text
    made["budget"] = [
        {"effect": "plate-tilt", "share": 0.5, "ci90": [0.4, 0.6]}, {"effect": "creep", "share": 0.2, "ci90": None},
    ]  # fmt: skip
    made |= {"unexplained": {"share": 0.3, "ci90": [0.2, 0.4]}, "groups": [["creep", "bending-friction"]]}
    made["causes"][0] |= {"acting": 0.93, "shared": True}
    made["effects"] = [made["causes"][0]["effect"]]
    text = page(made, tmp_path).text.replace("\u00a0", " ")
    assert "plate-tilt 50 % 40 % to 60 % creep 20 % unexplained 30 % 20 % to 40 %" in text
    assert "Creep stands for one of creep, bending-friction." in text
    assert "93 %" in text
    assert "accounts for most with probability" in text
    assert "shown by all fabrics of this laboratory" in text


def test_a_look_alike_is_not_said_to_close_the_gap_for_certain(tmp_path):
    """Of each group one is simulated, or in its place another that comes nearer to the fitted samples."""
    made = document(NO_PROFILES, "ambiguous")
    assert "stands for one of" not in page(made, tmp_path).text
    made["groups"] = [["plate-radius", "cut-size", "camera-scale"]]
    shown = diagnosis_page(parsed(made))
    assert "Here plate-radius stands for one of plate-radius, cut-size, camera-scale: where" in shown.closure.words
    (closes,) = [words for card in shown.causes.cards for words in card.remarks if "of the gap" in words]
    assert closes.startswith(f"this or a look-alike closes {percent(0.64)} of the gap")


def test_the_budget_names_the_look_alike_that_it_has_a_share_of(tmp_path):
    """Models hold another one of the group than its first."""
    made = small_document() | {"groups": [["cut-size", "threshold"]], "closure": {}}
    made |= {"with_effect": ["threshold:shift=0.001"], "unexplained": {"share": 0.3, "ci90": None}}
    made["budget"] = [{"effect": "threshold", "share": 0.7, "ci90": None}]
    assert "Threshold stands for one of cut-size, threshold." in page(made, tmp_path).text


def test_what_may_be_shared_instead_is_said(tmp_path):
    made = small_document()
    first, other = (one["effect"] for one in made["causes"][:2])
    assert "instead of" not in page(made, tmp_path).text
    made["causes"][0]["shared"], made["groups"] = True, [[first, other]]
    text = page(made, tmp_path).text
    assert f"one of {first}, {other} is shown by all fabrics of this laboratory" in text
    assert f"may be what all fabrics of this laboratory show, instead of {first}" in text


def test_what_is_refused_is_said(tmp_path):
    text = page(
        EMPTY | {"verdict": "refused", "refused": "one sample", "headline": "Not diagnosed: one sample."}, tmp_path
    ).text
    assert "Not diagnosed: one sample." in text


def test_a_gap_that_no_cause_explains_is_not_denied(tmp_path):
    made = small_document() | {"verdict": "none", "closure": {"effect": None, "fraction": None, "ci90": None}}
    made["gap"] |= {"base": 0.27, "floor": 0.01, "effect": None}
    text = page(made, tmp_path).text
    assert "The gap is 27 times its floor" in text
    assert "no gap to close" not in text


def test_a_statistic_has_the_sign_that_it_is_written_with(tmp_path):
    """Of the face that differs more in standard errors, which may be less in its unit: fewer samples show the other."""
    low = statistic("area_dc", "size", "1", (0.40, 0.41, 0.5, 0.5), -4.0)
    mixed = statistic("mean_radius", "size", "m", (0.123, 0.115, 0.12, 0.12), 3.0)
    for rows, shown in (([low, mixed], ["−4.0", "+3.0"]), ([low | {"z": 4.0}, mixed], ["−4.0", "−3.0"])):
        made = parsed(document(NO_PROFILES) | {"statistics": rows})
        assert [row.z for row in statistic_table(made).rows] == shown
