"""Lists everything in a folder that does not follow the layout; no fault stops the audit."""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from cusick_bench.datasets import named, pairing
from cusick_bench.datasets.audit import files as audit_files
from cusick_bench.datasets.audit import images as audit_images
from cusick_bench.datasets.audit import meshes as audit_meshes
from cusick_bench.datasets.audit.limits import UNREADABLE, impossible_faults
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.checksums import CHECKSUMS, changed_files
from cusick_bench.datasets.files.fabrics import FILE as FABRICS_FILE
from cusick_bench.datasets.files.fabrics import Fabric, read_fabrics
from cusick_bench.datasets.files.layout import Layout, scan
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL_FILE
from cusick_bench.datasets.files.protocol import Protocol, read_protocol
from cusick_bench.datasets.index import Progress, survey
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.datasets.registry import folder_of

T = TypeVar("T")

_UNTIL_MENDED = {
    PROTOCOL_FILE: "until it is mended no picture and no mesh is measured",
    FABRICS_FILE: "until it is mended no missing weight or thickness is listed",
}
"""What an audit leaves out where a table is malformed."""


@dataclass(frozen=True)
class Audit:
    """Contents and irregularities of a folder.

    Attributes:
        fabrics: Number of different fabrics; of named sets where there are no others.
        samples: Number of samples, a series over time counting for itself.
        silhouettes: Number of silhouettes, copies in named sets left out.
        meshes: Number of mesh files.
        irregularities: Sorted by path.
        impossible: Silhouettes that no cloth on the plate can show, by path: they stop a fit or a diagnosis.
        matches: How each mesh fits the silhouettes of its sample.
    """

    fabrics: int
    samples: int
    silhouettes: int
    meshes: int
    irregularities: tuple[Irregularity, ...]
    impossible: tuple[str, ...] = ()
    matches: tuple[pairing.MeshMatch, ...] = field(default=(), repr=False)

    @property
    def table(self) -> pd.DataFrame:
        """The irregularities: path, kind, detail."""
        return pd.DataFrame(
            [asdict(item) for item in self.irregularities], columns=pd.Index(["path", "kind", "detail"])
        )

    @property
    def kinds(self) -> dict[str, int]:
        """How many irregularities of each kind, most frequent first."""
        return dict(Counter(item.kind for item in self.irregularities).most_common())

    def document(self) -> dict[str, Any]:
        """Plain numbers and lists, as printed by `data audit --json`."""
        counts = {name: getattr(self, name) for name in ("fabrics", "samples", "silhouettes", "meshes")}
        irregularities = [asdict(item) for item in self.irregularities]
        return counts | {"irregularities": irregularities, "impossible": list(self.impossible)}


def audit(name_or_path: str | Path, *, progress: Progress | None = None) -> Audit:
    """Looks at every file of a data set.

    Where protocol.json is malformed nothing is measured, since all would be judged by the release's values; where
    fabrics.csv is, no fabric is said to lack what may stand there.

    Args:
        name_or_path: A registered name or a folder.
        progress: Called with (files done, files).

    Returns:
        What the folder holds, and every irregularity.

    Raises:
        DataNotFound: There is no folder, or nothing in it that looks like a silhouette.
    """
    layout = scan(folder_of(name_or_path))
    problems: list[Irregularity] = list(layout.problems)
    described = _tolerant(layout, PROTOCOL_FILE, read_protocol, Protocol(), problems)
    fabrics: dict[str, Fabric] | None = _tolerant(layout, FABRICS_FILE, read_fabrics, {}, problems)
    protocol = described or replace(Protocol(), captures={entry.capture or 1: "" for entry in layout.silhouettes})
    found = survey(layout, protocol, measure=described is not None, progress=progress)
    captures = [entry for entry in layout.silhouettes if not entry.is_named]
    matches = pairing.match_meshes(captures, layout.meshes, found.images, found.outlines, protocol)
    problems += [
        *(Irregularity(path, fault.kind, fault.what) for path, fault in found.faults.items()),
        *_changed(layout),
        *audit_files.check_names(layout, protocol),
        *audit_files.check_tables(layout, protocol, fabrics, found),
        *audit_images.check_images(layout, protocol, found),
        *audit_images.check_frame(layout, protocol, found),
        *audit_images.check_named_sets(layout, protocol, named.twins(layout.silhouettes, found.hashes, found.images)),
        *audit_meshes.check_meshes(layout, protocol, found, matches),
    ]
    impossible = [path for path, fault in found.faults.items() if fault.kind in UNREADABLE]
    impossible += [path for path, image in found.silhouettes.items() if any(impossible_faults(path, image, protocol))]
    return Audit(
        **layout.counts,
        irregularities=tuple(sorted(set(problems))),
        impossible=tuple(sorted(impossible)),
        matches=tuple(matches),
    )


def _tolerant(
    layout: Layout, name: str, read: Callable[[Path], T], default: T, problems: list[Irregularity]
) -> T | None:
    """A table beside the data, `default` where there is none, None where it is malformed."""
    path = layout.beside(name)
    if path is None:
        return default
    try:
        return read(path)
    except DataError as error:
        where = path.relative_to(layout.root).as_posix() if path.is_relative_to(layout.root) else path.as_posix()
        place = error.where.partition(", line ")[2]
        what = f"line {place}: {error.what}" if place else error.what
        problems.append(Irregularity(where, error.kind, f"{what}; {_UNTIL_MENDED[name]}"))
        return None


def _changed(layout: Layout) -> list[Irregularity]:
    if not (layout.root / CHECKSUMS).is_file():
        return []
    try:
        return [Irregularity(name, "checksum", what) for name, what in changed_files(layout)]
    except DataError as error:
        return [Irregularity(CHECKSUMS, "checksum", error.what)]
