"""The part of a fabric's page that compares it with measured fabrics."""

from dataclasses import dataclass

from markupsafe import Markup

from cusick_bench.identify.comparison import weight_words
from cusick_bench.identify.document import Compared, Comparison, Rank
from cusick_bench.identify.measured_fabrics import LEVELS, FabricRange, compared_ranges
from cusick_bench.leaderboard import significant
from cusick_bench.report.drawing.fabric_range_graph import FabricPanel, FabricRow, fabric_range_graph
from cusick_bench.report.drawing.inline_svg import inline_svg

_SHOWN = tuple(LEVELS.index(level) for level in (0.05, 0.25, 0.5, 0.75, 0.95))
_PANELS = {"bending": ("Bending stiffness", "µN m", 1e6), "bending_length": ("Bending length", "cm", 100.0)}
_LABELS = {"mean": "all samples"}


@dataclass(frozen=True)
class ComparisonRow:
    """A line of the table.

    Attributes:
        name: Quantity and direction.
        value: The number with its interval and unit.
        among_similar: Share of fabrics of similar weight that have less.
        among_all: Share of all fabrics that have less.
    """

    name: str
    value: str
    among_similar: str
    among_all: str


@dataclass(frozen=True)
class ComparisonSection:
    """A fabric among measured ones.

    Attributes:
        summary: How stiff it is for its weight, in words.
        fabrics: Number of measured fabrics.
        similar: Number and weight of those of similar weight, in words.
        graph: Its numbers over the ranges of measured fabrics.
        rows: The same as a table.
    """

    summary: str
    fabrics: int
    similar: str
    graph: Markup
    rows: list[ComparisonRow]


def comparison_section(name: str, comparison: Comparison, areal_density: float) -> ComparisonSection:
    """A fabric among measured ones, ready for its template.

    Args:
        name: Name of the fabric.
        comparison: Its comparison.
        areal_density: Its mass per area [kg/m2].

    Returns:
        The section.
    """
    panels = []
    for quantity, (title, unit, factor) in _PANELS.items():
        numbers = [one for one in comparison.numbers if one.quantity == quantity]
        panels.append(FabricPanel(title, unit, [_graph_row(one, areal_density, factor) for one in numbers]))
    rows = [_row(one) for one in comparison.numbers]
    words = "; ".join(f"{row.name} {row.value}, more than {row.among_similar} of similar weight" for row in rows)
    return ComparisonSection(
        summary=comparison.summary,
        fabrics=comparison.fabrics,
        similar=f"{comparison.similar_fabrics} of {weight_words(*comparison.similar_kg_m2)}",
        graph=inline_svg(fabric_range_graph(panels), f"{name} among measured fabrics: {words}", "panels"),
        rows=rows,
    )


def _graph_row(one: Compared, areal_density: float, factor: float) -> FabricRow:
    every, similar = compared_ranges(one.quantity, one.direction, areal_density)

    def shown(among: FabricRange) -> tuple[float, ...]:
        return tuple(factor * among.quantiles[place] for place in _SHOWN)

    ci90 = None if one.ci90 is None else (factor * one.ci90[0], factor * one.ci90[1])
    label = _LABELS.get(one.direction, one.direction)
    return FabricRow(label, factor * one.value, ci90, shown(every), shown(similar))


def _row(one: Compared) -> ComparisonRow:
    title, unit, factor = _PANELS[one.quantity]
    bounds = "" if one.ci90 is None else f" [{', '.join(significant(factor * bound) for bound in one.ci90)}]"
    return ComparisonRow(
        name=f"{title.lower()}, {_LABELS.get(one.direction, one.direction)}",
        value=f"{significant(factor * one.value)}{bounds} {unit}",
        among_similar=_percent(one.among_similar),
        among_all=_percent(one.among_all),
    )


def _percent(rank: Rank) -> str:
    """A share, such as `58 % [31, 82]`; the outermost shares are bounds."""
    text = f"{rank.percent:.0f} %"
    if rank.percent <= 100 * LEVELS[0]:
        text = f"at most {text}"
    elif rank.percent >= 100 * LEVELS[-1]:
        text = f"at least {text}"
    return text if rank.ci90 is None else f"{text} [{rank.ci90[0]:.0f}, {rank.ci90[1]:.0f}]"
