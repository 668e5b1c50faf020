"""Reading of reference drapes."""

from pathlib import Path

import pytest

from cusick_bench.datasets.errors import BadTable
from cusick_bench.datasets.files.plate_drapes import COLUMNS, PlateDrape, read_plate_drapes

GOOD = "6,-4.2,0,0.9426,145.14,149.20,-22.70,3e-4"


def _table(folder: Path, *rows: str, header: str = ",".join(COLUMNS)) -> Path:
    path = folder / "drapes.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_rows_are_read_in_their_order(tmp_path: Path):
    path = _table(tmp_path, "# stiff", "0,-2,-0.333333,0.99627,149.823,149.823,-4.4465,1e-4", "", GOOD)
    stiff, folded = read_plate_drapes(path)
    assert stiff == PlateDrape(0, -2.0, -0.333333, 0.99627, 149.823, 149.823, -4.4465, 1e-4)
    assert (folded.folds, folded.rim_lowest_mm) == (6, -22.7)


@pytest.mark.parametrize(
    ("row", "rule"),
    [
        ("6.5,-4.2,0,0.9426,145.14,149.20,-22.70,3e-4", "folds must be a whole number, got 6.5"),
        ("-1,-4.2,0,0.9426,145.14,149.20,-22.70,3e-4", "folds must be a number from 0 to 24, got '-1'"),
        ("6,much,0,0.9426,145.14,149.20,-22.70,3e-4", "ln_bending must be a number from -12 to 4, got 'much'"),
        ("6,-4.2,1,0.9426,145.14,149.20,-22.70,3e-4", "poisson must be a number from -0.99 to 0.99, got '1'"),
        ("6,-4.2,0,94.26,145.14,149.20,-22.70,3e-4", "drape_coefficient must be a number from 0 to 1, got '94.26'"),
        ("6,-4.2,0,nan,145.14,149.20,-22.70,3e-4", "drape_coefficient must be a number"),
        ("6,-4.2,0,0.9426,149.20,145.14,-22.70,3e-4", "rim_min_mm must not exceed rim_max_mm, got 149.2 and 145.14"),
        ("6,-4.2,0,0.9426,145.14,149.20,22.70,3e-4", "rim_lowest_mm must be a number from -1000 to 0"),
        ("6,-4.2,0,0.9426,145.14,149.20,-22.70", "accuracy must be a number"),
        (GOOD, "has the drape of 6 folds, ln_bending -4.2 and poisson 0 again"),
    ],
)
def test_a_bad_row_is_named_with_its_line(tmp_path: Path, row: str, rule: str):
    with pytest.raises(BadTable) as caught:
        read_plate_drapes(_table(tmp_path, GOOD, row))
    assert "line 3" in str(caught.value)
    assert rule in str(caught.value)


def test_a_table_without_drapes_or_columns_is_refused(tmp_path: Path):
    with pytest.raises(BadTable, match="has no drape"):
        read_plate_drapes(_table(tmp_path))
    with pytest.raises(BadTable, match="needs the columns"):
        read_plate_drapes(_table(tmp_path, "1,2", header="fabric,areal_density_kg_m2"))
    with pytest.raises(BadTable, match="not"):
        read_plate_drapes(tmp_path / "missing.csv")
