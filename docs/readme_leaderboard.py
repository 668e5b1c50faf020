"""Puts the leaderboard of a results folder between the README's markers.

python docs/readme_leaderboard.py runs/bench     # after `make bench`
"""

import re
import sys
from pathlib import Path

from cusick_bench.leaderboard import leaderboards, load_cells, markdown
from cusick_bench.sim.constants import VERTICES_TO_FIT

README = Path(__file__).resolve().parents[1] / "README.md"
HEAD = (
    f"`make bench` on the synthetic set (three cloths, {VERTICES_TO_FIT} vertices, 30 drapes each); the same numbers "
    "in full:\n`leaderboards/synthetic.csv`."
)
FOOT = """\
A disc with the right area is hard to beat on unseen samples: a pixel error mostly scores where folds happen to lie.
MSE: mean squared error of silhouettes; best /N: of the best of N draws; random /N: of the best of N profiles with
random phases of their folds. H: Hausdorff distance. DC err, folds err: errors of drape coefficient and number of folds.
Energy dist., CRPS: errors of the predicted distribution. Rows of one rank cannot be told apart; `null:` rows use no
physics."""
BLOCK = re.compile(r"(?<=<!-- leaderboard:begin -->\n).*(?=<!-- leaderboard:end -->)", re.S)


def block(folder: Path) -> str:
    """The README's block.

    Args:
        folder: Results folder.

    Returns:
        Markdown: the table of the only leaderboard, without its notes.
    """
    (board,) = leaderboards(load_cells(folder))
    table = [line for line in markdown(board).splitlines() if line.startswith("|")]
    return "\n".join([HEAD, "", *table, "", FOOT, ""])


if __name__ == "__main__":
    text = README.read_text(encoding="utf-8")
    README.write_text(BLOCK.sub(lambda _: block(Path(sys.argv[1])), text), encoding="utf-8")
