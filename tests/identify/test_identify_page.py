"""The page and the table of an identification, of which nothing is simulated; the page in a real browser too."""

import csv
from itertools import pairwise

import numpy as np
import pytest
from html_page import Page
from identified import DENSITY, WARP, write_identification
from page_browser import HEADINGS, NAMELESS, TELEPHONE, chromium, needs_chromium, playwright, shot, watched
from toy_cloths import write_toy

from cusick_bench.datasets import load
from cusick_bench.datasets.stats import statistics
from cusick_bench.identify.comparison import compare
from cusick_bench.identify.document import Spread
from cusick_bench.identify.fabric_table import COLUMNS, fabric_table
from cusick_bench.identify.identify import _drapes
from cusick_bench.identify.page import _numbers, _other_profiles
from cusick_bench.metrics.stiffness import bending_length


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("identified")


@pytest.fixture(scope="module")
def document(toy_dataset, out):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
        patch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 200)
        return write_identification(toy_dataset, out)


def test_the_page_asks_for_nothing_and_compares_with_measured_fabrics(document, out):
    page = Page((out / "identify.html").read_text())
    assert page.asks_for() == []
    assert document.fabrics[0].comparison.summary in page.text
    assert page.text.count("Among 618 measured fabrics") == 1  # the other fabric has no stiffness
    assert "bending length, weft" in page.text
    assert any("among measured fabrics: bending stiffness, warp 14.0" in (one.get("aria-label") or "")
               for one in page.all("svg"))  # fmt: skip


def test_the_table_has_a_row_for_each_fabric_in_every_unit(document, out):
    with (out / "identify.csv").open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        first, second = reader
    assert reader.fieldnames == list(COLUMNS)
    value, (low, high) = WARP
    assert float(first["bending_warp_uN_m"]) == pytest.approx(1e6 * value)
    assert float(first["bending_warp_gf_cm2_cm_low"]) == pytest.approx(low / 98.0665e-6)
    assert float(first["bending_length_warp_cm_high"]) == pytest.approx(100 * bending_length(high, DENSITY))
    rank = document.fabrics[0].comparison.numbers[0].among_similar
    assert float(first["percent_of_similar_warp"]) == pytest.approx(rank.percent)
    assert float(first["drape_coefficient"]) == 0.63
    assert first["drape_coefficient_definition"].endswith("ISO 9073-9, cloth 300 mm, plate 180 mm")
    assert second["bending_warp_uN_m"] == second["solver"] == second["verdict"] == ""
    assert second["fit_missing"].startswith("its weight is not known")


def test_the_table_of_all_samples_and_of_differences_between_faces(document):
    """Of a fabric without fit, whose stiffness is the diagnosis' alone."""
    first = document.fabrics[0]
    drapes = first.drapes.model_copy(update={"down_minus_up": -0.021})
    one = first.model_copy(update={"drapes": drapes, "fit": None, "comparison": compare(DENSITY, None, 5e-5)})
    (row,) = csv.DictReader(fabric_table(document.model_copy(update={"fabrics": (one,)})).splitlines())
    assert float(row["bending_all_samples_uN_m"]) == pytest.approx(50)
    assert [float(row[name]) for name in ("drape_coefficient_sd", "folds", "folds_sd")] == [0.02, 7.2, 0.4]
    assert float(row["face_down_minus_up"]) == -0.021
    shown = {number.name: number.value for number in _numbers(one)}
    assert shown["face down − up"] == "-2.1 points"


def test_drapes_are_counted_and_measured_as_by_stats(tmp_path):
    (known,) = statistics(load(write_toy(tmp_path, samples=3, captures=3, meshes=False)))
    found = _drapes(known)
    assert (found.samples, found.silhouettes, found.units, found.unusable) == (3, 9, 6, 0)
    assert found.drape_coefficient == Spread(value=known.drape_coefficient, sd=known.drape_coefficient_sd)
    assert found.folds == Spread(value=known.folds, sd=known.folds_sd)
    assert found.down_minus_up == known.down_minus_up.mean != 0


def test_every_number_of_the_page_stands_in_its_column(document, out):
    text = Page((out / "identify.html").read_text()).text
    name = document.fabrics[0].fabric
    numbers = "63.0 ± 2.0 7.2 ± 0.4 14.0 [6.00, 31.0] 7.00 [3.00, 15.5] 9.33 [4.00, 20.7]"
    assert f"bending, warp µN m bending, weft µN m bending, bias µN m diagnosis {name} 5 {numbers} –" in text
    camera = "the camera, of unknown height, was calibrated from the printed board, scale ± 0.2 %."
    assert f"10 of 11 photographs were used; {camera}" in text
    assert "weight 180 g/m²" in text


def test_the_fit_stands_beside_the_same_face_of_the_other_samples(tmp_path):
    root = write_toy(tmp_path / "lab", samples=3, captures=3, meshes=False)
    (root / "protocol.json").write_text('{"captures": {"1": "down", "2": "down", "3": "up"}}')
    dataset = load(root)
    beside = _other_profiles(dataset, "fabric_7", sample=2)
    rows = dataset.index.index[(dataset.index["side"] == "up") & (dataset.index["sample"] != 2)]
    assert beside is not None
    assert beside == pytest.approx(np.stack([dataset.sample(int(row)).profile.radii for row in rows]))


@pytest.fixture(scope="module")
def browser():
    playwright()
    with chromium() as running:
        yield running


@pytest.fixture
def opened(browser, document, out):
    with watched(browser, out / "identify.html") as open_page:
        yield open_page


@needs_chromium
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_telephone_scrolls_up_and_down_only(opened, scheme):
    page = opened(TELEPHONE, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") == TELEPHONE["width"]
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, background[4:-1].split(","))) > 380) == (scheme == "light")


@needs_chromium
def test_no_picture_is_blank(opened):
    page = opened()
    pictures = page.locator("figure img, figure svg").all()
    assert len(pictures) == 4 + 3 + 1  # of the fit: silhouettes, drape, three graphs; of the other, its silhouette
    for picture in pictures:
        picture.scroll_into_view_if_needed()
        assert shot(picture).std() > 5


@needs_chromium
def test_the_fabric_lies_where_its_rank_says(opened, document):
    """In the graph of measured fabrics the fabric's dot is drawn in the model's colour, and is wider than a line."""
    page = opened()
    graph = page.get_by_label("among measured fabrics: bending stiffness")
    picture = shot(graph)
    colour = page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--model')").strip()
    wanted = [int(colour[place : place + 2], 16) for place in (1, 3, 5)]
    drawn = (abs(picture - wanted) < 25).all(2)
    assert drawn.sum(0).max() > 6  # a dot, not just the line of its interval
    assert drawn[:, : picture.shape[1] // 2].any()
    assert drawn[:, picture.shape[1] // 2 :].any()  # both panels


@needs_chromium
def test_links_lead_to_fabrics_and_everything_has_a_name(opened, document):
    page = opened()
    page.get_by_role("link", name=document.fabrics[1].fabric).click()
    assert page.evaluate("location.hash") == "#fabric-1"
    assert page.evaluate(NAMELESS) == []
    levels = page.evaluate(HEADINGS)
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


@needs_chromium
def test_paper_cuts_nothing_off(opened):
    page = opened({"width": 688, "height": 1000})  # A4 between its margins
    page.emulate_media(media="print")
    edges = "(all) => all.map((one) => one.getBoundingClientRect().right)"
    assert max(page.locator("table, svg, img").evaluate_all(edges)) <= 688
