"""Bar graphs of a diagnosis: the gap against its floor, its parts, the stages, the closed share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cusick_bench.report.diagnosis.wording.number_format import percent, plain, signed
from cusick_bench.report.drawing.inline_svg import TICK_SIZE, page_figure, panel, printable
from cusick_bench.report.drawing.palette import CARD, CAUSE, FLOOR, INK, REAL, RULE, SOFT

_NAME_SIZE, _SMALL_NAME_SIZE = 13.0, 12.5  # letters of a bar's name and value [px]
_CLOSURE_LIMITS = (-1.0, 2.0)  # beyond them the bar is cut


@dataclass(frozen=True)
class Bar:
    """A bar of a graph.

    Attributes:
        name: What stands before it.
        value: Its length, None if unknown.
        colour: Colour of the palette.
        mark: Value of a line across it, such as a floor.
    """

    name: str
    value: float | None
    colour: str
    mark: float | None = None


def gap_graph(bars: Sequence[Bar], floor: float | None) -> Figure:
    """The gap of each model, and the floor as a line through all bars.

    Args:
        bars: From the largest to what they are read against.
        floor: What chance alone exceeds in one of twenty cases, None if unknown.

    Returns:
        The figure.
    """
    figure = page_figure(930, 40 * len(bars) + 52)
    axes = panel(figure, 230, 8, 610, 40 * len(bars))
    known = [one.value for one in bars if one.value is not None]
    _draw_bars(axes, bars, _limits([*known, floor or 0.0]), 0.6, _NAME_SIZE, plain)
    axes.tick_params(axis="x", length=0, labelbottom=True)
    axes.xaxis.set_major_formatter(lambda value, place: signed(f"{value:.3g}"))
    axes.set_xlabel("gap G: squared energy distance between data and model (0 = no difference)", labelpad=5)
    axes.grid(axis="x", color=RULE)
    if floor is not None:
        axes.axvline(floor, color=FLOOR, linewidth=2.5)
    return figure


def bars_graph(bars: Sequence[Bar], *, percents: bool = False) -> Figure:
    """Bars one below another, with their values behind them.

    Args:
        bars: From top to bottom.
        percents: Whether values are shares.

    Returns:
        The figure.
    """
    figure = page_figure(440, 25 * len(bars) + 6)
    axes = panel(figure, 168, 2, 216, 25 * len(bars))
    known = [value for one in bars for value in (one.value, one.mark) if value is not None]
    words = percent if percents else plain
    _draw_bars(axes, bars, (0.0, 1.0) if percents else _limits(known), 0.64, _SMALL_NAME_SIZE, words)
    axes.spines["bottom"].set_visible(False)
    for place, one in enumerate(bars):
        if one.mark is not None:
            axes.plot([one.mark] * 2, [place - 0.44, place + 0.44], color=FLOOR, linewidth=2.5, clip_on=False)
    return figure


def closure_graph(fraction: float, interval: tuple[float, float] | None) -> Figure:
    """The closed share of the gap, with its interval, between nothing and all of it; cut where it leaves -1 to 2.

    Args:
        fraction: The closed share.
        interval: Its interval, None if unknown.

    Returns:
        The figure.
    """
    low, high = _CLOSURE_LIMITS
    length, *ends = (min(max(value, low), high) for value in (fraction, *(interval or ())))
    figure = page_figure(900, 82)
    axes = panel(figure, 60, 6, 780, 52)
    left, right = _limits([length, 1.0, *ends])
    axes.set(xlim=(left, right + 0.02 * (right - left)), ylim=(-1, 1), yticks=[])
    axes.spines["bottom"].set_visible(False)
    quarters = right - left < 1.5  # else their names overlap
    ticks = {0.0: ": nothing", 0.5: ": half", 1.0: ": all of it"} | ({0.25: "", 0.75: ""} if quarters else {})
    axes.set_xticks(list(ticks), [f"{percent(tick)}{name}" for tick, name in ticks.items()])
    axes.tick_params(axis="x", length=0)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        axes.axvline(tick, color=SOFT if tick in (0.0, 1.0) else RULE, linewidth=0.9)
    axes.barh(0, length, height=0.95, color=CAUSE)
    if ends:
        axes.plot(ends, [0, 0], color=CARD, linewidth=6, solid_capstyle="butt", clip_on=False)
        middle, arms = sum(ends) / 2, (max(ends) - min(ends)) / 2
        axes.errorbar(middle, 0, xerr=arms, fmt="none", ecolor=REAL, elinewidth=2.5, capsize=8, capthick=2.5)
    return figure


def _draw_bars(
    axes: Axes,
    bars: Sequence[Bar],
    limits: tuple[float, float],
    height: float,
    size: float,
    words: Callable[[float | None], str],
) -> None:
    """Bars from top to bottom with name and value, and a line at 0."""
    axes.set(xlim=limits, ylim=(len(bars) - 0.5, -0.5))
    axes.barh(range(len(bars)), [one.value or 0.0 for one in bars], height=height, color=[one.colour for one in bars])
    axes.set_yticks(range(len(bars)), [printable(one.name) for one in bars], fontsize=size, color=INK, parse_math=False)
    axes.tick_params(axis="y", pad=9)
    axes.tick_params(axis="x", length=0, labelbottom=False, labelsize=TICK_SIZE)
    axes.grid(visible=False)
    axes.axvline(0, color=SOFT, linewidth=0.9)
    for place, one in enumerate(bars):
        end = max(one.value or 0.0, one.mark or 0.0, 0.0)
        axes.annotate(
            words(one.value), (end, place), xytext=(8, 0), textcoords="offset points", va="center", color=INK,
            fontsize=size, annotation_clip=False, parse_math=False,
        )  # fmt: skip


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """Smallest range that holds the values and 0, never empty."""
    low, high = min(0.0, *values, 0.0), max(0.0, *values, 0.0)
    return low, high if high - low > 1e-12 else low + 1.0
