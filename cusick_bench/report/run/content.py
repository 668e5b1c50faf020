"""Content of the page of a results folder, for its template: cloths, cards, numbers, pictures and graphs."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, fold_count_of
from cusick_bench.leaderboard import short, significant
from cusick_bench.metrics.found_stiffness import FoundStiffness
from cusick_bench.metrics.stiffness import GF_CM2_PER_CM
from cusick_bench.report.cell_view import CellView, shown_surface
from cusick_bench.report.drawing.inline_svg import inline_svg
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
from cusick_bench.report.drawing.stiffness_graph import StiffnessLine, stiffness_graph
from cusick_bench.report.run.comparison import ComparisonSection
from cusick_bench.report.run.method_curves import MethodCurves


@dataclass(frozen=True)
class Picture:
    """An embedded picture.

    Attributes:
        source: Its bytes as a data URL.
        alt: Description for readers who cannot see it.
        caption: Words below it.
        width: Width of the picture [px].
        height: Height of the picture [px].
        key: Colours (red, green, blue) and what they mean.
        plate: Left edge, upper edge and diameter of the plate's circle, in widths of the picture; None without it.
    """

    source: str
    alt: str
    caption: str
    width: int
    height: int
    key: tuple[tuple[tuple[int, int, int], str], ...] = ()
    plate: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Number:
    """A number of a card.

    Attributes:
        name: Name of the quantity.
        value: The number with its unit.
        of: A value or unit for comparison.
    """

    name: str
    value: str
    of: str = ""


@dataclass(frozen=True)
class Card:
    """One solver on one cloth.

    Attributes:
        solver: Its label.
        kind: "solver", "null" or "oracle".
        seeds: Which of several seeds is shown, in words.
        numbers: Its results.
        problem: Why there are no pictures.
        pictures: Silhouettes: real, fitted, their difference.
        drape: The fit from the side.
        profile: Graph of radius over angle, None where the cell could not be read.
        trace: Graph of loss over cost, None where nothing was simulated.
        fitted: What the fit is called.
        band: Number of unseen silhouettes behind the band of `profile`; 0 without a band.
        draws: The first draws for unseen samples.
        anchor: Name of the card in links.
        others: The solver on other cloths, of many on those before and after: cloth and anchor.
        turnable: Whether the page has its drape in 3D.
    """

    solver: str
    kind: str
    seeds: str
    numbers: list[Number]
    problem: str = ""
    pictures: tuple[Picture, ...] = ()
    drape: Picture | None = None
    profile: Markup | None = None
    trace: Markup | None = None
    fitted: str = ""
    band: int = 0
    draws: Picture | None = None
    anchor: str = ""
    others: tuple[tuple[str, str], ...] = ()
    turnable: bool = False


@dataclass(frozen=True)
class ClothSection:
    """All solvers on one cloth.

    Attributes:
        name: Name of the cloth.
        anchor: Name of the section in links.
        cards: The solvers.
        real: The real training sample from the side, None where no cell could be read.
        text: A sentence on it.
        stiffness: Graph of the bending stiffness found, None where no solver found one.
        truth: Whether the graph marks the true stiffness.
    """

    name: str
    anchor: str
    cards: list[Card]
    real: Picture | None = None
    text: str = ""
    stiffness: Markup | None = None
    truth: bool = False


@dataclass(frozen=True)
class BoardTable:
    """A leaderboard as the page shows it.

    Attributes:
        table: HTML table.
        notes: Sentences below it.
        legend: Headings of its columns with their meaning.
        kinds: Kinds of rows that a reader may hide.
    """

    table: Markup
    notes: Sequence[str]
    legend: Sequence[tuple[str, str]] = ()
    kinds: Sequence[str] = ()


@dataclass(frozen=True)
class RunPage:
    """The page of a results folder.

    Attributes:
        title: Its title.
        summary: What was run, in a sentence.
        facts: Name and value of what identifies the run.
        boards: The leaderboards.
        cloths: The cells, cloth by cloth.
        stiffness: What stiffness was found, None where no solver found any.
        curves: Figures that compare methods, of each leaderboard that has any.
        drapes: Drapes to be turned, from `models_document`.
        comparison: Comparison with another run, None without one.
    """

    title: str
    summary: str
    facts: list[tuple[str, str]]
    boards: list[BoardTable]
    cloths: list[ClothSection]
    stiffness: BoardTable | None = None
    curves: Sequence[MethodCurves] = ()
    drapes: Mapping[str, Any] = field(default_factory=lambda: {"drapes": []})
    comparison: ComparisonSection | None = None


def fill_card(card: Card, cloth: str, view: CellView, drape: UInt8[ndarray, "h w 4"], unseen: ndarray | None) -> Card:
    """Adds pictures and graphs to a card.

    Args:
        card: With its numbers.
        cloth: Name of the cloth.
        view: The cell.
        drape: Its drape in 3D.
        unseen: Radii of unseen samples (samples, angles) [m], None where they are not at hand.

    Returns:
        The card with them.
    """
    where = f"{card.solver} on {cloth}"
    fitted = "simulated" if view.simulated else "predicted, without simulation"
    from_side = "Simulated drape" if view.simulated else "Surface over the silhouette, not simulated"
    trace = trace_graph(view.trace) if view.simulated else None
    return replace(
        card,
        pictures=_silhouettes(view, cloth, where, fitted),
        drape=embedded_picture(drape, f"{from_side} of {where}, seen from the side", from_side),
        profile=_profile(card.solver, cloth, view, unseen),
        trace=None if trace is None else inline_svg(trace, f"Best training loss of {where} against cost"),
        fitted=fitted,
        band=0 if unseen is None or len(unseen) < 2 else len(unseen),  # one has no range
        draws=_draws(view, where) if len(view.draws) else None,
    )


def _silhouettes(view: CellView, cloth: str, where: str, fitted: str) -> tuple[Picture, ...]:
    model = "simulated" if view.simulated else "predicted"
    overlap = 1 - np.abs(view.fit - view.target).sum() / np.maximum(view.fit, view.target).sum()
    alt = f"Difference of the silhouettes of {where}; they share {100 * overlap:.0f} per cent of their area"
    difference = embedded_picture(difference_picture(view.fit, view.target), alt, "")
    pictures = (
        embedded_picture(silhouette_picture(view.target), f"Real silhouette of {cloth}", "Real, training sample"),
        embedded_picture(silhouette_picture(view.fit), f"Silhouette of {where}", fitted.capitalize()),
        replace(difference, key=((ONLY_SIMULATED, f"only {model}"), (ONLY_REAL, "only real"))),
    )
    return tuple(with_plate(one, view.protocol) for one in pictures)


def _profile(solver: str, cloth: str, view: CellView, unseen: ndarray | None) -> Markup:
    real, fit = view.target_profile, view.fit_profile
    folds = [fold_count_of(profile, view.protocol) for profile in (real, fit)]
    description = (
        f"Radius over angle on {cloth}: the real drape has {folds[0]} folds and a mean radius of "
        f"{1e3 * real.radii.mean():.0f} mm, {solver} {folds[1]} and {1e3 * fit.radii.mean():.0f} mm"
    )
    return inline_svg(profile_graph(real.radii, fit.radii, unseen, view.protocol), description)


def _draws(view: CellView, where: str) -> Picture:
    faces = ", with the training sample's face up and with the other one in turn" if view.both_faces else ""
    text = f"The first {len(view.draws)} of its draws for unseen samples{faces}"
    return embedded_picture(contact_sheet(view.draws), f"{text}, {where}", text)


def numbers(cell: pd.Series) -> list[Number]:
    """The numbers of a card.

    Args:
        cell: A row of the table of cells.

    Returns:
        What is known of the cell.
    """

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
    return [number for number in listed if number.value.strip(" %")] + _stiffness(cell.get("stiffness"))


def _stiffness(found: object) -> list[Number]:
    if not isinstance(found, FoundStiffness):
        return []
    numbers = []
    for direction, one in found.bending.items():
        beside = [f"{significant(one.value / GF_CM2_PER_CM)} gf cm²/cm"]
        if one.ci90 is not None:
            beside.append(f"90 %: {significant(1e6 * one.ci90[0])} to {significant(1e6 * one.ci90[1])}")
        if found.bending_ratio:
            beside.append(f"{significant(found.bending_ratio[direction].value)} times the truth")
        numbers.append(Number(f"bending, {direction}", f"{significant(1e6 * one.value)} µN m", "; ".join(beside)))
    return numbers


def stiffness_picture(cloth: str, lines: Sequence[StiffnessLine]) -> Markup:
    """The graph of the bending stiffness that solvers found of a cloth.

    Args:
        cloth: Name of the cloth.
        lines: What they found; at least one.

    Returns:
        The graph, with its numbers in words.
    """
    said = [(line.label, {name: one.value for name, one in line.found.bending.items()}) for line in lines]
    if true := lines[0].found.true_bending:
        said.append(("true", dict(true)))
    words = [f"{who} " + ", ".join(f"{name} {significant(1e6 * one)}" for name, one in by.items()) for who, by in said]
    description = f"Bending stiffness of {cloth} in micronewton metres: {'; '.join(words)}"
    return inline_svg(stiffness_graph(lines), description, "panels")


def real_drape(cloth: str, view: CellView) -> tuple[str, Picture]:
    """The real training sample of a cloth.

    Args:
        cloth: Name of the cloth.
        view: A cell that was fitted to it.

    Returns:
        A sentence on it, and its ruled surface from the side.
    """
    profile, protocol = view.target_profile, view.protocol
    surface = shown_surface(profile, protocol)
    picture = drape_picture(np.asarray(surface.vertices), np.asarray(surface.faces), cloth, protocol=protocol)
    share = drape_coefficient_of(view.target, protocol)
    text = (
        f"Real training sample: drape coefficient {100 * share:.1f} %, mean radius "
        f"{1e3 * profile.radii.mean():.0f} mm. The surface is built from the silhouette with straight generators, "
        "as the release builds its meshes: an assumption, not a scan."
    )
    alt, caption = f"Surface over the real silhouette of {cloth}", "Real silhouette as a ruled surface"
    return text, embedded_picture(picture, alt, caption)


def _millimetres(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if isfinite(metres) else ""


def embedded_picture(pixels: UInt8[ndarray, "height width 4"], alt: str, caption: str) -> Picture:
    """A picture with its bytes.

    Args:
        pixels: RGBA picture.
        alt: Description for readers who cannot see it.
        caption: Words below it.

    Returns:
        The picture.
    """
    encoded = base64.b64encode(png(pixels)).decode()
    return Picture(f"data:image/png;base64,{encoded}", alt, caption, pixels.shape[1], pixels.shape[0])


def with_plate(picture: Picture, protocol: Protocol) -> Picture:
    """A silhouette's picture with the place of the plate.

    Args:
        picture: The picture, square.
        protocol: Gives scale and radius of the plate, and its axis.

    Returns:
        The picture with it.
    """
    radius = protocol.plate_radius_m * protocol.px_per_m
    left, top = (middle + 0.5 - radius for middle in protocol.centre_px)  # pixel centres are at integers
    return replace(picture, plate=(left / picture.width, top / picture.width, 2 * radius / picture.width))
