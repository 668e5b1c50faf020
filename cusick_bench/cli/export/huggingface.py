"""`cusick-bench export huggingface`: a data set in the form of the library `datasets`."""

from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import command_line, print_json, tell, user_errors
from cusick_bench.cli.options import Data, FabricsCsv, Json
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import outside_package


@user_errors
def huggingface(
    folder: Annotated[
        Path, typer.Argument(help="New folder for the data set.", metavar="DIR", callback=outside_package)
    ],
    data: Data = "synthetic",
    fabrics_csv: FabricsCsv = None,
    json: Json = False,
) -> None:
    """Write a data set for Hugging Face's library `datasets`: Parquet with the images inside, and a card.

    Needs pyarrow (pip install 'cusick-bench[parquet]'). Then, in Python, `datasets.load_dataset(DIR)`. The public
    release has no licence: what is written of it is for yourself.
    """
    from cusick_bench.datasets import load
    from cusick_bench.export.huggingface import write_huggingface

    with progress_bar("writing silhouettes"):
        rows = write_huggingface(load(data, fabrics_csv=fabrics_csv), folder, command=command_line())
    tell(f"wrote {rows} silhouettes to {folder}")
    if json:
        print_json({"path": folder, "rows": rows})
