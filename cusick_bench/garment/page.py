"""A page of skirts that can be turned in three dimensions, one cloth or draw after the other.

The viewer is that of drapes in a run's report, which draws a plate of the size of the waist; skirts are scaled down to
the size of a drape for it.
"""

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from cusick_bench.garment.measurement import vertex_spread
from cusick_bench.garment.side_by_side import compared, mean_and_deviation
from cusick_bench.garment.wearing import Worn
from cusick_bench.report.page_template import render_page, write_html
from cusick_bench.report.run.drape_models import Colouring, DrapeModel, models_document

_DROP = 0.11  # [m] of the longest skirt in the scene
_SCRIPTS = ("drape_scene.js", "drape_viewer.js")


def write_page(worn: Sequence[Worn], path: Path) -> None:
    """Writes the page.

    Args:
        worn: Skirts of each cloth.
        path: HTML file to write.
    """
    size = worn[0].wearing.size
    scale = _DROP / size.length
    of_cloths = zip_longest(*(_models(one, scale) for one in worn))  # if there is no room for all, some of each cloth
    models = [model for of_draw in of_cloths for model in of_draw if model is not None]
    drapes, order = models_document(models, scale * size.waist), [one.cloth.name for one in worn]
    drapes["drapes"].sort(key=lambda drape: order.index(drape["cloth"]))
    measures = f"radius of the waist {1e3 * size.waist:.0f} mm, length {1e3 * size.length:.0f} mm"
    page: dict[str, Any] = {
        "title": "Skirts of digitised cloths",
        "summary": f"{worn[0].wearing.kind.capitalize()} skirts, {measures}.",
        "rows": [_row(numbers) for numbers in compared(worn)],
        "drapes": drapes,
    }
    write_html(path, render_page("garments.html.j2", scripts=_SCRIPTS, page=page))


def _row(numbers: dict[str, Any]) -> dict[str, str]:
    """Cells of the table."""
    apart = 1e3 * numbers["vertex_sd_m"]
    return {
        "cloth": numbers["cloth"],
        "draws": str(numbers["draws"]),
        "folds": mean_and_deviation(numbers, "folds", 1, 1),
        "hem_radius": mean_and_deviation(numbers, "hem_radius_m", 1e3),
        "drape_coefficient": mean_and_deviation(numbers, "drape_coefficient", 100, 1),
        "apart": f"{apart:.0f}" if np.isfinite(apart) else "",
    }


def _models(worn: Worn, scale: float) -> list[DrapeModel]:
    """Every draw at rest, coloured by how far draws lie apart where there are several."""
    apart = 1e3 * vertex_spread(worn.positions)
    colourings = {}
    if np.isfinite(apart).all():
        most = float(apart.max())
        words = f"Draws of the cloth lie {apart.mean():.0f} mm apart in the mean (standard deviation of a vertex)."
        ends = ("0 mm", f"{most:.0f} mm between draws")
        colourings["spread"] = Colouring("spread between draws", apart, (0.0, most), ends, "amount", words)
    faces = worn.pattern.mesh.faces
    words = [f"{m.folds} folds, hem radius {1e3 * m.hem_radius_m:.0f} mm." for m in worn.measures]
    return [
        DrapeModel(worn.cloth.name, f"{number}", "", scale * x, faces, words[number], colourings)
        for number, x in enumerate(worn.positions)
    ]
