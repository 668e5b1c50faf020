"""The page of a diagnosis: valid, self-contained, true to its document for every verdict, robust against what lacks."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from matplotlib.axes import Axes
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation, Text

from cusick_bench.diagnosis.atlas.base_model import DENSITY, NAMES, cloth
from cusick_bench.diagnosis.document.model import BaseParameters, DataCounts, DiagnosisDocument, Profiles, StatisticRow
from cusick_bench.diagnosis.measure.captures import captures_from_profiles
from cusick_bench.diagnosis.measure.statistics import NAMES as STATISTICS
from cusick_bench.report.diagnosis.bars import Bar, bars_graph, closure_graph, gap_graph
from cusick_bench.report.diagnosis.cloth_map import Arrow, Region, cloth_map
from cusick_bench.report.diagnosis.effect_words import physics, signature
from cusick_bench.report.diagnosis.number_format import measure, percent, plain
from cusick_bench.report.diagnosis.page import diagnosis_page, write_diagnosis_page
from cusick_bench.report.diagnosis.profile_graphs import every_graph, mean_graph, silhouette_graph, sorted_graph
from cusick_bench.report.diagnosis.profiles import Sided, mean_difference, sided_profiles
from cusick_bench.report.diagnosis.statistics import ShownStatistic, statistic_table
from cusick_bench.report.diagnosis.words import cloth_in_words, entropy_of, statistic_name, worth
from cusick_bench.report.drawing.palette import CAUSE, FLOOR, MODEL, REAL
from cusick_bench.sim.effects import registered

STAGES = ("material", "boundary", "contact", "history", "imaging", "none", "unknown")


# -- made-up documents


def drapes(shift: float, folds: int) -> list[dict]:
    """Profiles of three drapes on both faces as the camera sees them: folds, and a cloth off centre [m]."""
    angle = np.deg2rad(np.arange(360))
    generator = np.random.default_rng(folds)
    made = []
    for sample, side in ((sample, side) for sample in (1, 2, 3) for side in ("up", "down")):
        phase = generator.uniform(0, 2 * np.pi)
        radii = 0.12 + shift * np.cos(angle - 0.7) + 0.012 * np.cos(folds * angle - phase)
        made.append({"sample": sample, "side": side, "radii_m": radii.round(6).tolist()})
    return made


@pytest.fixture(scope="module")
def profiles() -> dict[str, list[dict]]:
    """Data with an off-centre cloth, the base model, and the base model with that cause."""
    return {"data": drapes(0.008, 7), "base": drapes(0.0, 6), "effect": drapes(0.007, 8)}


def causes(**probability: float) -> list[dict]:
    """Causes with their registered parameters at typical values."""
    made = []
    for name, share in sorted(probability.items(), key=lambda item: -item[1]):
        known = registered().get(name := name.replace("_", "-"))
        parameters = {p.name: {"value": p.typical or 40.0, "unit": p.unit} for p in known.parameters} if known else {}
        made.append({"effect": name, "class": known.kind if known else "", "probability": share})
        made[-1] |= {"parameters": parameters, "summary": known.summary if known else ""}
    return made


def patch_map() -> list[list[float]]:
    """A patch around 67 degrees near the rim."""
    middle = 67.0 - (np.arange(16) + 0.5) * 22.5
    near = np.exp(-0.5 * (np.minimum(np.abs(middle), 360 - np.abs(middle)) / 18) ** 2)
    weights = np.array([0.05, 0.3, 1.0, 0.8])[:, None] * near + 0.004
    return (weights / weights.sum()).tolist()


def document(profiles: dict, verdict: str = "effect") -> dict:
    """A plausible diagnosis of each verdict."""
    made = json.loads(json.dumps(BASE)) | {"verdict": verdict, "profiles": dict(profiles)}
    if verdict == "effect":
        made["causes"] = causes(off_centre=0.83, camera_offset=0.09, plate_tilt=0.04, unknown=0.02, none=0.001)
        made["set90"] = ["off-centre", "camera-offset"]
        made["headline"] = "The cloth lay about 8 mm off the plate's centre, towards 40° (83 %)."
        made["where"] |= {"kind": "direction", "why_not": "it acts along a direction, not in a place"}
        made["closure"] = {"effect": "off-centre", "fraction": 0.78, "ci90": [0.55, 0.93]}
        made["gap"]["effect"] = 0.021
    elif verdict == "patch":
        made |= {"verdict": "effect", "set90": ["local-stiff-patch"]}
        made["causes"] = causes(local_stiff_patch=0.92, local_mass_patch=0.05, unknown=0.01, none=0.004)
        made["where"] |= {"map": patch_map(), "kind": "patch", "localisable": True, "why_not": ""}
        made["where"] |= {"angle_deg": [45.0, 90.0], "radius_m": [0.12, 0.15]}
        made["closure"] = {"effect": "local-stiff-patch", "fraction": 0.31, "ci90": [-0.12, 0.61]}
        made["gap"]["effect"] = 0.05
    elif verdict == "ambiguous":
        made["causes"] = causes(
            plate_radius=0.33, cut_size=0.29, camera_scale=0.22, threshold=0.12, unknown=0.02, none=0.01
        )
        made["set90"] = ["plate-radius", "cut-size", "camera-scale", "threshold"]
        made["indistinguishable"] = [{"effects": made["set90"], "why": "all make every radius larger by a like share"}]
        made["closure"] = {"effect": "plate-radius", "fraction": 0.64, "ci90": [0.4, 0.82]}
        made["gap"]["effect"] = 0.03
    elif verdict == "unknown":
        made["causes"] = causes(unknown=0.81, stiffness_field=0.06, self_contact=0.05, none=0.002)
        made |= {"set90": ["unknown", "stiffness-field", "self-contact"], "headline": ""}
        made["profiles"].pop("effect")
    elif verdict == "none":
        made["causes"] = causes(none=0.9, unknown=0.03, creep=0.02, grain_skew=0.02)
        made |= {"set90": ["none"], "headline": "", "statistics": made["statistics"][3:], "next": []}
        made["gap"] = {"base": -0.0021, "floor": 0.009, "p": 0.62, "effect": None, "groups": made["gap"]["groups"]}
        made["gap"]["groups"] = {name: {"gap": g["floor"] * 0.7, "floor": g["floor"]} for name, g in groups().items()}
        made["profiles"].pop("effect")
    total = {stage: 0.0 for stage in STAGES}
    for cause in made["causes"]:
        total[cause["class"] or cause["effect"]] += cause["probability"]
    made["where"]["stage"] = total
    return made


def groups() -> dict[str, dict[str, float]]:
    gaps = {"size": 0.02, "radii": 0.06, "depth": 0.03, "number": 0.01, "spectrum": 0.04, "harmonics": 0.31}
    return {name: {"gap": gap, "floor": 0.011 + 0.1 * gap} for name, gap in gaps.items()} | {
        "envelope": {"gap": -0.004, "floor": 0.012}
    }


def statistic(name: str, group: str, unit: str, values: tuple[float, float, float, float], z: float) -> dict:
    up, down, base, effect = values
    return {"name": name, "group": group, "unit": unit, "up": up, "down": down, "base": base, "effect": effect, "z": z}


BASE = {
    "fabric": "Fabric 7 (cotton <twill>)",
    "headline": "Something makes every drape too wide by 2 %.",
    "gap": {"base": 0.0874, "floor": 0.0126, "p": 0.0004, "effect": None, "groups": groups()},
    "where": {
        "map": np.full((4, 16), 1 / 64).tolist(),
        "kind": "",
        "angle_deg": None,
        "radius_m": None,
        "localisable": False,
        "why_not": "no single cause is named",
    },
    "closure": {"effect": None, "fraction": None, "ci90": None},
    "next": [
        {
            "name": "rotate by 90 degrees",
            "what": "Drape samples turned by 90 degrees on the plate: what belongs to the cloth turns with it.",
            "bits": 0.62,
            "about": ["off-centre", "plate-tilt", "camera-offset"],
        },
        {
            "name": "photograph a ruler",
            "what": "Photograph a ruler on the plate: it shows the camera's scale, place and edge.",
            "bits": 0.2,
            "about": ["camera-offset"],
        },
    ],
    "base": {"bending": -6.8, "anisotropy": 0.2, "bias": 0.0, "growth": 0.1, "shear": 4.2, "laying": 0.0, "rest": 0.1},
    "data": {"samples": 12, "captures": 48, "up": 24, "down": 24, "later": 24, "areal_density_kg_m2": 0.192},
    "statistics": [
        statistic("harmonic_1_real", "harmonics", "m", (0.0052, 0.0049, 0.0001, 0.0047), 9.4),
        statistic("harmonic_1_imaginary", "harmonics", "m", (0.0043, 0.0047, -0.0002, 0.0041), 8.8),
        statistic("skewness", "radii", "1", (0.31, 0.28, 0.12, 0.27), 3.1),
        statistic("area_dc", "size", "1", (0.48, 0.475, 0.471, 0.474), 1.2),
        statistic("folds", "number", "1", (7.4, 7.6, 7.5, 7.5), -0.4),
        statistic("roughness", "depth", "m/rad", (0.041, 0.043, 0.044, 0.044), -1.4),
    ],
    "indistinguishable": [],
    "notes": ["1 picture was left out: it shows another fabric."],
    "without": [],
    "made": {"version": "0.1.0", "command": "cusick-bench diagnose DATA --fabric 7", "atlas": "v1 (480 vertices)"},
}


NO_PROFILES = {"data": [], "base": [], "effect": []}
EMPTY = {"fabric": "", "verdict": "effect"}


def parsed(content: dict) -> DiagnosisDocument:
    return DiagnosisDocument.parse(json.dumps(content), "the test's document")


def page(content: dict, folder: Path) -> Page:
    return Page(write_diagnosis_page(parsed(content), folder / "diagnosis.html").read_text(encoding="utf-8"))


VERDICTS = ("effect", "patch", "ambiguous", "unknown", "none")


@pytest.fixture(scope="module")
def pages(profiles, tmp_path_factory) -> dict[str, Page]:
    folder = tmp_path_factory.mktemp("pages")
    return {verdict: page(document(profiles, verdict), folder) for verdict in VERDICTS}


# -- the page of each verdict


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


def test_place_is_named_only_where_there_is_one(pages):
    assert "from 45° to 90°, 120 to 150 mm from the centre" in pages["patch"].text
    assert "No place on the cloth can be named: it acts along a direction" in pages["effect"].text
    assert {name for name, one in pages.items() if "Outlined" in one.text} == {"patch"}
    assert {name for name, one in pages.items() if "Arrow" in one.text} == {"effect"}


def test_edges_of_what_is_not_localisable_are_not_drawn(tmp_path):
    made = _small()
    made["where"] |= {"localisable": False, "why_not": "the map is as wide as under noise"}
    shown = page(made, tmp_path)
    assert "No place on the cloth can be named: the map is as wide as under noise" in shown.text
    assert "Outlined" not in shown.text


def test_page_is_small(profiles, tmp_path):
    assert write_diagnosis_page(parsed(document(profiles)), tmp_path / "new" / "page.html").stat().st_size < 200_000


# -- documents that lack much, or hold odd values


def _small() -> dict:
    """A diagnosis without drapes."""
    return document(NO_PROFILES, "patch")


def _with_one_drape() -> dict:
    ring = (0.12 + 0.01 * np.cos(np.deg2rad(np.arange(0, 360, 20)))).tolist()
    drape = {"sample": 1, "side": "up", "radii_m": ring}
    return document({"data": [drape, drape | {"side": "down"}], "base": [drape], "effect": [drape]}, "patch")


def _numbers_replaced(value, new: float | None):
    """The document with every number that may be unknown replaced."""
    bounded = ("probability", "stage", "p", "map", "samples", "captures", "up", "down", "later", "sample", "radii_m")
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
    made = _small() | {"statistics": []}
    del made["gap"][lacking]
    section = diagnosis_page(parsed(made)).gap
    assert (section.graph is None) == (lacking == "base")
    assert section.has_floor == (lacking != "floor")


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

    made: dict = {key: poisoned(one) for key, one in _small().items()} | {"verdict": "effect"}
    shown = page(made, tmp_path)
    assert not shown.all("script")
    assert shown.text.count("alert(1)") > 10


# -- graphs


def bars(figure: Figure, colour: str) -> list[tuple[float, float]]:
    """Start and length of the bars of a colour, in the units of the axis."""
    (axes,) = figure.axes
    found = [one for one in axes.patches if isinstance(one, Rectangle) and same_color(one.get_facecolor(), colour)]
    return [(one.get_x(), one.get_width()) for one in found]


def words(figure: Figure) -> list[str]:
    """All texts of a figure."""
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def test_bars_are_as_long_as_the_gap_and_the_floor_crosses_them():
    figure = gap_graph([Bar("base", 0.08, MODEL), Bar("with", 0.02, CAUSE)], 0.01)
    assert bars(figure, MODEL) == [(0, 0.08)]
    assert bars(figure, CAUSE) == [(0, 0.02)]
    (axes,) = figure.axes
    floors = [line for line in axes.lines if same_color(line.get_color(), FLOOR)]
    assert [line.get_xdata()[0] for line in floors] == [0.01]
    assert {"base", "with", "0.080", "0.020"} <= set(words(figure))


def test_a_gap_below_zero_points_the_other_way():
    figure = gap_graph([Bar("base", -0.01, MODEL), Bar("floor", 0.02, FLOOR)], 0.02)
    (axes,) = figure.axes
    assert bars(figure, MODEL) == [(0, -0.01)]
    assert axes.get_xlim() == (-0.01, 0.02)


def test_shares_fill_the_same_axis_and_marks_stand_at_their_values():
    figure = bars_graph([Bar("one", 0.25, MODEL, 0.1), Bar("two", None, MODEL)], percents=True)
    (axes,) = figure.axes
    assert axes.get_xlim() == (0, 1)
    assert [line.get_xdata()[0] for line in axes.lines if same_color(line.get_color(), FLOOR)] == [0.1]
    assert {"25\u00a0%", "–"} <= set(words(figure))


def cells(figure: Figure) -> list[tuple[float, float, float]]:
    """Middle angle [deg], middle radius [m] and opacity of each cell of a map."""
    found = [one for one in figure.axes[0].patches if isinstance(one, Rectangle)]
    return [
        (
            float(np.rad2deg(one.get_x() + one.get_width() / 2)),
            one.get_y() + one.get_height() / 2,
            one.get_facecolor()[3],
        )
        for one in found
    ]


def outlines(figure: Figure) -> list[np.ndarray]:
    """Angles [rad] and radii [m] of the outlined region."""
    return [one.get_xy() for one in figure.axes[0].patches if one.get_label() == "region"]


def test_map_is_dark_where_the_cause_is_counter_clockwise_from_warp():
    shares = np.full((4, 16), 0.001)
    shares[3, 2], shares[0, 13] = 0.8, 0.1
    figure = cloth_map(shares, Region((45.0, 67.5), (0.135, 0.15)), None)
    made = cells(figure)
    assert len(made) == 64
    first, second, *others = sorted(made, key=lambda cell: -cell[2])
    assert first[:2] == pytest.approx((56.25, 0.1425), abs=1e-3)
    assert second[:2] == pytest.approx((303.75, 0.0975), abs=1e-3)
    assert len({opacity for *_, opacity in others}) == 1
    axes = figure.axes[0]
    x, y = axes.transData.transform((np.deg2rad(56.25), 0.14)) - axes.transData.transform((0, 0))
    assert np.rad2deg(np.arctan2(y, x)) == pytest.approx(56.25)


def test_an_even_map_stays_pale():
    whole = Region((0.0, 360.0), None)
    even = cells(cloth_map(np.full((4, 16), 1 / 64), whole, None))
    peaked = np.full((4, 16), 0.0)
    peaked[1, 1] = 1.0
    assert max(opacity for *_, opacity in even) < 0.25
    assert max(opacity for *_, opacity in cells(cloth_map(peaked, whole, None))) == 1


def test_a_map_that_names_no_place_is_grey_and_says_so():
    peaked = np.full((4, 16), 0.0)
    peaked[1, 1] = 1.0
    unnamed, named = cloth_map(peaked, None, None), cloth_map(peaked, Region((22.5, 45.0), None), None)
    assert any("no finding" in text for text in words(unnamed))
    assert not any("no finding" in text for text in words(named))
    assert max(opacity for *_, opacity in cells(unnamed)) < 0.5
    assert outlines(unnamed) == []


def test_a_region_beyond_360_degrees_and_all_around():
    beyond = cloth_map(None, Region((337.5, 382.5), None), None)
    assert "no map was made" in words(beyond)
    (outline,) = outlines(beyond)
    assert (np.cos(outline[:, 0]) > 0.9).all()  # all on the warp's side
    inner, outer = sorted(ring[:, 1].mean() for ring in outlines(cloth_map(None, Region(None, (0.135, 0.15)), None)))
    assert (inner, outer) == pytest.approx((0.135, 0.15))


def test_an_arrow_points_along_its_direction_and_both_ways_where_the_sign_is_open():
    one_way, both_ways = (cloth_map(None, None, Arrow(40.0, both)) for both in (False, True))
    (arrow,) = (one for one in one_way.axes[0].texts if isinstance(one, Annotation) and one.arrow_patch)
    assert np.rad2deg(arrow.xy[0]) == pytest.approx(40)
    assert "plate" not in words(one_way)
    (other,) = (one for one in both_ways.axes[0].texts if isinstance(one, Annotation) and one.arrow_patch)
    styles = [type(one.arrow_patch.get_arrowstyle()).__name__ for one in (arrow, other)]
    assert styles == ["CurveFilledB", "CurveFilledAB"]


def test_closure_beyond_its_axis_is_cut_and_without_overlapping_words():
    figure = closure_graph(-7.0, (-20.0, 0.3))
    assert bars(figure, CAUSE) == [(0, -1)]
    assert percent(0.25) not in words(figure)
    assert percent(0.25) in words(closure_graph(0.5, None))


# -- profiles


def ring(bump: float = 30.0) -> np.ndarray:
    """A drape with one bump."""
    angle = np.arange(360) - bump
    return 0.12 + 0.02 * np.exp(-((np.minimum(np.abs(angle), 360 - np.abs(angle)) / 10) ** 2))


def read(profiles: dict[str, list[dict]]) -> Sided:
    return sided_profiles(Profiles.parse(json.dumps(profiles), "profiles"))


def test_face_down_is_mirrored_into_the_cloths_frame():
    drapes_ = [{"side": side, "radii_m": ring(30).tolist()} for side in ("up", "down", "")]
    sides = read({"data": drapes_})["data"]
    assert sides["up"].radii.argmax(1).tolist() == [30, 30]
    assert sides["down"].radii.argmax(1).tolist() == [150]


def test_profiles_agree_with_the_frame_of_the_diagnosis():
    labels = {"sample": np.array([1, 1]), "side": ["up", "down"], "capture": np.array([1, 3])}
    radii = np.stack([ring(30), ring(200)])
    expected = captures_from_profiles(radii, **labels).cloth_frame()
    sided = read({"data": [{"side": s, "radii_m": r.tolist()} for s, r in zip(("up", "down"), radii, strict=True)]})
    np.testing.assert_allclose(np.concatenate([sided["data"][side].radii for side in ("up", "down")]), expected)


def test_damaged_profiles_are_counted_and_others_resampled():
    good = {"side": "up", "radii_m": ring(90)[::2].tolist()}
    bad = [{"side": "up", "radii_m": value} for value in ([], [0.1] * 15, [0.1] * 359 + [2.0], [0.1] * 359 + [-1.0])]
    drapes_ = read({"base": [good, *bad]})["base"]["up"]
    assert (len(drapes_), drapes_.damaged) == (1, 4)
    np.testing.assert_allclose(drapes_.radii[0, ::2], ring(90)[::2])


def test_difference_of_outlines_ignores_folds_and_knows_chance():
    generator = np.random.default_rng(0)
    angle = np.deg2rad(np.arange(360))

    def made(offset: float, count: int) -> list[dict]:
        turns = generator.uniform(0, 2 * np.pi, count)
        rings = [0.12 + offset * np.cos(angle) + 0.01 * np.cos(7 * angle - turn) for turn in turns]
        return [{"side": "up", "radii_m": one.tolist()} for one in rings]

    difference = mean_difference(read({"data": made(0.004, 5), "base": made(0.0, 5)}), "base")
    assert difference is not None
    assert difference[0] == pytest.approx(0.004 / np.sqrt(2), rel=1e-6)
    assert difference[1] == pytest.approx(0, abs=1e-9)
    assert mean_difference(read({"data": made(0.0, 5)}), "base") is None
    wobbling = {"data": [{"side": "up", "radii_m": (0.12 + d + 0 * angle).tolist()} for d in (-0.003, 0.003)]}
    by_chance = mean_difference(read(wobbling | {"base": made(0.0, 5)}), "base")
    assert by_chance is not None
    assert by_chance[1] == pytest.approx(0.003, rel=1e-6)


def lines(axes: Axes, colour: str) -> list[np.ndarray]:
    """Values of the lines of a colour."""
    return [np.asarray(line.get_ydata()) for line in axes.lines if same_color(line.get_color(), colour)]


def test_graphs_of_profiles_show_every_source_in_its_colour(profiles):
    sided = read(profiles)
    (axes,) = mean_graph(sided, "up").axes
    for source, colour in (("data", REAL), ("base", MODEL), ("effect", CAUSE)):
        (shown,) = lines(axes, colour)
        expected = 1e3 * sided[source]["up"].shapes.mean(0)[::3]
        np.testing.assert_allclose(shown, np.append(expected, expected[0]))
    assert len(axes.collections) == 1  # the range of the data
    (axes,) = every_graph(sided, "base").axes
    assert len(lines(axes, MODEL)) == 6
    (axes,) = sorted_graph(sided).axes
    (shown,) = lines(axes, REAL)
    assert (np.diff(shown) >= 0).all()
    assert shown[0] == pytest.approx(1e3 * np.concatenate([d.radii for d in sided["data"].values()]).min(1).mean())


def test_outlines_are_counter_clockwise_from_warp():
    sided = read({"data": [{"side": "up", "radii_m": ring(90).tolist()}]})
    (axes,) = silhouette_graph(sided, "up").axes
    (line,) = (line for line in axes.lines if same_color(line.get_color(), REAL))
    x, y = line.get_xdata(), line.get_ydata()
    assert np.hypot(x, y).max() == pytest.approx(0.14)
    assert (x[np.argmax(y)], y.max()) == pytest.approx((0, 0.14), abs=1e-9)


# -- words


def test_cloth_in_words_is_the_base_models_cloth():
    theta = np.array([-6.5, 0.4, 0.1, 0.2, 4.0, 0.2, -0.3, 0.1, -0.2])
    rows = cloth_in_words(
        BaseParameters(**dict(zip(NAMES, theta.tolist(), strict=True))), DataCounts(areal_density_kg_m2=DENSITY)
    )
    values = {meaning: value for _, value, meaning in rows}
    material = cloth(theta)
    mean = float(material.bending[0, 0] * material.bending[2, 0]) ** 0.5
    assert values["at 150 g/m²"] == f"{1e6 * mean:.2g} µN m"
    ratio = float(material.bending[0, 0] / material.bending[2, 0])
    assert values["factor between the bending stiffness of the two"] == f"× {ratio:.2f}"
    assert len(cloth_in_words(BaseParameters(bending=-6.5), DataCounts())) == 1


@pytest.mark.parametrize(
    ("name", "sign"),
    [
        ("creep", "later pictures of a drape only"),
        ("rest-curvature", "opposite way when the sample lies on its other face"),
        ("plate-tilt", "Keeps its direction on the bench"),
        ("camera-scale", "Changes the picture"),
        ("local-mass-patch", "Stays at its place"),
        ("rim-stiffening", "alike on both faces"),
    ],
)
def test_a_cause_is_known_by_what_it_would_show(name, sign):
    assert sign in signature(name)
    assert signature("no-such-effect") == ""


def test_every_statistic_and_effect_has_words():
    words = [statistic_name(name) for name in STATISTICS]
    assert len(set(words)) == len(words)
    assert not any("_" in word for word in words)
    assert {name for name in registered() if not signature(name)} <= {"plate-slip"}
    assert "`" not in "".join(physics(name) for name in registered())


def shown(*statistics: dict) -> list[ShownStatistic]:
    rows = tuple(StatisticRow(**one) for one in statistics)
    return statistic_table(DiagnosisDocument(fabric="", verdict="effect", statistics=rows)).rows


def test_rounding_errors_are_shown_as_nothing():
    rounded = statistic("harmonic_1_real", "harmonics", "m", (-0.0021, -0.0019, 0.0, 2.2e-19), -5.5)
    tiny = statistic("harmonic_1_real", "harmonics", "m", (2.2e-19, 1e-19, 0.0, 1e-19), 5.5)
    assert shown(rounded)[0].effect == "0"
    assert shown(tiny)[0].up == "2.20e-16"


def test_scores_point_the_way_the_data_lie():
    below = statistic("area_dc", "size", "1", (0.40, 0.46, 0.45, 0.41), 3.0)
    above = statistic("mean_radius", "size", "m", (0.12, 0.14, 0.121, 0.125), 2.0)
    signed = statistic("folds", "number", "1", (7.0, 7.0, 6.0, 6.5), -1.0)
    rows = shown(signed, above, below)
    assert [(row.name, row.z) for row in rows] == [
        ("drape coefficient", "−3.0"), ("mean radius", "+2.0"), ("number of folds", "−1.0"),
    ]  # fmt: skip
    assert (rows[1].up, rows[1].unit) == ("120", "mm")


def test_causes_that_act_together_are_named_together(tmp_path):
    made = _small() | {"verdict": "several", "effects": ["local-stiff-patch", "creep"]}
    made["closure"]["effect"] = ["local-stiff-patch", "creep"]
    text = page(made, tmp_path).text
    assert text.index("Several causes found") < text.index("Does simulation differ")
    assert "One cause found" not in text
    assert "local-stiff-patch + creep close 31" in text
    assert "with all causes" in text


def test_a_cause_is_one_without_simulations_and_where_several_are_possible(tmp_path):
    made = _small()
    made["closure"] = {"effect": None, "fraction": None, "ci90": None}
    assert "One cause found" in page(made, tmp_path).text
    closure = {"effect": "local-mass-patch", "fraction": 0.31, "ci90": None}
    text = page(_small() | {"verdict": "ambiguous", "closure": closure}, tmp_path).text
    assert "Several causes possible" in text
    assert "local-mass-patch closes 31" in text


def test_budget_of_the_gap(tmp_path):
    made = _small()
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


def test_what_is_refused_is_said(tmp_path):
    text = page(
        EMPTY | {"verdict": "refused", "refused": "one sample", "headline": "Not diagnosed: one sample."}, tmp_path
    ).text
    assert "Not diagnosed: one sample." in text


def test_a_gap_that_no_cause_explains_is_not_denied(tmp_path):
    made = _small() | {"verdict": "none", "closure": {"effect": None, "fraction": None, "ci90": None}}
    made["gap"] |= {"base": 0.27, "floor": 0.01, "effect": None}
    text = page(made, tmp_path).text
    assert "The gap is 27 times its floor" in text
    assert "no gap to close" not in text


def test_bits_are_read_against_the_doubt_that_is_left():
    doubt = entropy_of([0.5, 0.25, 0.25])
    assert doubt == pytest.approx(1.5)
    assert "nearly all" in worth(1.4, doubt)
    assert "about half" in worth(0.75, doubt)
    assert "little" in worth(0.05, doubt)
    assert "little doubt is left" in worth(0.01, entropy_of([0.999]))


def test_numbers_are_rounded_without_lying():
    assert [percent(share) for share in (0.0, 0.001, 0.5, 0.999, 1.0, None)] == [
        "0\u00a0%", "<\u00a01\u00a0%", "50\u00a0%", ">\u00a099\u00a0%", "100\u00a0%", "–",
    ]  # fmt: skip
    assert [plain(value) for value in (0.0874, -0.0021, 12345.0, 0.0)] == ["0.087", "−0.0021", "12345", "0"]
    assert measure(0.0021, "m") == "2.1\u00a0mm"
    assert measure(40.0, "deg") == "40°"
