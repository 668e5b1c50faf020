"""The report in a real browser: what scripts do, what a telephone shows, what a keyboard reaches."""

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from page_browser import DESKTOP, HEADINGS, NAMELESS, TELEPHONE, chromium, needs_chromium, shot, watched
from page_browser import playwright as find_playwright
from shown_cells import write_cell

from cusick_bench.leaderboard import leaderboards, load_cells
from cusick_bench.report import write_report

playwright = find_playwright()
pytestmark = needs_chromium


def _elements_apart(cell: Path) -> None:
    """Gives every hinge of a cell a bending table of its own, stiffer from hinge to hinge."""
    with np.load(cell / "prediction.npz") as archive:
        arrays = dict(archive)
    faces = arrays["faces"]
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    hinges = int((np.unique(sides, axis=0, return_counts=True)[1] == 2).sum())
    tables = 1e-6 * np.linspace(1, 3, hinges)[:, None, None] * np.ones((1, 3, 5))
    np.savez_compressed(cell / "prediction.npz", **arrays, bending=tables)


def _of_error(cell: Path, test_mse: float, seconds: float) -> None:
    result = json.loads((cell / "result.json").read_text())
    result["metrics"]["test_mse"] = test_mse
    (cell / "result.json").write_text(json.dumps(result))
    steps = [
        {"kind": "value", "forward_equivalents": step, "wall_seconds": seconds * step, "best_loss": test_mse / step}
        for step in range(1, 12)
    ]
    (cell / "trace.jsonl").write_text("".join(json.dumps(step) + "\n" for step in steps))


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    """A report of two cloths and four methods, compared with another run."""
    folder, other = tmp_path_factory.mktemp("run"), tmp_path_factory.mktemp("other")
    for cloth in ("cotton_blue", "viscose_white"):
        for solver, error in (("homo", 0.03), ("heter", 0.02), ("sobol", 0.1), ("null:disc", 0.06)):
            cell = write_cell(folder, solver, cloth)
            _of_error(cell, error, 2.0)
            if solver == "heter":
                _elements_apart(cell)
        _of_error(write_cell(other, "homo", cloth), 0.05, 1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
        patch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 200)
        cells = load_cells(folder)
        write_report(cells, leaderboards(cells), folder / "report.html", compared=load_cells(other))
    return folder / "report.html"


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture
def opened(browser, report):
    with watched(browser, report) as open_page:
        yield open_page


def _column(page, number: int) -> list[str]:
    rows = page.locator(".board").first.locator("tbody tr:visible")
    return [text.strip() for text in rows.locator(f"td:nth-child({number})").all_inner_texts()]


def test_a_heading_sorts_by_click_and_by_keyboard(opened):
    page = opened()
    heading = page.locator(".board").first.locator("th", has_text="test")
    first = _column(page, 2)
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    assert _column(page, 2) == ["heter", "homo", "null:disc", "sobol"]
    page.keyboard.press("Enter")
    assert heading.get_attribute("aria-sort") == "descending"
    assert _column(page, 2) == ["sobol", "null:disc", "homo", "heter"]
    assert "descending" in page.locator(".status").first.inner_text()
    page.keyboard.press("Space")
    assert heading.get_attribute("aria-sort") == "none"
    assert _column(page, 2) == first


def test_rows_without_a_number_are_last_whichever_way_they_are_sorted(opened):
    page = opened()
    page.evaluate("document.querySelector('.board tbody tr td:nth-child(6)').textContent = ''")
    button = page.locator(".board").first.locator("th", has_text="test").get_by_role("button")
    for _ in range(2):
        button.click()
        assert _column(page, 6)[-1] == ""
        assert all(_column(page, 6)[:-1])


def test_rows_are_filtered_by_words_and_by_kind(opened):
    page = opened()
    board = page.locator(".board").first
    board.get_by_role("searchbox").fill("HO")
    assert _column(page, 2) == ["homo"]
    assert board.locator(".status").inner_text() == "1 of 4 rows."
    board.get_by_role("searchbox").fill("")
    board.get_by_label("solver", exact=True).uncheck()
    assert _column(page, 2) == ["null:disc"]


def test_tabs_show_one_cloth_and_follow_arrows_and_links(opened):
    page = opened()
    blue, white = page.locator("[role=tabpanel]").all()
    assert blue.is_visible()
    assert not white.is_visible()
    page.get_by_role("tab", name="cotton_blue").focus()
    page.keyboard.press("ArrowRight")
    assert white.is_visible()
    assert not blue.is_visible()
    assert page.get_by_role("tab", name="viscose_white").get_attribute("aria-selected") == "true"
    page.locator(".board").first.get_by_role("link", name="homo").click()
    playwright.expect(blue).to_be_visible()
    page.get_by_role("tab", name="viscose_white").click()
    page.locator(".board").first.get_by_role("link", name="homo").click()  # the same address once more
    playwright.expect(blue).to_be_visible()
    page.emulate_media(media="print")
    assert blue.is_visible()
    assert white.is_visible()
    assert not page.locator(".filter").first.is_visible()


def _picture(page) -> np.ndarray:
    page.wait_for_timeout(50)
    return shot(page.locator("canvas"))[20:-20, 20:-20]  # without the mark of the focus


def _open_viewer(page) -> None:
    page.locator("#drapes").scroll_into_view_if_needed()
    playwright.expect(page.locator("#drapes output")).not_to_be_empty()


def test_a_drape_is_drawn_coloured_and_turned(opened):
    page = opened(reduced_motion="reduce")
    _open_viewer(page)
    error = _picture(page)
    drawn = np.abs(error - error[0, 0]).sum(2) > 30
    assert 0.05 < drawn.mean() < 0.9
    assert (error[..., 2] - error[..., 0])[drawn].max() > 60  # blue: outside the real outline
    assert (error[..., 0] - error[..., 2])[drawn].max() > 60  # orange: inside
    page.locator("canvas").focus()
    page.keyboard.press("ArrowUp")
    assert np.abs(_picture(page) - error).max() > 60
    page.keyboard.press("Home")
    assert np.abs(_picture(page) - error).max() <= 2
    page.get_by_role("button", name="from above").click()
    assert np.abs(_picture(page) - error).max() > 60


def test_a_drape_is_coloured_by_stiffness_where_elements_have_their_own(opened):
    page = opened()
    _open_viewer(page)
    colours = page.get_by_label("Coloured by", exact=True)
    page.get_by_label("Method", exact=True).select_option(label="homo")
    assert "bending stiffness" not in colours.inner_text()
    page.get_by_label("Method", exact=True).select_option(label="heter")
    colours.select_option(label="bending stiffness")
    assert re.fullmatch(r"1\.\d+ µN m", page.locator(".scale .low").inner_text())
    assert "Bending stiffness" in (page.locator("canvas").get_attribute("aria-label") or "")
    stiff = _picture(page)
    colours.select_option(label="nothing")
    assert np.abs(_picture(page) - stiff).max() > 60


@pytest.fixture
def without_webgl(browser, report):
    """Opens the report in a browser whose WebGL 2 a script has spoilt."""
    contexts = []

    def without_webgl(script: str):
        contexts.append(browser.new_context(viewport=DESKTOP))
        page = contexts[-1].new_page()
        page.add_init_script(script)
        page.goto(report.as_uri())
        page.locator("#drapes").scroll_into_view_if_needed()
        return page

    yield without_webgl
    for context in contexts:
        context.close()


def _no_drape_can_be_turned(page) -> None:
    playwright.expect(page.get_by_text("Drapes cannot be turned here")).to_be_visible()
    playwright.expect(page.locator(".stage")).to_be_hidden()
    assert page.get_by_text("turn it in 3D").locator("visible=true").count() == 0


@pytest.mark.parametrize(
    "script",
    [
        "HTMLCanvasElement.prototype.getContext = () => null;",
        "WebGL2RenderingContext.prototype.getProgramParameter = () => false;",  # no shader links
    ],
)
def test_a_browser_that_cannot_draw_drapes_says_so(without_webgl, script):
    _no_drape_can_be_turned(without_webgl(script))


def test_a_page_that_loses_its_context_says_so(without_webgl):
    page = without_webgl("")
    _open_viewer(page)
    assert page.get_by_text("turn it in 3D").locator("visible=true").count() > 0
    lose = "(canvas) => canvas.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()"
    page.locator("canvas").evaluate(lose)
    _no_drape_can_be_turned(page)


def test_a_card_leads_to_its_drape(opened):
    page = opened(reduced_motion="reduce")
    page.get_by_role("tab", name="viscose_white").click()
    page.get_by_role("tab", name="viscose_white", selected=True).wait_for()  # or the card is still another cloth's
    page.locator("[role=tabpanel]:visible article", has_text="sobol").get_by_text("turn it in 3D").click()
    chosen = "() => document.activeElement.tagName === 'CANVAS'"  # what a click does last; a busy page does it later
    page.wait_for_function(chosen)
    assert page.get_by_label("Cloth", exact=True).input_value() == "viscose_white"
    assert "sobol on viscose_white" in (page.locator("canvas").get_attribute("aria-label") or "")
    assert page.evaluate("document.activeElement.tagName") == "CANVAS"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_telephone_scrolls_up_and_down_only(opened, scheme):
    page = opened(TELEPHONE, color_scheme=scheme)
    _open_viewer(page)
    for tab in page.get_by_role("tab").all():
        tab.click()
        assert page.evaluate("document.documentElement.scrollWidth") == TELEPHONE["width"]
    cards = page.locator("article.card:visible")
    assert cards.count()
    assert all(cards.evaluate_all("(all) => all.map((card) => card.scrollWidth <= card.clientWidth)"))
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, background[4:-1].split(","))) > 380) == (scheme == "light")


def test_paper_cuts_nothing_off(opened):
    page = opened({"width": 688, "height": 1000})  # A4 between its margins
    page.emulate_media(media="print")
    edges = "(all) => all.map((one) => one.getBoundingClientRect().right)"
    assert max(page.locator("table, svg, img, canvas").evaluate_all(edges)) <= 688


def test_everything_has_a_name_and_headings_skip_no_level(opened):
    page = opened()
    _open_viewer(page)
    assert page.evaluate(NAMELESS) == []
    levels = page.evaluate(HEADINGS)
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_who_wants_no_motion_gets_none(opened):
    behaviour = "getComputedStyle(document.documentElement).scrollBehavior"
    assert opened(reduced_motion="reduce").evaluate(behaviour) == "auto"
    assert opened(reduced_motion="no-preference").evaluate(behaviour) == "smooth"


def test_without_scripts_everything_is_shown_but_controls(opened):
    page = opened(java_script_enabled=False)
    assert page.locator("section h2:visible", has_text="cotton_blue").count() == 1
    assert page.locator("section h2:visible", has_text="viscose_white").count() == 1
    assert page.locator(".filter:visible, .stage:visible").count() == 0
    assert page.locator(".board").first.locator("tbody tr:visible").count() == 4


def test_changes_against_the_other_run_are_told(opened):
    page = opened()
    row = page.locator("#comparison tbody tr").first
    assert row.locator("td").first.inner_text() == "homo"
    assert "× 0.60" in row.inner_text()
    assert "Only in this run: heter, null:disc, sobol" in page.locator("#comparison").inner_text()
