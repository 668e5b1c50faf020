"""`cusick-bench data synthetic`: makes the shipped synthetic set again, and compares the two."""

import json
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.options import Json, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.registry import REGISTRY


@user_errors
def synthetic(
    out: Annotated[Path, output_option(help="Folder to write the set to.")],
    samples: Annotated[int, typer.Option(min=1, max=12, help="Samples per cloth; fewer make a part.")] = 12,
    as_json: Json = False,
) -> None:
    """Simulate the synthetic set from its recipe and compare every file with the shipped one."""
    from cusick_bench.datasets.synthetic_set import files as synthetic_files
    from cusick_bench.datasets.synthetic_set import recipe as synthetic_recipe

    shipped = _shipped_checksums()  # before the set is written, perhaps over the shipped one
    drapes = len(synthetic_recipe.cloths()) * samples * len(synthetic_recipe.CAPTURES)
    with progress_bar("draping", drapes) as bar, interruptible(f"the drapes that were ready are in {out}"):
        made = synthetic_files.write_synthetic(out, samples=samples, step=lambda name: bar.advance())
    shared = [name for name in made if name in shipped and name != "croissant.json"]
    different = [name for name in shared if made[name] != shipped[name]]
    if as_json:
        print_json({"out": out, "files": len(made), "compared": len(shared), "different": different})
    else:
        equal = f"{len(shared) - len(different)} of {len(shared)} equal the shipped ones"
        output.print(f"{len(made)} files in {out}; {equal if shipped else 'no shipped ones to compare them with'}")
    if different:
        raise typer.Exit(1)


def _shipped_checksums() -> dict[str, str]:
    """SHA-256 of the shipped files; none where they are missing, so that the set can be made again."""
    from cusick_bench.datasets.files.checksums import CHECKSUMS

    try:
        return json.loads((REGISTRY["synthetic"].folder() / CHECKSUMS).read_text())
    except (DataNotFound, FileNotFoundError):
        return {}
