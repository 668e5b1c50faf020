"""Pictures and graphs of reports: what they draw, and figures as parts of a page in both colour modes."""

import re
from importlib import resources

import numpy as np
import pytest
from html_page import Page
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from shown_cells import radii

from cusick_bench.leaderboard.bootstrap import Estimate
from cusick_bench.leaderboard.performance import PerformanceProfile
from cusick_bench.leaderboard.two_runs import Change, MethodChange
from cusick_bench.metrics import ruled_surface
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantity
from cusick_bench.metrics.stiffness import BENDING
from cusick_bench.report import View, cloth_colour, render_drape
from cusick_bench.report.drawing.change_graph import change_graph
from cusick_bench.report.drawing.inline_svg import inline_svg, page_figure, panel, printable
from cusick_bench.report.drawing.line_graphs import profile_graph, trace_graph
from cusick_bench.report.drawing.method_graphs import method_style, performance_graph
from cusick_bench.report.drawing.palette import MODEL, REAL, VARIABLES
from cusick_bench.report.drawing.pictures import ONLY_REAL, ONLY_SIMULATED, contact_sheet, difference_picture
from cusick_bench.report.drawing.radius_over_angle import draw_levels, label_axes
from cusick_bench.report.drawing.row_names import row_names
from cusick_bench.report.drawing.stiffness_graph import StiffnessLine, stiffness_graph


@pytest.fixture(autouse=True)
def _coarse_scenes(monkeypatch):
    """Most tests do not look at the drape closely."""
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 300)


def test_difference_is_blue_where_only_simulated_and_orange_where_only_real():
    simulated, real = np.zeros((4, 4)), np.zeros((4, 4))
    simulated[0, 0] = real[1, 1] = real[2, 2] = simulated[2, 2] = 1
    picture = difference_picture(simulated, real)
    assert tuple(picture[0, 0]) == (*ONLY_SIMULATED, 255)
    assert tuple(picture[1, 1]) == (*ONLY_REAL, 255)
    assert picture[2, 2, 3] > 0
    assert picture[3, 3, 3] == 0


def test_contact_sheet_fills_rows_of_three():
    sheet = contact_sheet(np.ones((4, 8, 8)))
    assert sheet.shape == (8, 12, 4)
    assert (sheet[:4, :, 3] == 255).all()
    assert (sheet[4:, 4:, 3] == 0).all()


def test_contact_sheet_takes_images_of_an_odd_size():
    assert contact_sheet(np.zeros((3, 301, 301))).shape == (150, 450, 4)


def test_drape_is_drawn_lit_from_above_with_its_shadow_beside():
    mesh = ruled_surface(radii(), strips=6)
    view = View(width=160, height=105)
    picture = render_drape(np.asarray(mesh.vertices), np.asarray(mesh.faces), cloth_colour("wool_red"), view)
    assert picture.shape == (105, 160, 4)
    cloth = (picture[..., 3] == 255) & (picture[..., 0] > 1.5 * picture[..., 2].astype(float))
    assert 0.15 < cloth.mean() < 0.6
    rows, columns = np.nonzero(cloth)
    assert abs(columns.mean() - 80) < 8
    brightness = picture[..., 0].astype(float)
    plate = brightness[cloth & (np.arange(105)[:, None] < np.percentile(rows, 40))]
    assert plate.mean() > brightness[cloth & (np.arange(105)[:, None] > np.percentile(rows, 80))].mean()
    shadow = (picture[..., 3] > 20) & (picture[..., 3] < 120) & (picture[..., :3].max(-1) == 0)
    assert shadow.any()
    assert picture[0, 0, 3] == 0


def test_a_fan_over_the_plate_is_as_flat_as_it_is():
    """The public meshes are one fan and one strip: normals averaged at the plate's edge would make it a dome."""
    fan = ruled_surface(np.full(720, 0.11))
    view = View(elevation=85.0, target=0.0, width=120, height=120, fov=22.0)
    picture = render_drape(np.asarray(fan.vertices), np.asarray(fan.faces), (0.5, 0.5, 0.5), view)
    row, column = np.mgrid[:120, :120]
    plate = picture[np.hypot(row - 59.5, column - 59.5) < 25, 0]
    assert np.ptp(plate) <= 1


def test_nearer_cloth_hides_what_is_behind_it():
    """Two sheets facing the eye: the nearer, smaller one is seen in front of the farther one, in either order."""
    square = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
    leaning = square + np.outer(square[:, 2], [0.5, 0, 0])
    vertices = np.vstack([0.08 * square, 0.04 * leaning + np.array([0.05, 0, 0])])
    vertices[:, 2] += 0.1
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    view = View(azimuth=0.0, elevation=1.0, target=0.1, width=80, height=80)
    pictures = [render_drape(vertices, order, (1.0, 1.0, 1.0), view) for order in (faces, faces[::-1])]
    np.testing.assert_array_equal(*pictures)
    alone = render_drape(vertices, faces[:2], (1.0, 1.0, 1.0), view)
    assert (alone[..., :3] != pictures[0][..., :3]).any()


def test_profile_graph_draws_both_lines_and_the_band():
    (axes,) = profile_graph(radii(), radii(8), np.stack([radii(6), radii(9)])).axes
    for colour, expected in ((REAL, radii()), (MODEL, radii(8))):
        (line,) = (line for line in axes.lines if same_color(line.get_color(), colour))
        np.testing.assert_allclose(line.get_ydata()[:-1], 1e3 * expected[::3])
        assert line.get_ydata()[-1] == line.get_ydata()[0]
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(132)
    assert heights.min() == pytest.approx(108)
    (alone,) = profile_graph(radii(), radii(8), None).axes
    assert not alone.collections


def test_real_and_simulated_differ_without_colour():
    (axes,) = profile_graph(radii(), radii(8), None).axes
    dashed = {line.get_color(): line.get_linestyle() != "-" for line in axes.lines if line.get_linewidth() == 2}
    assert dashed == {REAL: False, MODEL: True}


def test_levels_are_named_and_stay_inside():
    axes = panel(page_figure(300, 200), 40, 10, 250, 150)
    label_axes(axes, (95.0, 160.0))
    draw_levels(axes, named=True)
    assert [text.get_text() for text in axes.texts] == ["flat cloth"]
    assert [line.get_ydata()[0] for line in axes.lines] == [150]


def test_trace_graph_needs_two_evaluations_and_falls_in_steps():
    assert trace_graph(np.zeros((0, 2))) is None
    assert trace_graph(np.array([[1.0, 0.1]])) is None
    assert trace_graph(np.array([[1.0, 0.1], [2.0, 0.1]])) is not None
    figure = trace_graph(np.array([[1.0, 0.1], [4.0, 0.02]]))
    assert figure is not None
    (axes,) = figure.axes
    assert axes.get_yscale() == "log"
    assert axes.lines[0].get_drawstyle() == "steps-post"
    assert [text.get_text() for text in axes.get_yticklabels()] == [".02", ".05", ".1"]


def some_figure(words: str = "radius") -> Figure:
    figure = page_figure(300, 200)
    axes = panel(figure, 40, 10, 250, 150)
    axes.plot([0, 1], [0, 1], color=REAL)
    axes.axhline(0.5, color="#00ff00")
    axes.set_title(printable(words), parse_math=False)
    return figure


def test_a_figure_takes_the_colours_of_the_page_and_says_what_it_shows():
    drawn = Page(inline_svg(some_figure("<r> $x$ \x00"), 'a "line" <upwards>', "wide"))
    (graph,) = drawn.all("svg")
    assert (graph["class"], graph["role"], graph["aria-label"]) == ("graph wide", "img", 'a "line" <upwards>')
    assert graph["viewbox"] == "0 0 300 200"
    assert "width" not in graph
    assert "<r> $x$ ?" in drawn.text
    styles = " ".join(attributes.get("style") or "" for _, attributes in drawn.tags)
    assert "stroke: var(--real)" in styles
    assert "#fe00" not in styles
    assert "#00ff00" in styles
    assert "font-family" not in styles
    assert not {"style", "metadata"} & {tag for tag, _ in drawn.tags}  # they would hold for the whole page
    assert drawn.asks_for() == []


def test_the_same_figure_gives_the_same_bytes_and_others_share_no_id():
    first, again, other = (inline_svg(some_figure(), words) for words in ("one", "one", "other"))
    assert first == again
    ids = [{attributes["id"] for _, attributes in Page(svg).tags if "id" in attributes} for svg in (first, other)]
    assert ids[0]
    assert not ids[0] & ids[1]
    for svg in (first, other):
        known = [attributes["id"] for _, attributes in Page(svg).tags if "id" in attributes]
        assert len(known) == len(set(known))
        assert set(re.findall(r"url\(#([^)]+)\)|href=\"#([^\"]+)", svg)[0]) - {""} <= set(known)


def test_every_colour_of_figures_has_a_light_and_a_dark_variable():
    css = (resources.files("cusick_bench.report") / "templates" / "page.css").read_text(encoding="utf-8")
    for variable in VARIABLES.values():
        assert css.count(f"{variable}: ") == 2, variable
    assert all(f"var({name})" not in css or f"{name}: " in css for name in re.findall(r"var\((--[\w-]+)\)", css))


def _contrast(one: str, other: str) -> float:
    """Ratio of WCAG 2.2, from 1 to 21."""

    def luminance(colour: str) -> float:
        parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted([luminance(one), luminance(other)])
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("mode", [0, 1], ids=["light", "dark"])
def test_words_and_lines_stand_out_from_the_page_in_both_modes(mode):
    css = (resources.files("cusick_bench.report") / "templates" / "page.css").read_text(encoding="utf-8")
    colour = {name: found[mode] for name in re.findall(r"(--[\w-]+): #", css) if len(found := _values(css, name)) == 2}
    words = ("ink", "soft", "model", "none", "series-6", "row-null", "row-oracle", "row-floor")
    for ground in ("page", "card", "tint"):
        for name in words:
            assert _contrast(colour[f"--{name}"], colour[f"--{ground}"]) >= 4.5, (name, ground)
    for place in range(8):
        assert _contrast(colour[f"--series-{place}"], colour["--card"]) >= 3


def _values(css: str, name: str) -> list[str]:
    return re.findall(rf"{name}: (#[0-9a-f]{{6}})\b", css)


def test_each_direction_has_a_panel_of_its_own():
    values, true = {"warp": 4e-6, "weft": 1e-6, "bias": 2e-6}, {"warp": 2e-6, "weft": 3e-6, "bias": 5e-6}
    bending = {name: Quantity(value, (value / 2, 3 * value)) for name, value in values.items()}
    middles = np.array([values[name] for name in BENDING])
    draws = middles * np.exp(np.random.default_rng(0).normal(0, 0.05, (200, 3)))
    panels = stiffness_graph([StiffnessLine("bdp", FoundStiffness(bending, {}, {}, {}, true, {}), draws)]).axes
    for name, axes in zip(BENDING, panels, strict=True):
        value = 1e6 * values[name]
        assert name in {text.get_text() for text in axes.texts}
        truth, interval, mark = axes.lines
        assert list(truth.get_xdata()) == pytest.approx([1e6 * true[name]] * 2), name
        assert list(interval.get_xdata()) == pytest.approx([value / 2, 3 * value]), name
        assert list(mark.get_xdata()) == pytest.approx([value]), name
        (density,) = axes.collections
        places, heights = density.get_paths()[0].vertices.T
        assert places[heights.argmin()] == pytest.approx(value, rel=0.1), name


def found_of(value: float) -> FoundStiffness:
    return FoundStiffness(dict.fromkeys(BENDING, Quantity(value)), {}, {}, {}, None, {})


@pytest.mark.parametrize("value", [1.0e-6, 3.1e-6, 7e-6, 0.031e-6, 310e-6])
def test_an_axis_of_stiffness_has_two_numbers_at_least(value):
    """Between 2 and 5 of a decade, and between 5 and 10, an axis had none."""
    for axes in stiffness_graph([StiffnessLine("homo", found_of(value))]).axes:
        (kawabata,) = axes.child_axes
        for own in (axes, kawabata):
            (low, high), places = own.get_xlim(), own.get_xticks()
            assert 2 <= len(places) <= 5
            assert all(low <= place <= high for place in places)
            assert [float(text.get_text()) for text in own.get_xticklabels()] == pytest.approx(list(places))


def test_a_name_with_dollars_is_no_formula_in_graphs_of_methods():
    """The report ended with an error of matplotlib."""
    name = "fit,file=$_$x"
    change = MethodChange(name, "solver", 1, {"test_mse": Change(0.1, 0.2, Estimate(2.0, 1.5, 3.0))})
    for figure in (change_graph([change], "test_mse"), stiffness_graph([StiffnessLine(name, found_of(3e-6))])):
        assert name in Page(inline_svg(figure, "a graph")).text


def test_no_two_of_many_methods_are_drawn_alike():
    """From the 25th on their colours and dashes were those of others."""
    styles = [method_style(place) for place in range(144)]
    assert len(set(styles)) == 144
    assert {style.mark for style in styles[:24]} == {0}
    profiles = [PerformanceProfile(str(place), np.array([1.0, 1.5, 3.0])) for place in range(30)]
    figure = performance_graph(profiles, "cost", {one.label: place for place, one in enumerate(profiles)})
    marked = [str(line.get_marker()) not in ("", "None") for line in figure.axes[0].lines]
    assert marked == [False] * 24 + [True] * 6
    assert Page(inline_svg(figure, "a graph")).all("use")


def test_posterior_and_truth_are_drawn():
    found = FoundStiffness(
        dict.fromkeys(BENDING, Quantity(3e-6, (1e-6, 9e-6))), {}, {}, {}, dict.fromkeys(BENDING, 2e-6), {}
    )
    draws = 3e-6 * np.exp(np.random.default_rng(0).normal(0, 0.4, (60, 3)))
    with_both, fit_only = (stiffness_graph([StiffnessLine("bdp", found, drawn)]).axes[0] for drawn in (draws, None))
    assert len(with_both.collections) == 1
    assert len(fit_only.collections) == 0
    (truth,) = [line for line in with_both.lines if same_color(line.get_color(), REAL)]
    assert list(truth.get_xdata()) == pytest.approx([2.0, 2.0])
    low, high = with_both.get_xlim()
    assert low < 1.0
    assert high > 9.0


@pytest.mark.parametrize(
    ("labels", "shown"),
    [
        (["homo", "heter"], ["homo", "heter"]),
        (["homo (drape.law=paper, vertices=700)"], ["homo (drape.law=paper, vertic…"]),
        (
            ["homo (drape.law=paper, vertices=700)", "homo (drape.law=paper, vertices=2699)"],
            ["homo (drap…per, vertices=700)", "homo (drap…per, vertices=2699)"],
        ),
        (["x" * 40, "x" * 40], ["x" * 29 + "…"] * 2),
        (["\x00" * 40 + "a", "\x00" * 40 + "b"], ["?" * 10 + "…" + "?" * 18 + "a", "?" * 10 + "…" + "?" * 18 + "b"]),
    ],
)
def test_names_of_rows_are_cut_where_they_stay_apart(labels, shown):
    assert row_names(labels) == shown


def test_long_names_that_differ_in_several_places_stay_apart():
    options = [f"{'a' * 20}={i} {'b' * 30}={j}" for i in range(3) for j in range(3)]
    names = row_names([f"solver ({one})" for one in options])
    assert len(set(names)) == 9
    assert max(map(len, names)) <= 30
