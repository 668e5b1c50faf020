"""`cusick-bench run`: its document, its exit status, and wrong usage."""

import json
from pathlib import Path

import pytest
from small_grid import small_run_arguments
from typer.testing import CliRunner

from cusick_bench.cli import app

pytestmark = pytest.mark.usefixtures("one_thread")


def test_run_prints_one_document(data, tmp_path):
    result = CliRunner().invoke(app, [*small_run_arguments(data, tmp_path, "homo", "null:copy"), "--json"])
    assert result.exit_code == 0, result.output
    cells = json.loads(result.stdout)["cells"]
    assert [cell["solver"] for cell in cells] == ["homo", "null:copy"]
    for cell in cells:
        assert cell["status"] == "done"
        assert Path(cell["path"], "done").exists()
        assert {"cloth", "seed", "train_mse", "test_mse", "hausdorff_m", "seconds"} <= cell.keys()
    assert 0 < cells[0]["forward_equivalents"] <= 8
    assert cells[1]["train_mse"] == pytest.approx(0, abs=1e-12)


def test_failed_cell_is_exit_status_1(data, tmp_path):
    result = CliRunner().invoke(app, small_run_arguments(data, tmp_path, "oracle:repeat"))
    assert result.exit_code == 1


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--solver", "hobo"], "unknown solver"),
        (["--budget", "0"], "greater than or equal to 1"),
        (["--shard", "5/4"], "i/n"),
        (["--executor", "cloud"], "unknown executor"),
        (["--law", "hooke"], "law"),
        (["--data", "/nowhere"], "/nowhere"),
        (["--cloth", "silk"], "unknown cloth"),
    ],
)
def test_bad_usage_is_exit_status_2(data, tmp_path, extra, message):
    result = CliRunner().invoke(app, [*small_run_arguments(data, tmp_path, "homo"), *extra])
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert not list(tmp_path.glob("cells/*/trace.jsonl"))


def test_solvers_are_listed():
    result = CliRunner().invoke(app, ["solvers", "--json"])
    rows = {row["name"]: row for row in json.loads(result.stdout)["solvers"]}
    assert rows["homo"]["needs_gradient"]
    assert rows["null:random-phase"]["options"] == {"draws": 1000}
    assert {"nlopt:LD_LBFGS", "nlopt:LN_BOBYQA", "oracle:mean"} <= rows.keys()
