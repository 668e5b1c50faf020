"""Finished fits of a calibration, kept a line each, and the table that is made of them.

OUT/fits.jsonl         a line a fit, whole or absent: a command that was stopped goes on where it was
OUT/calibration.csv    a line a direction
OUT/calibration.md     the same to read
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import TypeAdapter

from cusick_bench.benchmark.posterior_calibration.calibration import (
    BINS,
    CalibrationError,
    CalibrationFit,
    CalibrationPlan,
    plan_numerics,
)
from cusick_bench.files import parse_json, read_text
from cusick_bench.files.csv_text import csv_text
from cusick_bench.runner.environment import code_text, environment
from cusick_bench.runner.store import append_line, write_atomically

_MOST_BYTES = 64 << 20
_FIT = TypeAdapter(CalibrationFit)
_REMEDY = "delete it, or choose another --out"


@dataclass(frozen=True)
class FitFile:
    """File of finished fits.

    Attributes:
        out: Folder.
    """

    out: Path

    @property
    def path(self) -> Path:
        """The file with a line a fit."""
        return self.out / "fits.jsonl"

    def read(self, plan: CalibrationPlan) -> dict[int, CalibrationFit]:
        """Fits that a plan asks for and this code made; a last line that a crash cut off is left out.

        Args:
            plan: The plan.

        Returns:
            By number.

        Raises:
            CalibrationError: The file holds something else.
        """
        if not self.path.exists():
            return {}
        *lines, _ = read_text(self.path, most_bytes=_MOST_BYTES, remedy=_REMEDY).split("\n")
        found = [self._read_line(line, number) for number, line in enumerate(lines, start=1)]
        numerics = plan_numerics(plan)
        return {one.number: one for one in found if one.numerics == numerics and one.number < plan.fits}

    def keep(self, fit: CalibrationFit) -> None:
        """Adds a finished fit.

        Args:
            fit: The fit.
        """
        append_line(self.path, json.dumps(asdict(fit)))

    def write_table(
        self, rows: Sequence[dict[str, Any]], plans: Sequence[CalibrationPlan], command: str = ""
    ) -> list[Path]:
        """Writes the table as CSV and as Markdown.

        Args:
            rows: From `calibration_table`, each with its `solver`.
            plans: What was fitted.
            command: Command that made it, as it can be typed again; "" where there is none.

        Returns:
            Paths of the two files.
        """
        csv, text = self.out / "calibration.csv", self.out / "calibration.md"
        flat = [{**row, "ranks": " ".join(map(str, row["ranks"]))} for row in rows]
        write_atomically(csv, csv_text(pd.DataFrame(flat)).encode())
        write_atomically(text, markdown_page(rows, plans, command).encode())
        return [csv, text]

    def _read_line(self, line: str, number: int) -> CalibrationFit:
        try:
            parse_json(line, self.path, remedy=_REMEDY)
            return _FIT.validate_json(line)
        except (ValueError, TypeError) as error:
            raise CalibrationError(f"{self.path}, line {number} is no finished fit ({error}); {_REMEDY}") from error


def markdown_page(rows: Sequence[dict[str, Any]], plans: Sequence[CalibrationPlan], command: str = "") -> str:
    """The table to read.

    Args:
        rows: From `calibration_table`, each with its `solver`.
        plans: What was fitted.
        command: Command that made it, as it can be typed again; "" where there is none.

    Returns:
        Text.
    """
    lines = [
        "| solver | bending | fits | 50 % interval holds | 90 % interval holds | ranks, tenth by tenth | "
        "p of uniform ranks | found / true | error ×/÷ |",
        "| :--- | :--- | ---: | :--- | :--- | :--- | ---: | ---: | ---: |",
    ]
    for row in rows:
        shares = [
            f"{row[name]:.0%} [{row[f'{name}_low']:.0%}, {row[f'{name}_high']:.0%}]"
            for name in ("cover_50", "cover_90")
        ]
        cells = [row["solver"], row["direction"], row["fits"], *shares, " ".join(map(str, row["ranks"]))]
        cells += [f"{row['p_uniform']:.2g}", f"{row['bias']:.2f}", f"{row['error']:.2f}"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    made = environment()
    made_by = f"Command: `{command}`. " if command else ""
    return (
        "\n\n".join(
            [
                "# Calibration of posteriors of stiffness",
                "Cloths are drawn from the prior that a solver assumes and draped, and it sees the silhouettes. Where "
                "its posterior is right, 90 % of its 90 % intervals hold the true bending stiffness, and the truth's "
                f"rank among draws is uniform over the {BINS} bins.",
                "\n".join(lines),
                f"{made_by}{'. '.join(map(plan_numerics, plans))}. Hardware: {made['processor']}, {made['cores']} "
                f"cores. Code: {code_text(made)}.",
            ]
        )
        + "\n"
    )
