"""Reports: one self-contained HTML page of a results folder, with pictures."""

from cusick_bench.report.drawing.drape_view import View, cloth_colour, render_drape
from cusick_bench.report.errors import ReportError
from cusick_bench.report.run.page import write_report

__all__ = ["ReportError", "View", "cloth_colour", "render_drape", "write_report"]
