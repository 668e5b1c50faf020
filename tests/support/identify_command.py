"""`cusick-bench identify` with the smallest of fits."""

import re

from typer.testing import CliRunner

from cusick_bench.cli import app

SOLVER = "bdp-field,draws=2,first=4,rounds=1,cloths=2,refinement=0"
CHEAP = ["--vertices", "97", "--steps", "10", "--budget", "30", "--samples", "0", "--solver", SOLVER]


def identify(*words: object):
    return CliRunner().invoke(app, ["identify", *map(str, words)])


def said(result) -> str:
    return " ".join(re.sub(r"\x1b\[[0-9;]*m", "", result.output).split())
