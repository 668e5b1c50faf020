"""Line graphs of a report: radius over angle, loss over cost."""

from math import ceil, floor, log10

import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.report.drawing.axes import frame, framed, level
from cusick_bench.report.drawing.svg import picture, polygon, polyline
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_HEIGHT = 214.0
_PROFILE_WIDTH, _TRACE_WIDTH = 560.0, 415.0


def profile_graph(
    real: Float[ndarray, " angles"],
    simulated: Float[ndarray, " angles"],
    unseen: Float[ndarray, "samples angles"] | None,
    description: str,
) -> Markup:
    """Radius over angle: the real training sample, the simulation, and the band that unseen samples fill.

    Args:
        real: Radii at equidistant angles [m].
        simulated: Radii at the same angles [m].
        unseen: Radii of unseen samples [m], None where they are not at hand.
        description: What a reader who cannot see the graph is told.
    """
    every = [real, simulated] if unseen is None else [real, simulated, *unseen]
    low = min(85.0, 5 * floor(200 * min(radii.min() for radii in every)))
    high = max(153.0, 1e3 * max(radii.max() for radii in every) + 3)
    panel = framed(_PROFILE_WIDTH, _HEIGHT, (0.0, 360.0), (low, high))
    angle = np.arange(0, len(real) + 1, 3) * 360 / len(real)
    ticks = [0.0, 90.0, 180.0, 270.0, 360.0], [90.0, 110.0, 130.0, 150.0]
    parts = frame(panel, "angle from warp [deg]", "radius [mm]", *ticks)
    parts += [*level(panel, 1e3 * PLATE_RADIUS, "plate"), *level(panel, 1e3 * CLOTH_RADIUS, "flat cloth")]
    if unseen is not None and len(unseen) > 1:
        edges = [1e3 * np.append(edge, edge[0])[::3] for edge in (unseen.min(0), unseen.max(0))]
        around = np.concatenate([angle, angle[::-1]]), np.concatenate([edges[0], edges[1][::-1]])
        parts.append(polygon(panel.points(*around), "band"))
    for radii, name in ((real, "real"), (simulated, "simulated")):
        parts.append(polyline(panel.points(angle, 1e3 * np.append(radii, radii[0])[::3]), name))
    return picture(parts, _PROFILE_WIDTH, _HEIGHT, description)


def trace_graph(trace: Float[ndarray, "evaluations 2"], description: str) -> Markup:
    """Best training loss over cost, on a logarithmic scale; empty where fewer than two evaluations are known.

    Args:
        trace: Forward-equivalents and best loss after each evaluation.
        description: What a reader who cannot see the graph is told.
    """
    trace = trace[(trace > 0).all(1)] if len(trace) else trace
    if len(trace) < 2:
        return Markup("")
    cost, loss = trace[:, 0], np.log10(trace[:, 1])
    low, high = floor(4 * loss.min()) / 4, ceil(4 * loss.max() + 1e-9) / 4
    panel = framed(_TRACE_WIDTH, _HEIGHT, (0.0, float(cost.max())), (low, max(high, low + 0.25)))
    ticks = [log10(m * 10.0**e) for e in range(floor(low), ceil(high) + 1) for m in (1, 2, 5)]
    shown = [tick for tick in ticks if low <= tick <= panel.y[1]]
    step = 10 ** floor(log10(cost.max())) / (1 if cost.max() >= 4 * 10 ** floor(log10(cost.max())) else 2)
    costs = np.arange(0, cost.max() + 1e-9, step).tolist()
    parts = frame(panel, "cost [drapes]", "best loss", costs, shown, y_words=lambda tick: _number(10**tick))
    stairs = np.repeat(np.column_stack([cost, loss]), 2, axis=0)
    parts.append(polyline(panel.points(stairs[1:, 0], stairs[:-1, 1]), "simulated"))
    return picture(parts, _TRACE_WIDTH, _HEIGHT, description)


def _number(value: float) -> str:
    return f"{value:g}".replace("0.", ".", 1) if value < 1 else f"{value:g}"
