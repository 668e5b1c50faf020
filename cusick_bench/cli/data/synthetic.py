"""`cusick-bench data synthetic`: makes the shipped synthetic set again, and compares the two."""

import json
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.options import Json, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.datasets.registry import REGISTRY

SHIPPED = REGISTRY["synthetic"].folder()


@user_errors
def synthetic(
    out: Annotated[Path, output_option(help="Folder to write the set to.")],
    samples: Annotated[int, typer.Option(min=1, max=12, help="Samples per cloth; fewer make a part.")] = 12,
    as_json: Json = False,
) -> None:
    """Simulate the synthetic set from its recipe and compare every file with the shipped one."""
    from cusick_bench.datasets.files.checksums import CHECKSUMS
    from cusick_bench.datasets.synthetic_set import files as synthetic_files
    from cusick_bench.datasets.synthetic_set import recipe as synthetic_recipe

    drapes = len(synthetic_recipe.cloths()) * samples * len(synthetic_recipe.CAPTURES)
    with progress_bar("draping", drapes) as bar, interruptible(f"the drapes that were ready are in {out}"):
        made = synthetic_files.write_synthetic(out, samples=samples, step=lambda name: bar.advance())
    shipped = json.loads((SHIPPED / CHECKSUMS).read_text())
    shared = [name for name in made if name in shipped and name != "croissant.json"]
    different = [name for name in shared if made[name] != shipped[name]]
    if as_json:
        print_json({"out": out, "files": len(made), "compared": len(shared), "different": different})
    else:
        equal = len(shared) - len(different)
        output.print(f"{len(made)} files in {out}; {equal} of {len(shared)} equal the shipped ones")
    if different:
        raise typer.Exit(1)
