"""Line graphs of a cell: radius over angle, loss over cost."""

from math import ceil, floor, log10

from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.report.drawing.inline_svg import page_figure, panel
from cusick_bench.report.drawing.palette import MODEL, REAL, SIMULATED_DASH
from cusick_bench.report.drawing.radius_over_angle import (
    draw_levels,
    draw_range,
    draw_turn,
    label_axes,
    radius_limits,
)

_HEIGHT = 214.0
_PROFILE_WIDTH, _TRACE_WIDTH = 560.0, 415.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 8.0, 12.0, 40.0  # room around the axes [px]
_POINTS = 3  # angles from point to point of a line


def profile_graph(
    real: Float[ndarray, " angles"],
    simulated: Float[ndarray, " angles"],
    unseen: Float[ndarray, "samples angles"] | None,
    protocol: Protocol = RELEASE,
) -> Figure:
    """Radius over angle: the real training sample, the simulation (dashed), and the range that unseen samples fill.

    Args:
        real: Radii at equidistant angles [m].
        simulated: Radii at the same angles [m].
        unseen: Radii of unseen samples [m], None where they are not at hand.
        protocol: Gives radii of plate and cloth.

    Returns:
        The figure.
    """
    figure = page_figure(_PROFILE_WIDTH, _HEIGHT)
    axes = panel(figure, _LEFT, _TOP, _PROFILE_WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM)
    every = [real, simulated] if unseen is None else [real, simulated, unseen]
    label_axes(axes, radius_limits(*every, protocol=protocol))
    draw_levels(axes, named=True, protocol=protocol)
    if unseen is not None and len(unseen) > 1:
        draw_range(axes, unseen[:, ::_POINTS], color=REAL, alpha=0.15)
    draw_turn(axes, real[::_POINTS], color=REAL, linewidth=2)
    draw_turn(axes, simulated[::_POINTS], color=MODEL, linewidth=2, linestyle=SIMULATED_DASH)
    return figure


def trace_graph(trace: Float[ndarray, "evaluations 2"]) -> Figure | None:
    """Best training loss over cost, on a logarithmic scale.

    Args:
        trace: Forward-equivalents and best loss after each evaluation.

    Returns:
        The figure, None where fewer than two evaluations are known.
    """
    trace = trace[(trace > 0).all(1)] if len(trace) else trace
    if len(trace) < 2:
        return None
    cost, loss = trace.T
    figure = page_figure(_TRACE_WIDTH, _HEIGHT)
    axes = panel(figure, _LEFT, _TOP, _TRACE_WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM)
    axes.step(cost, loss, where="post", color=MODEL, linewidth=2)
    low, high = floor(4 * log10(loss.min())) / 4, ceil(4 * log10(loss.max()) + 1e-9) / 4
    axes.set(xlabel="cost [drapes]", ylabel="best loss", yscale="log", xlim=(0, cost.max()), ylim=(10**low, 10**high))
    ticks = [m * 10.0**e for e in range(floor(low), ceil(high) + 1) for m in (1, 2, 5)]
    shown = [tick for tick in ticks if 10**low <= tick <= 10**high]
    axes.set_yticks(shown, [_short_number(tick) for tick in shown])
    axes.minorticks_off()
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7, integer=True))
    return figure


def _short_number(value: float) -> str:
    return f"{value:g}".replace("0.", ".", 1) if value < 1 else f"{value:g}"
