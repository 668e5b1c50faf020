"""Graphs of the page of a diagnosis: bars, the map on the cloth, outlines and profiles, in the units of their axes."""

import json

import numpy as np
import pytest
from made_up_diagnosis import (
    made_up_profiles,
)
from matplotlib.axes import Axes
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation, Text

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.document.build import _measured
from cusick_bench.diagnosis.document.model import Profiles
from cusick_bench.diagnosis.measure.captures import captures_from_profiles
from cusick_bench.report.diagnosis.graphs.bars import Bar, bars_graph, closure_graph, gap_graph
from cusick_bench.report.diagnosis.graphs.cloth_map import Arrow, Region, cloth_map
from cusick_bench.report.diagnosis.graphs.profile_graphs import every_graph, mean_graph, silhouette_graph, sorted_graph
from cusick_bench.report.diagnosis.graphs.profiles import Sided, mean_difference, sided_profiles
from cusick_bench.report.diagnosis.wording.number_format import percent
from cusick_bench.report.drawing.palette import CAUSE, FLOOR, MODEL, REAL


@pytest.fixture(scope="module")
def profiles() -> dict[str, list[dict]]:
    return made_up_profiles()


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


def test_a_cloth_that_is_turned_about_x_is_shown_as_one_turned_about_y():
    labels = {"sample": np.array([1, 1]), "side": ["up", "down"], "capture": np.array([1, 3])}
    seen = {"about y": 200, "about x": 20}  # where the camera sees the bump of the lower face
    about_y, about_x = (
        sided_profiles(
            Profiles(
                data=_measured(
                    captures_from_profiles(
                        np.stack([ring(30), ring(at)]), protocol=Protocol(turn_over=turn_over), **labels
                    )
                )
            )
        )["data"]
        for turn_over, at in seen.items()
    )
    assert about_x["down"].radii.argmax(1).tolist() == about_y["down"].radii.argmax(1).tolist() == [340]
    for side in ("up", "down"):
        np.testing.assert_allclose(about_x[side].radii, about_y[side].radii, atol=1e-9)


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


def test_pictures_of_one_drape_do_not_lower_what_chance_makes():
    base = [{"side": "up", "sample": number, "radii_m": [0.12] * 360} for number in (1, 2, 3)]
    once = [{"side": "up", "sample": number, "radii_m": [0.12 + 0.001 * number] * 360} for number in (1, 2, 3)]
    found = [mean_difference(read({"data": times * once, "base": base}), "base") for times in (1, 2, 4)]
    expected = 0.001 / np.sqrt(3)  # samples 1 mm apart, the mean of three
    assert [one and one[1] for one in found] == pytest.approx([expected] * 3)


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
