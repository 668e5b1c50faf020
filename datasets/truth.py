"""True or otherwise measured stiffness of a data set's cloths, from `truth.json` beside the data.

    {"law": "paper", "fabrics": {"1": {"bending_N_m": 3 rows of 5, "stretch_N_m": 6 rows of 4, "poisson": 0, ...}, ...}}

The synthetic set has it, since its cloths were simulated; a laboratory that has measured its cloths may write it too.
The file is looked for where `fabrics.csv` is, and fabrics are named as there (`1`, `fabric_1`, `Fabric 1`).
Solvers never see it: found stiffness is held against it afterwards.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import BadTable
from cusick_bench.datasets.files.fabrics import fabric_key
from cusick_bench.datasets.files.layout import beside, inside_root
from cusick_bench.datasets.files.object_file import read_object
from cusick_bench.files.json_file import shown
from cusick_bench.sim.cloth.material import BENDING_SHAPE, STRETCH_SAMPLES

FILE = "truth.json"
_LAWS = ("paper", "plate")  # whose bending table is the stiffness of the plate; a file that names none is of the first
_TABLES = {"stretch_N_m": ((STRETCH_SAMPLES, 4), [0, 2, 3]), "bending_N_m": (BENDING_SHAPE, list(range(5)))}
"""Shape of each table, and the columns that must be positive: all but c12."""
_REMEDY = "correct it, or take it away: nothing but the comparison with the truth needs it"


@dataclass(frozen=True, eq=False)
class TrueTables:
    """True tables of a cloth.

    Attributes:
        law: Material law that reads them.
        stretch: C [N/m].
        bending: B [N m].
        poisson: Poisson's ratio of bending, which law `plate` has.
    """

    law: str
    stretch: Float[Tensor, "6 4"]
    bending: Float[Tensor, "3 5"]
    poisson: float = 0.0


def true_tables(dataset: DrapeDataset, cloth: str) -> TrueTables | None:
    """The true tables of a cloth.

    Args:
        dataset: The data set.
        cloth: Name of the cloth.

    Returns:
        Its tables; None where there is no `truth.json`, or it does not name the cloth.

    Raises:
        BadTable: `truth.json` is malformed, names a fabric twice, or holds stiffness that is not positive.
    """
    found = beside(dataset.root, FILE)
    if found is None:
        return None
    path = inside_root(found.parent, found.name)
    document = read_object(path, "invalid-truth")
    fabrics, law = document.get("fabrics"), document.get("law", _LAWS[0])
    if not isinstance(fabrics, dict):
        raise BadTable('"fabrics" must be an object', where=path, remedy=_REMEDY, kind="invalid-truth")
    if law not in _LAWS:
        raise BadTable(
            f'"law" must be {" or ".join(_LAWS)}, got {shown(law)}', where=path, remedy=_REMEDY, kind="invalid-truth"
        )
    names = _names(fabrics, path)
    keys = (fabric_key(cloth), f"fabric_{_fabric(dataset, cloth)}")
    name = next((names[key] for key in keys if key in names), None)
    if name is None:
        return None
    where = f"{path}, fabric {name}"
    stretch, bending = (_table(fabrics[name], table, where) for table in _TABLES)
    return TrueTables(law, stretch, bending, _poisson(fabrics[name].get("poisson", 0.0), where))


def _names(fabrics: dict[str, Any], path: Path) -> dict[str, str]:
    """Names of fabrics as the file has them, by `fabric_key`."""
    names: dict[str, str] = {}
    for name in fabrics:
        if names.setdefault(fabric_key(name), name) != name:
            first = names[fabric_key(name)]
            what = f"fabric {shown(name)} is given twice, also as {shown(first)}"
            raise BadTable(what, where=path, remedy=_REMEDY, kind="invalid-truth")
    return names


def _fabric(dataset: DrapeDataset, cloth: str) -> int:
    rows = dataset.table.loc[dataset.table["cloth"] == cloth, "fabric"]
    return int(rows.iloc[0]) if len(rows) else 0


def _poisson(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not -1 < value < 1:
        rule = f'"poisson" must be a number between -1 and 1, got {shown(value)}'
        raise BadTable(rule, where=where, remedy=_REMEDY, kind="invalid-truth")
    return float(value)


def _table(tables: Any, name: str, where: str) -> Float[Tensor, "rows columns"]:
    (rows, columns), positive = _TABLES[name]
    try:
        table = np.array(tables[name], dtype=np.float64)
    except (KeyError, ValueError, TypeError, OverflowError):
        table = np.empty(0)
    if table.shape != (rows, columns) or not np.isfinite(table).all() or (table[:, positive] <= 0).any():
        rule = f'"{name}" must be {rows} rows of {columns} numbers, all stiffnesses > 0'
        raise BadTable(rule, where=where, remedy=_REMEDY, kind="invalid-truth")
    return torch.from_numpy(table)
