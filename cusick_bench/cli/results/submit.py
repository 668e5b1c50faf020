"""`cusick-bench submit`: a run's rows for a committed table, with everything needed to repeat and to verify them."""

from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import command_with, output, print_json, tell, user_errors
from cusick_bench.cli.options import Json, RunFolder, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import outside_package

app = typer.Typer()


@app.command("submit")
@user_errors
def submit_command(
    run: RunFolder,
    track: Annotated[str, typer.Option(help="Track, such as paper-table-1, paper-table-2, synthetic.")],
    out: Annotated[Path | None, output_option(help="Table to add to; by default leaderboards/TRACK.csv.")] = None,
    as_json: Json = False,
) -> None:
    """Add a run's rows to a track's table; rows that are there already are updated, never added twice.

    Rows of other tracks in the same file stay. A track is for one data set and certain mesh sizes; other rows are
    refused, and so is a run with damaged cells or one that is not finished (exit status 2). Tracks of this project:
    synthetic, paper-table-1, paper-table-2. Any other name is a track of your own, for the data set and mesh of its
    first rows.

    Run `verify` before, or the rows are marked *reported*.
    """
    from cusick_bench.leaderboard.cells.loading import load_cells
    from cusick_bench.leaderboard.verification.submit import append, rows_of

    path = out or Path("leaderboards") / f"{track}.csv"
    outside_package(path)
    with progress_bar("reading cells") as bar:
        cells = load_cells(run, progress=bar.show)
    cells.require_sound()
    cells.require_finished()
    rows = rows_of(cells, track)
    counts = append(path, rows)
    verified = sum(row["state"] == "verified" for row in rows)
    if as_json:
        print_json({"path": path, **counts, "verified": verified, "rows": rows})
        return
    output.print(
        f"{path}: {counts['added']} rows added, {counts['replaced']} replaced, {counts['unchanged']} as they were; "
        f"{verified} of {len(rows)} verified"
    )
    if verified < len(rows):
        tell(f"next: {command_with('verify', run)}, then submit again")
