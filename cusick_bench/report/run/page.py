"""One self-contained HTML page of a results folder: leaderboard, and for every solver and cloth what was fitted."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.files.plain_names import plain_names
from cusick_bench.leaderboard import (
    Cells,
    Leaderboard,
    html_table,
    stiffness_rows,
    stiffness_table,
    text_table,
    variants,
)
from cusick_bench.leaderboard.cells.commands import command_record, typed
from cusick_bench.leaderboard.cells.variants import law_of, method_label, of_boards
from cusick_bench.leaderboard.text import TextTable
from cusick_bench.metrics.found_stiffness import FoundStiffness
from cusick_bench.report.cell_view import CellView, load_cell_view
from cusick_bench.report.drawing.pictures import drape_picture
from cusick_bench.report.drawing.stiffness_graph import StiffnessLine
from cusick_bench.report.errors import ReportError
from cusick_bench.report.page_template import render_page, write_html
from cusick_bench.report.run.comparison import comparison_section
from cusick_bench.report.run.content import (
    BoardTable,
    Card,
    ClothSection,
    RunPage,
    fill_card,
    numbers,
    real_drape,
    stiffness_picture,
)
from cusick_bench.report.run.drape_models import DrapeModel, fitted_model, models_document, real_model
from cusick_bench.report.run.figure import save_figure
from cusick_bench.report.run.method_curves import method_curves
from cusick_bench.runner.environment import code_text, hardware_text

TITLE = "Cusick drape report"
_OTHER_SAMPLES = "Some of the fits below are to other samples, as their own pictures show."
_MOST_LINKS = 24  # of a card to its solver on other cloths; links of all to all would be most of a page of hundreds
_SAME = 1 / 255  # from which difference of a pixel on silhouettes are of two pictures
_SCRIPTS = ("leaderboard_table.js", "tabs.js", "drape_scene.js", "drape_viewer.js")

Unseen = Mapping[tuple[str, str, tuple[int, ...]], Float[ndarray, "samples angles"]]
"""Radii of unseen samples [m], by the hash of their data, their cloth and their rows in the index, as `Cells.table` has
them."""
Links = Mapping[tuple[str, str], str]
"""Addresses of cards on the page, by cloth and solver; the first card of a solver by cloth "" too."""
Progress = Callable[[str], None]


def write_report(
    cells: Cells,
    boards: list[Leaderboard],
    out: Path,
    *,
    unseen: Unseen | None = None,
    protocol: Protocol = RELEASE,
    pictures: Path | None = None,
    compared: Cells | None = None,
    seed: int = 0,
    progress: Progress = lambda message: None,
) -> list[Path]:
    """Writes the page, and on demand its pictures as files.

    Args:
        cells: Cells of the results folder.
        boards: Its leaderboards.
        out: HTML file to write.
        unseen: Radii of the unseen samples of each split; without it the graphs have no band.
        protocol: How the run's silhouettes were taken.
        pictures: Folder for one side-by-side PNG a cell.
        compared: Another run, to compare this one with.
        seed: Seed of the resamples of that comparison.
        progress: Called with the name of each cell that is drawn.

    Returns:
        The files written.

    Raises:
        LeaderboardError: The other run cannot be compared with this one.
    """
    comparison = None if compared is None else comparison_section(cells, compared, seed=seed)
    paths: dict[str, Path] = {}
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        names = plain_names(_picture_titles(cells.table), trimmed=True)
        paths = {title: pictures / f"{name}.png" for title, name in names.items()}
    files: list[Path] = []
    sections, models = [], []
    for number, cloth in enumerate(sorted(set(cells.table["cloth"]))):
        drawn = _section(cells, boards, cloth, number, unseen or {}, protocol, paths, progress)
        sections.append(drawn.section)
        models += drawn.models
        files += drawn.files
    sections = _linked(sections)
    links = _links(sections)
    page = RunPage(
        title=TITLE,
        summary=_summary(cells, len(sections)),
        facts=_facts(cells, boards),
        boards=[_board(board, links) for board in boards],
        cloths=sections,
        stiffness=_stiffness_table(cells, links),
        curves=[found for board in boards if (found := method_curves(cells, board))],
        drapes=models_document(models, protocol.plate_radius_m),
        comparison=comparison,
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    text = render_page("run.html.j2", scripts=_SCRIPTS, page=page)
    write_html(out, text)
    return [out, *files]


def _links(sections: Sequence[ClothSection]) -> Links:
    cards = [(section.name, card) for section in reversed(sections) for card in section.cards]
    return {(name, card.solver): f"#{card.anchor}" for cloth, card in cards for name in ("", cloth)}


def _board(board: Leaderboard, links: Links) -> BoardTable:
    table = text_table(board)
    own = {
        (cloth, label.removesuffix(board.apart)): link
        for (cloth, label), link in links.items()
        if label.endswith(board.apart)
    }
    return replace(_board_table(table, board.notes, own), kinds=list(dict.fromkeys(table.kinds)))


def _board_table(table: TextTable, notes: Sequence[str], links: Links) -> BoardTable:
    legend = [(f"{column.head} {column.unit}".strip(), column.meaning) for column in table.columns]
    return BoardTable(Markup(html_table(table, links)), notes, legend)


def _stiffness_table(cells: Cells, links: Links) -> BoardTable | None:
    if not (rows := stiffness_rows(cells)):
        return None
    table = stiffness_table(rows)
    return _board_table(table, table.notes, links)


def _linked(sections: Sequence[ClothSection]) -> list[ClothSection]:
    """The sections with links from card to card of one solver, of many to the cloths before and after."""
    of_solver: dict[str, list[tuple[str, str]]] = {}
    places: dict[str, int] = {}
    for section in sections:
        for card in section.cards:
            own = of_solver.setdefault(card.solver, [])
            places[card.anchor] = len(own)
            own.append((section.name, card.anchor))

    def linked(card: Card) -> Card:
        own = of_solver[card.solver]
        first = max(0, min(places[card.anchor] - _MOST_LINKS // 2, len(own) - _MOST_LINKS - 1))
        near = own[first : first + _MOST_LINKS + 1]
        return replace(card, others=tuple(other for other in near if other[1] != card.anchor))

    return [replace(section, cards=[linked(card) for card in section.cards]) for section in sections]


@dataclass(frozen=True)
class _Drawn:
    """A cloth's part of the page, its drapes to be turned, and the pictures written to the folder."""

    section: ClothSection
    models: list[DrapeModel]
    files: list[Path]


def _section(
    cells: Cells,
    boards: list[Leaderboard],
    cloth: str,
    number: int,
    unseen: Unseen,
    protocol: Protocol,
    pictures: Mapping[str, Path],
    progress: Progress,
) -> _Drawn:
    section, files = ClothSection(cloth, f"cloth-{number}", []), []
    models: list[DrapeModel] = []
    trained: dict[str, CellView] = {}
    lines: list[StiffnessLine] = []
    for label, group in _in_order(cells.table, boards):
        of_cloth = group.loc[group["cloth"] == cloth].sort_values(by=["seed", "repeat"])
        if of_cloth.empty:
            continue
        cell = of_cloth.iloc[0]
        progress(f"{label} on {cloth}")
        anchor = f"fit-{number}-{len(section.cards)}"
        card = Card(label, str(cell["kind"]), _seeds(of_cloth), numbers(cell), anchor=anchor)
        try:
            view = load_cell_view(Path(cell["folder"]), protocol, law_of(cell))
        except ReportError as error:
            section.cards.append(replace(card, problem=str(error)))
            continue
        if section.real is None:
            text, real = real_drape(cloth, view)
            section = replace(section, text=text, real=real)
        if not any(_is_same(view.target, one.target) for one in trained.values()):
            trained[label] = view
        if (model := fitted_model(cloth, label, anchor, view)) is not None:
            models.append(model)
            card = replace(card, turnable=True)
        drape = drape_picture(view.vertices, view.faces, cloth, protocol=protocol)
        of_split = unseen.get((cell["dataset_hash"], cloth, cell["test"]))
        section.cards.append(fill_card(card, cloth, view, drape, of_split))
        if isinstance(found := cell.get("stiffness"), FoundStiffness):
            lines.append(StiffnessLine(label, found, view.bending_draws))
        title = _picture_title(cloth, label)
        if title in pictures:
            files.append(pictures[title])
            save_figure(files[-1], title, view, drape, of_split)
    if lines:
        truth = any(line.found.true_bending for line in lines)
        section = replace(section, stiffness=stiffness_picture(cloth, lines), truth=truth)
    if len(trained) > 1:
        section = replace(section, text=f"{section.text} {_OTHER_SAMPLES}")
    return _Drawn(section, [*models, *_real_models(cloth, trained)] if models else [], files)


def _is_same(one: ndarray, other: ndarray) -> bool:
    """Whether two silhouettes are those of one picture."""
    return one.shape == other.shape and float(np.abs(one - other).max()) < _SAME


def _real_models(cloth: str, trained: Mapping[str, CellView]) -> list[DrapeModel]:
    """The training samples of a cloth, by the first solver that was fitted to each."""
    models = {label: real_model(cloth, view) for label, view in trained.items()}
    if len(models) == 1:
        return list(models.values())
    return [replace(model, method=f"{model.method} of {label}") for label, model in models.items()]


def _in_order(table: pd.DataFrame, boards: list[Leaderboard]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Solvers by kind, simulated ones first, and within a kind as they are ranked; those of each board by itself."""
    place = {row.label: i for i, row in enumerate(row for board in boards for row in board.rows)}
    kinds = {"solver": 0, "null": 1, "oracle": 2}
    groups = [(method_label(*name), apart, group) for apart, own in of_boards(table) for name, group in variants(own)]

    def key(item: tuple[str, str, pd.DataFrame]) -> tuple[int, int, str, str]:
        label, apart, group = item
        return kinds.get(str(group["kind"].iloc[0]), 3), place.get(label, len(place)), label, apart

    for label, apart, group in sorted(groups, key=key):
        yield label + apart, group


def _picture_title(cloth: str, label: str) -> str:
    return f"{cloth}: {label}"


def _picture_titles(table: pd.DataFrame) -> list[str]:
    """Titles of all pictures of a run, in an order that is the same whichever of them are drawn."""
    groups = _in_order(table, [])
    return sorted({_picture_title(cloth, label) for label, group in groups for cloth in set(group["cloth"])})


def _seeds(group: pd.DataFrame) -> str:
    count, splits = len(group), len(set(group["test"]))
    if splits > 1:
        return f"seed {group['seed'].iloc[0]} and one of {splits} splits shown, of {count} cells"
    return "" if count == 1 else f"seed {group['seed'].iloc[0]} shown, of {count}"


def _summary(cells: Cells, cloths: int) -> str:
    rows = {method_label(*name) for _, own in of_boards(cells.table) for name, _ in variants(own)}
    solvers, count = len(rows), len(cells.table)
    return (
        f"{solvers} method{'s' * (solvers != 1)} on {cloths} cloth{'s' * (cloths != 1)}, {count} finished "
        f"cell{'s' * (count != 1)}. A solver sees the training silhouettes of a cloth (one, but for runs whose samples "
        "are left out in turn), fits the stiffness to them, and is scored on silhouettes of other samples of the cloth."
    )


def _facts(cells: Cells, boards: list[Leaderboard]) -> list[tuple[str, str]]:
    run = command_record(cells.run, (folder.name for folder in cells.table["folder"]))
    states = dict.fromkeys(f"{board.dataset} (sha256 {board.dataset_hash[:12]})" for board in boards)
    found = [
        ("Data", "; ".join(states)),
        ("Command", typed(run.get("command", ""))),
        ("Code", code_text(run)),
        ("Hardware", hardware_text(run)),
        ("Date", str(run.get("time", ""))),
    ]
    return [(name, value) for name, value in found if value]
