"""Reports: one self-contained HTML page of a results folder, with pictures."""

from cusick_bench.report.errors import ReportError
from cusick_bench.report.page import write_report
from cusick_bench.report.scene import View, cloth_colour, render_drape

__all__ = ["ReportError", "View", "cloth_colour", "render_drape", "write_report"]
