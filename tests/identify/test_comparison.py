"""A fabric among measured ones: quantiles, ranks with the interval carried through, words that say no more."""

import json
from math import inf
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.files import BadFile
from cusick_bench.identify.comparison import compare, weight_words
from cusick_bench.identify.comparison_section import comparison_section
from cusick_bench.identify.document import Fit, Stiffness
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.measured_fabrics import (
    DIRECTIONS,
    LEVELS,
    QUANTITIES,
    SHIPPED,
    WEIGHTS,
    FabricRange,
    are_shipped,
    compared_ranges,
    fabric_quantiles,
    fabric_ranges,
    quantile_table,
)
from cusick_bench.metrics.stiffness import bending_length
from cusick_bench.report.drawing.fabric_range_graph import fabric_range_graph

HEAD = "density[kg.m-2], linear warp[SI*1e9], linear weft[SI*1e9], linear diag[SI*1e9], nonlinear warp[SI*1e12]\n"
LOG_NORMAL = FabricRange("bending", "warp", 0.0, inf, 500, tuple(np.exp([-2.3263, -1.6449, -1.2816, -0.6745, 0.0,
                                                                         0.6745, 1.2816, 1.6449, 2.3263])))  # fmt: skip


def fit(**stiffness: Stiffness) -> Fit:
    return Fit(
        image="a.png", sample=1, stiffness=dict(stiffness), stretch={}, solver="bdp-field", drapes=400.0, path="run"
    )


@pytest.fixture(scope="module")
def published(tmp_path_factory) -> Path:
    """A table in the published form: 50 fabrics in each range of weight, weft and bias 1/4 and 1/2 of the warp."""
    path = tmp_path_factory.mktemp("fabrics") / "fabrics.csv"
    lines = [
        f"{weight}, {step}, {step / 4}, {step / 2}, -1\n"
        for weight in (0.05, 0.1, 0.17, 0.23, 0.3, 0.5)
        for step in np.geomspace(1e3, 1e5, 50)
    ]
    path.write_text(HEAD + "".join(lines))
    return path


def test_bending_length_of_a_known_strip():
    """A flexural rigidity of 98.0665 uN m at 100 g/m2: 1 gf cm over .01 gf/cm2, 100 cm3, of which the root is 4.64."""
    assert bending_length(98.0665e-6, 0.1) == pytest.approx(0.01 * 100 ** (1 / 3))


def test_the_share_below_a_value_is_exact_where_logarithms_are_normal():
    for score, percent in ((-1.0, 15.866), (0.0, 50.0), (0.3, 61.791), (2.0, 97.725)):
        assert LOG_NORMAL.percent_below(np.exp(score)) == pytest.approx(percent, abs=0.01)


def test_beyond_the_outer_quantiles_only_the_bound_is_known():
    assert LOG_NORMAL.percent_below(1e-9) == pytest.approx(1)
    assert LOG_NORMAL.percent_below(1e9) == pytest.approx(99)


def test_quantiles_of_a_published_table(published):
    table = fabric_quantiles(published)
    assert len(table) == len(QUANTITIES) * len(DIRECTIONS) * len(WEIGHTS)
    row = table[(table["quantity"] == "bending") & (table["direction"] == "mean") & (table["most_kg_m2"] == 0.2)]
    assert row["fabrics"].item() == 50
    assert row["q50"].item() == pytest.approx(1e-9 * 0.5 * np.median(np.geomspace(1e3, 1e5, 50)))  # root of 1/4
    lengths = table[(table["quantity"] == "bending_length") & (table["direction"] == "warp")]
    assert lengths["q01"].iloc[0] < lengths["q01"].iloc[3]  # the longest are the lightest: all < those of 170 g/m2


def test_quantiles_are_the_same_whatever_their_source_is_called(published, tmp_path):
    (tmp_path / "shipped.csv").write_text(quantile_table(published))
    renamed = tmp_path / "Feng 2022.csv"
    renamed.write_bytes(published.read_bytes())
    assert are_shipped(quantile_table(renamed), tmp_path / "shipped.csv")
    renamed.write_text(published.read_text().replace("0.05, 1000.0,", "0.05, 900.0,", 1))
    assert not are_shipped(quantile_table(renamed), tmp_path / "shipped.csv")


def test_every_fabric_has_a_range_of_its_weight():
    for weight in (0.01, 0.08, 0.1999, 0.2, 2.0):
        every, similar = compared_ranges("bending", "weft", weight)
        assert similar.least <= weight < similar.most
        assert every.fabrics == 618
    groups = {(one.least, one.most): one.fabrics for one in fabric_ranges()}
    assert sum(groups.values()) == 2 * 618


def test_the_shipped_quantiles_are_those_of_the_published_table(real_data):
    """618 fabrics: shares below each fabric's own stiffness are off by 1.2 % in the mean."""
    table = real_data.parent / "priors" / "fabrics618.csv"
    if not table.is_file():
        pytest.skip("needs the published table of fabrics, which is not shipped")
    result = CliRunner().invoke(app, ["data", "fabric-quantiles", str(table), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["shipped"]
    warp = np.loadtxt(table, delimiter=",", skiprows=1)[:, 1] * 1e-9
    every, _ = compared_ranges("bending", "warp", 0.1)
    shares = np.array([every.percent_below(one) for one in warp])
    ranks = 100 * (np.argsort(np.argsort(warp)) + 0.5) / len(warp)
    assert np.abs(shares - ranks).mean() < 1.3
    assert np.abs(shares - ranks).max() < 5.0


def test_a_fabric_of_median_stiffness_is_in_the_middle_and_its_interval_is_carried_through():
    _, similar = compared_ranges("bending", "warp", 0.17)
    low, middle, high = (similar.quantiles[LEVELS.index(level)] for level in (0.05, 0.5, 0.95))
    found = compare(0.17, fit(warp=Stiffness(value=middle, ci90=(low, high))), None)
    assert found is not None
    stiffness, length = found.numbers
    assert stiffness.among_similar.percent == pytest.approx(50)
    assert stiffness.among_similar.ci90 == pytest.approx((5, 95))
    assert length.quantity == "bending_length"
    assert length.value == pytest.approx(bending_length(middle, 0.17))
    assert length.ci90 == pytest.approx((bending_length(low, 0.17), bending_length(high, 0.17)))
    assert found.similar_kg_m2 == (0.14, 0.2)
    assert "140 to 200 g/m² this one is middling" in found.summary
    assert "from very limp to very stiff" in found.summary


def test_a_sure_stiffness_gives_one_word():
    _, similar = compared_ranges("bending", "weft", 0.1)
    high = similar.quantiles[LEVELS.index(0.75)]
    found = compare(0.1, fit(weft=Stiffness(value=high, ci90=(0.99 * high, 1.01 * high))), None)
    assert found is not None
    assert "this one is stiff, all over the 90 % interval" in found.summary


def stiffness_above(percent: float, direction: str, interval: tuple[float, float] | None = None) -> Stiffness:
    """That of which so many of the measured fabrics of 170 g/m2 have less, with bounds that are given likewise."""
    _, similar = compared_ranges("bending", direction, 0.17)
    scores, logarithms = norm.ppf(LEVELS), np.log(similar.quantiles)
    shares = np.array([percent, *(interval or ())])
    value, *bounds = np.exp(np.interp(norm.ppf(shares / 100), scores, logarithms)).tolist()
    return Stiffness(value=value, ci90=(bounds[0], bounds[1]) if bounds else None)


@pytest.mark.parametrize(
    ("percent", "word"),
    [(9.9, "very limp"), (10.1, "limp"), (29.9, "limp"), (30.1, "middling"), (69.9, "middling"), (70.1, "stiff"),
     (89.9, "stiff"), (90.1, "very stiff")],
)  # fmt: skip
def test_words_hold_up_to_the_shares_that_the_page_names(percent, word):
    """docs/drape-meter.md: up to 10, 30, 70, 90, 100 % of fabrics of similar weight."""
    found = compare(0.17, fit(warp=stiffness_above(percent, "warp")), None)
    assert found is not None
    assert f"this one is {word}. Its stiffness" in found.summary


def test_warp_and_weft_count_alike_in_words_and_bias_does_not():
    """Of the shares 20 and 72 % the mean is 46 %, of those of their bounds 14 and 20 %, 25 and 83 %: 17 and 54 %."""
    found = compare(
        0.17,
        fit(
            bias=stiffness_above(95, "bias", (94, 96)),
            warp=stiffness_above(20, "warp", (14, 25)),
            weft=stiffness_above(72, "weft", (20, 83)),
        ),
        None,
    )
    assert found is not None
    assert (
        "this one is middling; the 90 % interval of its stiffness allows anything from limp to middling"
        in found.summary
    )


def test_the_stiffness_of_all_samples_has_no_interval_and_says_so():
    found = compare(0.5, None, 5e-5)
    assert found is not None
    assert {one.direction for one in found.numbers} == {"mean"}
    assert found.numbers[0].ci90 is None
    assert found.numbers[0].among_all.ci90 is None
    assert found.similar_kg_m2 == (0.35, None)
    assert "how sure that is is not known" in found.summary


def test_a_share_beyond_the_outer_quantiles_is_shown_as_a_bound():
    found = compare(0.17, fit(warp=Stiffness(value=1e-9), weft=Stiffness(value=0.1)), None)
    assert found is not None
    limp, stiff, *_ = comparison_section("fabric_1", found, 0.17).rows
    assert (limp.among_similar, limp.among_all) == ("at most 1 %", "at most 1 %")
    assert (stiff.among_similar, stiff.among_all) == ("at least 99 %", "at least 99 %")


def test_all_fabrics_and_those_of_similar_weight_are_not_taken_for_each_other(monkeypatch):
    """A cloth that is stiff for its weight: in the table, and in the graph, where all lie above those of its weight."""
    every, similar = compared_ranges("bending", "warp", 0.09)
    found, drawn = compare(0.09, fit(warp=Stiffness(value=3e-5)), None), []
    assert found is not None

    def graph(panels):
        drawn.extend(panels)
        return fabric_range_graph(panels)

    monkeypatch.setattr("cusick_bench.identify.comparison_section.fabric_range_graph", graph)
    row, *_ = comparison_section("fabric_1", found, 0.09).rows
    shares = [one.percent_below(3e-5) for one in (similar, every)]
    assert shares[0] > shares[1] + 5
    assert [row.among_similar, row.among_all] == [f"{share:.0f} %" for share in shares]
    bending = drawn[0].rows[0]
    shown = [LEVELS.index(level) for level in (0.05, 0.25, 0.5, 0.75, 0.95)]
    for numbers, among in ((bending.every, every), (bending.similar, similar)):
        assert numbers == pytest.approx([1e6 * among.quantiles[place] for place in shown])
    lines = [np.asarray(line.get_xydata()) for axes in fabric_range_graph(drawn[:1]).axes for line in axes.lines]
    for numbers, above in ((bending.every, True), (bending.similar, False)):
        (height,) = (line[0, 1] for line in lines if line[:, 0].tolist() == [numbers[2]])
        assert (height < 0) == above  # heights count downwards


def test_without_weight_or_stiffness_there_is_nothing_to_compare():
    assert compare(None, fit(warp=Stiffness(value=1e-5)), None) is None
    assert compare(0.2, None, None) is None


def test_ranges_of_weight_in_words():
    assert weight_words(0.0, 0.08) == "less than 80 g/m²"
    assert weight_words(0.35, None) == "350 g/m² and more"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("weight,warp\n1,2\n", "column whose name begins with 'density'"),
        (HEAD + "0.1, 5, 5, stiff, -1\n", "line 2: linear diag.* must be a number > 0, got 'stiff'"),
        (HEAD + "0.1, 5, -5, 5, -1\n", "line 2: linear weft.* must be a number > 0, got '-5'"),
        (HEAD + "0.1, 5, 5, 5, -1\n", "1 fabrics weigh 0 to inf kg/m2, and quantiles need 20"),
    ],
)
def test_a_table_that_is_not_the_published_one_is_refused(text, says, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises((BadFile, IdentifyError), match=says):
        fabric_quantiles(path)


def test_damaged_quantiles_are_refused(tmp_path):
    path = tmp_path / "quantiles.csv"
    path.write_text(SHIPPED.read_text().replace("0.02503", "0.00001", 1))
    with pytest.raises(BadFile, match="quantiles > 0 that do not fall"):
        fabric_ranges(path)
