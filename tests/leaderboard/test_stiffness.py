"""The stiffness that solvers found, summed up over seeds and cloths and held against the truth."""

import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard import (
    cell_records,
    cell_table,
    html_table,
    load_cells,
    markdown,
    significant,
    stiffness_csv,
    stiffness_records,
    stiffness_rows,
    stiffness_table,
)
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantity, stiffness_document
from cusick_bench.metrics.stiffness import BENDING, STRETCH

TRUE = 2e-6  # [N m], of each direction


def found(factor: float, width: float | None = None, *, known: bool = True) -> FoundStiffness:
    """Bending stiffness of `factor` times the truth, with an interval of a factor `width` about it."""

    def quantity(true: float) -> Quantity:
        value = factor * true
        return Quantity(value, None if width is None else (value / width, value * width))

    return FoundStiffness(
        dict.fromkeys(BENDING, quantity(TRUE)),
        dict.fromkeys(STRETCH, quantity(100.0)),
        dict.fromkeys(BENDING, (TRUE,) * 5),
        dict.fromkeys(BENDING, 0.0),
        dict.fromkeys(BENDING, TRUE) if known else None,
        dict.fromkeys(STRETCH, 100.0) if known else None,
    )


def write_cell(run: Path, solver: str, cloth: str, seed: int, one: FoundStiffness | None, *, old: bool = False) -> Path:
    folder = run / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    folder.mkdir(parents=True)
    record = {"solver": solver, "kind": "null" if ":" in solver else "solver", "cloth": cloth, "seed": seed}
    record |= {"dataset": "lab", "dataset_hash": "abc", "protocol": "paper", "settings": {}, "status": "done"}
    record |= {"metrics": {"train_mse": 0.01, "test_mse": 0.05}, "spent": {}}
    (folder / "result.json").write_text(json.dumps(record | ({} if old else stiffness_document(one))))
    (folder / "done").touch()
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """`bdp` has posteriors, too narrow on one of two cloths; `homo` four seeds; one solver has no physics."""
    write_cell(tmp_path, "bdp", "blue", 0, found(1.5, 2.0))
    write_cell(tmp_path, "bdp", "red", 0, found(0.5, 1.5))
    for seed, factor in enumerate((0.8, 1.0, 1.25, 1.0)):
        write_cell(tmp_path, "homo", "blue", seed, found(factor))
    write_cell(tmp_path, "null:disc", "blue", 0, None)
    return tmp_path


def test_what_was_found_before_and_after_the_data_changed_stands_apart(tmp_path):
    """A weight that was corrected: two lines of one name had other numbers, and nothing told which was which."""
    for state, factor in (("a" * 64, 2.0), ("b" * 64, 3.0)):
        cell = write_cell(tmp_path, "homo", "blue", 0, found(factor))
        result = json.loads((cell / "result.json").read_text())
        (cell / "result.json").write_text(json.dumps(result | {"dataset_hash": state}))
        cell.rename(cell.with_name(f"{cell.name}-{state}"))
    errors = {row.solver: row.error_factor for row in stiffness_rows(load_cells(tmp_path))}
    assert errors == pytest.approx({f"homo, data {'a' * 12}": 2.0, f"homo, data {'b' * 12}": 3.0})


def test_what_was_found_from_two_splits_stands_apart(tmp_path):
    for split, factor in (("paper", 2.0), ("all", 3.0)):
        cell = write_cell(tmp_path, "homo", "blue", 0, found(factor))
        result = json.loads((cell / "result.json").read_text())
        (cell / "result.json").write_text(json.dumps(result | {"protocol": split}))
        cell.rename(cell.with_name(f"{cell.name}-{split}"))
    rows = stiffness_rows(load_cells(tmp_path))
    errors = {row.solver: row.error_factor for row in rows}
    assert errors == pytest.approx({"homo, split all": 3.0, "homo, split paper": 2.0})


def test_cells_of_samples_left_out_in_turn_have_numbers_of_their_own_that_a_file_can_hold(tmp_path):
    for sample in range(3):
        for seed in (0, 7):
            cell = write_cell(tmp_path, "homo", "blue", 10 * sample + seed, None)
            result = json.loads((cell / "result.json").read_text()) | {"seed": seed, "test": [sample]}
            (cell / "result.json").write_text(json.dumps(result))
    assert sorted(cell_table(load_cells(tmp_path))["repeat"]) == [0, 7, 8, 15, 16, 23]


def by_name(rows) -> dict:
    return {(row.solver, row.cloth): row for row in rows}


def test_error_factor_and_coverage_are_those_of_the_cells(run):
    rows = by_name(stiffness_rows(load_cells(run)))
    assert rows["bdp", "blue"].error_factor == pytest.approx(1.5)
    assert rows["bdp", "red"].error_factor == pytest.approx(2.0)
    assert rows["bdp", ""].error_factor == pytest.approx(math.sqrt(1.5 * 2.0))
    assert rows["bdp", "blue"].coverage == 1
    assert rows["bdp", "red"].coverage == 0
    assert rows["bdp", ""].coverage == 0.5
    assert rows["bdp", "blue"].interval_factor == pytest.approx(2.0)
    assert rows["homo", "blue"].error_factor == pytest.approx(1.25**0.5)
    assert math.isnan(rows["homo", "blue"].coverage)
    assert rows["bdp", "red"].stretch_error_factor == pytest.approx(2.0)


def test_values_are_geometric_means_with_intervals_over_seeds(run):
    rows = by_name(stiffness_rows(load_cells(run)))
    one = rows["homo", "blue"].bending["warp"]
    assert one.value == pytest.approx(TRUE)
    assert 0.6 * TRUE <= one.low < 0.8 * TRUE < 1.25 * TRUE < one.high <= TRUE / 0.6
    assert math.isnan(rows["bdp", "blue"].bending["warp"].low)  # of a single seed
    assert stiffness_rows(load_cells(run))[0] == stiffness_rows(load_cells(run))[0]


def test_an_interval_of_stretch_may_reach_below_one_newton_per_metre(tmp_path):
    for seed, factor in enumerate((0.015, 0.2, 1.0)):
        write_cell(tmp_path, "homo", "blue", seed, found(factor))
    (row,) = stiffness_rows(load_cells(tmp_path))
    stretch, bending = row.stretch["warp"], row.bending["warp"]
    assert stretch.low < 0.5
    assert stretch.low / stretch.value == pytest.approx(bending.low / bending.value)


def test_a_solver_without_physics_has_a_row_without_numbers(run):
    rows = stiffness_rows(load_cells(run))
    assert by_name(rows)["null:disc", ""].bending == {}
    table = stiffness_table(rows)
    (line,) = [entries for entries in table.entries if "null:disc" in entries]
    assert set(line[3:]) <= {"-", ""}
    assert not any(entry.startswith("0") for entry in line[3:])


def test_table_names_both_units(run):
    table = stiffness_table(stiffness_rows(load_cells(run)))
    assert {"µN m", "gf cm²/cm", "N/m"} <= {column.unit for column in table.columns}
    for text in (markdown(table), html_table(table)):
        assert "3.00" in text  # 1.5 x 2 uN m
        assert significant(3.0 / 98.0665) in text


def test_results_of_before_are_read_and_have_no_stiffness(tmp_path):
    write_cell(tmp_path, "homo", "blue", 0, None, old=True)
    cells = load_cells(tmp_path)
    assert len(cells.table) == 1
    assert stiffness_rows(cells) == []
    assert cell_records(cells) == []
    assert stiffness_csv(cells).count("\n") == 1


def test_a_damaged_stiffness_is_a_damaged_cell(run):
    path = write_cell(run, "heter", "blue", 0, found(1.0)) / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"stiffness": {"warp": "soft"}}))
    (skipped,) = load_cells(run).skipped
    assert skipped.status == "damaged"
    assert "stiffness.warp" in skipped.reason


def test_truth_that_is_not_known_is_left_out(tmp_path):
    write_cell(tmp_path, "bdp", "blue", 0, found(1.5, 2.0, known=False))
    (row,) = stiffness_rows(load_cells(tmp_path))
    assert math.isnan(row.error_factor)
    assert math.isnan(row.coverage)
    assert "error" not in {column.head for column in stiffness_table([row]).columns}
    assert cell_records(load_cells(tmp_path))[0]["ci90_low"] == pytest.approx(1.5e-6)


def test_csv_has_a_line_for_each_cell_quantity_and_direction(run):
    lines = list(csv.DictReader(io.StringIO(stiffness_csv(load_cells(run)))))
    assert len(lines) == 6 * (3 + 3)
    (warp,) = [
        line for line in lines
        if (line["solver"], line["cloth"], line["quantity"], line["direction"]) == ("bdp", "red", "bending", "warp")
    ]  # fmt: skip
    numbers = {name: float(warp[name]) for name in ("value", "value_gf_cm2_cm", "true", "ratio", "ratio_ci90_high")}
    assert numbers == pytest.approx(
        {"value": 1e-6, "value_gf_cm2_cm": 1e-6 / 9.80665e-5, "true": TRUE, "ratio": 0.5, "ratio_ci90_high": 0.75}
    )


def test_each_direction_has_numbers_of_its_own(tmp_path):
    """In tables and records of rows and cells; what other tests write is alike in all directions."""
    value = {"warp": 4e-6, "weft": 1e-6, "bias": 2e-6, "stretch warp": 300.0, "stretch weft": 200.0, "shear": 50.0}
    ratio = {"warp": 2.0, "weft": 1.25, "bias": 0.5, "stretch warp": 3.0, "stretch weft": 1.6, "shear": 2.5}
    names = {"bending": dict(zip(BENDING, BENDING, strict=True))}
    names["stretch"] = {"warp": "stretch warp", "weft": "stretch weft", "shear": "shear"}
    bending, stretch = (
        {one: Quantity(value[name], (value[name] / 2, 3 * value[name])) for one, name in of.items()}
        for of in names.values()
    )
    true_bending, true_stretch = ({one: value[name] / ratio[name] for one, name in of.items()} for of in names.values())
    curve, spread = dict.fromkeys(BENDING, (TRUE,) * 5), {"warp": 0.1, "weft": 0.2, "bias": 0.3}
    write_cell(tmp_path, "bdp", "blue", 0, FoundStiffness(bending, stretch, curve, spread, true_bending, true_stretch))
    cells = load_cells(tmp_path)
    (row,) = stiffness_rows(cells)
    (record,), table = stiffness_records([row]), stiffness_table([row])
    entries = {(column.head, column.unit): entry for column, entry in zip(table.columns, *table.entries, strict=True)}
    for quantity, unit, shown in (("bending", "N_m", "µN m"), ("stretch", "N_per_m", "N/m")):
        for one, name in names[quantity].items():
            column = f"{quantity}_{one}_{unit}"
            assert record[column] == pytest.approx(value[name]), column
            assert record[f"{column}_true"] == pytest.approx(value[name] / ratio[name]), column
            assert entries[one, shown] == significant(value[name] * (1e6 if quantity == "bending" else 1)), column
    for one in BENDING:
        assert record[f"bending_{one}_gf_cm2_cm"] == pytest.approx(value[one] / 9.80665e-5), one
        assert entries[one, "gf cm²/cm"] == significant(value[one] / 9.80665e-5), one
    lines = {(line["quantity"], line["direction"]): line for line in cell_records(cells)}
    assert list(lines) == [(quantity, one) for quantity, of in names.items() for one in of]
    for (quantity, one), line in lines.items():
        name = names[quantity][one]
        numbers = [line[key] for key in ("value", "ci90_low", "ci90_high", "ratio", "ratio_ci90_low", "true")]
        factors = np.array([1, 0.5, 3, *(ratio[name] / value[name] * np.array([1, 0.5])), 1 / ratio[name]])
        assert numbers == pytest.approx(value[name] * factors), (quantity, one)
        assert line.get("spread_log") == spread.get(one if quantity == "bending" else ""), (quantity, one)


def test_command_prints_and_writes_it(run, tmp_path):
    files = [tmp_path / f"found{suffix}" for suffix in (".csv", ".md", ".tex", ".html")]
    words = ["leaderboard", str(run), "--json", *(word for path in files for word in ("--stiffness", str(path)))]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    rows = {(row["solver"], row["cloth"]): row for row in document["stiffness"]}
    assert rows["bdp", "red"]["bending_warp_N_m"] == pytest.approx(1e-6)
    assert rows["bdp", "red"]["error_factor"] == pytest.approx(2.0)
    assert all(path.stat().st_size for path in files)
    table = CliRunner().invoke(app, ["leaderboard", str(run)])
    assert "stiffness found" in table.stdout
    assert CliRunner().invoke(app, ["leaderboard", str(run), "--stiffness", "a.txt"]).exit_code == 2


def test_records_are_numbers_that_json_and_csv_hold(run):
    (first, *_) = stiffness_records(stiffness_rows(load_cells(run)))
    assert first["bending_bias_gf_cm2_cm"] == pytest.approx(first["bending_bias_N_m"] / 9.80665e-5)


@pytest.mark.parametrize(
    ("value", "text"), [(2690.4, "2690"), (1.3, "1.30"), (0.000221, "0.000221"), (0.0, "0"), (np.nan, "")]
)
def test_three_significant_digits_without_exponent(value, text):
    assert significant(value) == text


def test_coverage_is_shown_in_per_cent_and_bounds_of_cells_are_in_order(run):
    cells = load_cells(run)
    table = stiffness_table(stiffness_rows(cells))
    place = [column.head for column in table.columns].index("cover")
    assert {entries[0]: entries[place] for entries in table.entries if "bdp" in entries} == {
        "blue": "100", "red": "0", "all cloths": "50",
    }  # fmt: skip
    (row,) = (one for one in cell_table(cells).to_dict("records") if (one["solver"], one["cloth"]) == ("bdp", "blue"))
    for name, value in (("bending_warp_n_m", 1.5 * TRUE), ("stretch_shear_n_per_m", 150.0)):
        found = [row[f"{name}{end}"] for end in ("_low", "", "_high")]
        assert found == pytest.approx([value / 2, value, 2 * value]), name
