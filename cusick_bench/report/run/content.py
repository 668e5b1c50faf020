"""What a report's page holds, ready for its template: cloths, cards, numbers, embedded pictures and graphs."""

import base64
from dataclasses import dataclass, field, replace
from math import isfinite, nan

import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.datasets.profile import Profile, drape_coefficient, fold_count
from cusick_bench.leaderboard import short
from cusick_bench.report.cell_view import CellView, shown_surface
from cusick_bench.report.drawing.line_graphs import profile_graph, trace_graph
from cusick_bench.report.drawing.pictures import (
    ONLY_REAL,
    ONLY_SIMULATED,
    contact_sheet,
    difference_picture,
    drape_picture,
    png,
    silhouette_picture,
)

_SWATCH = '<span class="swatch" style="background:rgb{}"></span> '
_DIFFERENCE_KEY = Markup(  # colours of `difference_picture`
    _SWATCH.format(ONLY_SIMULATED) + "only simulated " + _SWATCH.format(ONLY_REAL) + "only real"
)


@dataclass(frozen=True)
class Picture:
    """An embedded picture with what a reader who cannot see it is told."""

    source: str
    alt: str
    caption: str | Markup
    wide: bool = False


@dataclass(frozen=True)
class Number:
    """A number of a card: what it is, its value, and what it is to be read against."""

    name: str
    value: str
    of: str = ""


@dataclass(frozen=True)
class Card:
    """One solver on one cloth; `problem` says why there are no pictures."""

    solver: str
    kind: str
    seeds: str
    numbers: list[Number]
    problem: str = ""
    pictures: list[Picture] = field(default_factory=list)
    profile: str = ""
    trace: str = ""
    fitted: str = ""
    band: int = 0
    draws: Picture | None = None


def fill_card(card: Card, cloth: str, view: CellView, drape: UInt8[ndarray, "h w 4"], unseen: ndarray | None) -> Card:
    """Adds pictures and graphs to a card.

    Args:
        card: With its numbers.
        cloth: Name of the cloth.
        view: The cell.
        drape: Its drape in 3D.
        unseen: Radii of unseen samples (samples, angles) [m], None where they are not at hand.
    """
    fitted = "simulated" if view.simulated else "predicted, without simulation"
    overlap = 1 - np.abs(view.fit - view.target).sum() / np.maximum(view.fit, view.target).sum()
    where = f"{card.solver} on {cloth}"
    from_side = "Simulated drape" if view.simulated else "Surface over the silhouette, not simulated"
    pictures = [
        _picture(silhouette_picture(view.target), f"Real silhouette of {cloth}", "Real, training sample"),
        _picture(silhouette_picture(view.fit), f"Silhouette of {where}", fitted.capitalize()),
        _picture(
            difference_picture(view.fit, view.target),
            f"Difference of the silhouettes of {where}; they share {100 * overlap:.0f} per cent of their area",
            _DIFFERENCE_KEY,
        ),
        _picture(drape, f"{from_side} of {where}, seen from the side", from_side, wide=True),
    ]
    real, fit = view.target_profile, view.fit_profile
    description = (
        f"Radius over angle on {cloth}: the real drape has {fold_count(real)} folds and a mean radius of "
        f"{1e3 * real.radii.mean():.0f} mm, {card.solver} {fold_count(fit)} and {1e3 * fit.radii.mean():.0f} mm"
    )
    trace = trace_graph(view.trace, f"Best training loss of {where} against cost") if view.simulated else Markup("")
    draws = None
    if len(view.draws):
        text = f"The first {len(view.draws)} of its draws for unseen samples"
        draws = _picture(contact_sheet(view.draws), f"{text}, {where}", text)
    return replace(
        card,
        pictures=pictures,
        profile=profile_graph(real.radii, fit.radii, unseen, description),
        trace=trace,
        fitted=fitted,
        band=0 if unseen is None else len(unseen),
        draws=draws,
    )


def numbers(cell: pd.Series) -> list[Number]:
    """The numbers of a card, from a row of the table of cells."""

    def value(name: str) -> float:
        number = cell.get(name, nan)
        return float(number) if isinstance(number, int | float) else nan

    def against(name: str, digits: int, scale: float = 1.0) -> str:
        target = scale * value(f"{name}_target")
        return f"real {target:.{digits}f}" if isfinite(target) else ""

    draws = value("draws")
    best = f"best of {draws:.0f}: {short(value('test_mse_best'))}" if draws > 1 else ""
    floor = f"floor {short(value('floor_mse'))}" if isfinite(value("floor_mse")) else ""
    listed = [
        Number("MSE, training sample", short(value("train_mse")), floor),
        Number("MSE, unseen samples", short(value("test_mse")), best),
        Number("Hausdorff, training", _millimetres(value("train_hausdorff_m"))),
        Number("Hausdorff, unseen", _millimetres(value("test_hausdorff_m"))),
        Number("drape coefficient", short(100 * value("train_dc"), 1) + " %", against("train_dc", 1, 100.0)),
        Number("folds", short(value("train_folds"), 0), against("train_folds", 0)),
    ]
    if value("spent_forward_equivalents") > 0:
        listed.append(Number("cost", f"{value('spent_forward_equivalents'):,.0f} drapes"))
    if isfinite(value("spent_wall_seconds")):
        listed.append(Number("time", f"{value('spent_wall_seconds'):,.0f} s"))
    return [number for number in listed if number.value.strip(" %")]


def real_drape(cloth: str, target: Float[ndarray, "256 256"], profile: Profile) -> tuple[str, Picture]:
    """A sentence on the real training sample, and its ruled surface in 3D."""
    surface = shown_surface(profile)
    picture = drape_picture(np.asarray(surface.vertices), np.asarray(surface.faces), cloth)
    text = (
        f"Real training sample: drape coefficient {100 * drape_coefficient(target):.1f} %, mean radius "
        f"{1e3 * profile.radii.mean():.0f} mm. The surface is built from the silhouette with straight generators, "
        "as the release builds its meshes: an assumption, not a scan."
    )
    alt, caption = f"Surface over the real silhouette of {cloth}", "Real silhouette as a ruled surface"
    return text, _picture(picture, alt, caption, wide=True)


def _millimetres(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if isfinite(metres) else ""


def _picture(pixels: ndarray, alt: str, caption: str | Markup, *, wide: bool = False) -> Picture:
    encoded = base64.b64encode(png(pixels)).decode()
    return Picture(f"data:image/png;base64,{encoded}", alt, caption, wide)
