"""Reports: one self-contained HTML page of a results folder, with pictures."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.report.drawing.drape_view import View, cloth_colour, render_drape
    from cusick_bench.report.errors import ReportError
    from cusick_bench.report.run.page import write_report

__all__ = [
    "ReportError",
    "View",
    "cloth_colour",
    "render_drape",
    "write_report",
]

__getattr__ = lazy_names(
    __name__,
    {
        "ReportError": "errors",
        "View": "drawing.drape_view",
        "cloth_colour": "drawing.drape_view",
        "render_drape": "drawing.drape_view",
        "write_report": "run.page",
    },
)
