"""Tracks: the data set and mesh sizes of a committed table, so that all of its rows answer the same question.

For the declared tracks they are listed here. Any other name is a track of the user, whose first rows decide them.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.loading import read_dataset
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.sim.constants import VERTICES_OF_PAPER


@dataclass(frozen=True)
class Track:
    """Data and mesh sizes that rows of a track have in common.

    Attributes:
        dataset: Name of the data set.
        vertices: Numbers of vertices of the mesh that is asked for.
    """

    dataset: str
    vertices: tuple[int, ...]


TRACKS = {
    "synthetic": Track("synthetic", (600, VERTICES_OF_PAPER)),
    "paper-table-1": Track("cusick", (700, VERTICES_OF_PAPER)),
    "paper-table-2": Track("cusick", (297, VERTICES_OF_PAPER)),
}
"""The tracks of this project, by name."""

_SHARED = ("dataset_hash", "protocol")


def require_fit(rows: Iterable[Mapping[str, Any]], present: Iterable[Mapping[str, Any]]) -> None:
    """Refuses rows that their track is not for.

    Args:
        rows: Rows to add.
        present: Rows that their file holds.

    Raises:
        LeaderboardError: Other data, another split or another mesh size than the track's, or rows of several data.
    """
    rows, known, hash_of = list(rows), list(present), cache(_hash_of)
    _require_one_data(rows)
    for row in rows:
        name = str(row["track"])
        if name in TRACKS:
            _require_declared(row, TRACKS[name], hash_of)
        elif sizes := {vertices_of(line) for line in known if line.get("track") == name}:
            _require(row, "mesh of so many vertices", vertices_of(row), sizes)
        for column in _SHARED:
            _require(row, column, str(row[column]), {str(x[column]) for x in known if x.get("track") == name})


def vertices_of(row: Mapping[str, Any]) -> int:
    """Vertices of the mesh that a row's cells asked for.

    Args:
        row: A row of a track.

    Returns:
        Their number; 0 where the row does not say.
    """
    try:
        return int(json.loads(str(row.get("settings", ""))).get("vertices", 0))
    except (ValueError, AttributeError, TypeError):
        return 0


def _require_one_data(rows: Iterable[Mapping[str, Any]]) -> None:
    """Refuses rows of several data, the first of a track among them, which no row is there yet to be compared with."""
    first: dict[str, tuple[str, str]] = {}
    for row in rows:
        digest, solver = str(row["dataset_hash"]), str(row["solver"])
        known, other = first.setdefault(str(row["track"]), (digest, solver))
        if digest != known:
            raise LeaderboardError(
                f"rows of track {row['track']} must have one dataset hash, got {known} ({other}) and {digest} "
                f"({solver}); run each data set into a folder of its own"
            )


def _hash_of(dataset: str) -> str:
    """Content hash of a named data set, "" where it is not here."""
    try:
        return read_dataset(dataset).content_hash
    except DataError:
        return ""


def _require_declared(row: Mapping[str, Any], track: Track, hash_of: Callable[[str], str]) -> None:
    if row["dataset"] != track.dataset and row["dataset_hash"] != hash_of(track.dataset):  # a folder of another name
        raise LeaderboardError(
            f"track {row['track']} is for the data set {track.dataset}, got {row['dataset']} ({row['solver']}); run "
            f"on --data {track.dataset}, or name a track of your own"
        )
    if vertices_of(row) not in track.vertices:
        sizes = " or ".join(map(str, track.vertices))
        raise LeaderboardError(
            f"track {row['track']} is for meshes of --vertices {sizes}, got {vertices_of(row)} ({row['solver']}); run "
            "with one of these, or name a track of your own"
        )


def _require(row: Mapping[str, Any], what: str, value: object, present: set[Any]) -> None:
    if present and value not in present:
        raise LeaderboardError(
            f"track {row['track']} has rows with {what.replace('_', ' ')} {', '.join(map(str, sorted(present)))}, got "
            f"{value} ({row['solver']}); submit to another track, or to another --out"
        )
