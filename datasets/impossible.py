"""Refuses to compute from silhouettes that no cloth on the plate can show, before anything is simulated."""

from collections.abc import Iterable, Iterator, Sequence

from cusick_bench.datasets.audit.limits import UNREADABLE, impossible_faults
from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import BadImage, DataError
from cusick_bench.datasets.files.layout import inside_root
from cusick_bench.datasets.files.measure import measure_image
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.datasets.registry import is_shipped
from cusick_bench.files.shell_word import shell_word

_SHOWN = 3


class ImpossibleSilhouettes(DataError):
    """Pictures that are to be used show no cloth on the plate."""


def impossible(dataset: DrapeDataset, rows: Iterable[int]) -> list[Irregularity]:
    """Looks for impossible silhouettes among those that are to be used.

    Pictures that the set was loaded with `centre` to correct are judged where they were moved to. The shipped set is
    known by its checksums and is not measured.

    Args:
        dataset: The data set.
        rows: Rows of its index.

    Returns:
        One item for each fault, by row.
    """
    if is_shipped(dataset.root):
        return []
    found: list[Irregularity] = []
    for row in sorted(set(rows)):
        values = {str(name): value for name, value in dataset.table.iloc[row].items()}
        path, shift = str(values["image"]), ("image_shift_columns_px", "image_shift_rows_px")
        try:
            image = measure_image(inside_root(dataset.root, path), dataset.protocol)
        except BadImage as error:
            if error.kind in UNREADABLE:
                found.append(Irregularity(path, error.kind, error.what))
            continue
        faults = impossible_faults(path, image, dataset.protocol)
        moved = any(float(values[name]) for name in shift)
        found += [fault for fault in faults if not (moved and fault.kind == "far-off-centre")]
    return found


def require_possible(dataset: DrapeDataset, rows: Iterable[int], *, force: bool = False) -> tuple[str, ...]:
    """Refuses silhouettes that no cloth on the plate can show.

    Args:
        dataset: The data set.
        rows: Rows of its index that are to be used.
        force: Whether to use them all the same.

    Returns:
        With `force`, what was found, for the record: one text for each fault.

    Raises:
        ImpossibleSilhouettes: Without `force`, there are some.
    """
    found = impossible(dataset, rows)
    if found and not force:
        pictures = len({fault.path for fault in found})
        forcing = ", or take them as they are with --force"
        if any(fault.kind in UNREADABLE for fault in found):
            forcing = "; --force takes all but those that show no single cloth"
        raise ImpossibleSilhouettes(
            f"{pictures} of the silhouettes to be used show{'s' if pictures == 1 else ''} no cloth on its plate: "
            f"{listed(found)}",
            where=dataset.root,
            remedy=f"look with `cusick-bench data audit {shell_word(dataset.root)}`, correct the pictures or "
            f"protocol.json{forcing}",
            kind=found[0].kind,
        )
    return tuple(map(_text, found))


def require_readable(dataset: DrapeDataset, rows: Iterable[int]) -> None:
    """Refuses pictures that cannot be read, before drapes are spent on a fit that could not be scored.

    Args:
        dataset: The data set.
        rows: Rows of its index that are to be used.

    Raises:
        BadImage: One cannot be read, or shows no single cloth.
    """
    for fault in unreadable(dataset, rows):
        raise fault


def unreadable(dataset: DrapeDataset, rows: Iterable[int]) -> Iterator[BadImage]:
    """Finds pictures that cannot be read, or show no single cloth; the shipped set is not looked at.

    Args:
        dataset: The data set.
        rows: Rows of its index.

    Yields:
        Why not, one error a picture.
    """
    if is_shipped(dataset.root):
        return
    for row in sorted(set(rows)):
        try:
            measure_image(inside_root(dataset.root, str(dataset.table["image"].iloc[row])), dataset.protocol)
        except BadImage as error:
            yield error


def listed(faults: Sequence[Irregularity]) -> str:
    """Names the first few of some faults, and tells how many more there are.

    Args:
        faults: From `impossible`.

    Returns:
        One line.
    """
    more = [f"and {len(faults) - _SHOWN} more"] if len(faults) > _SHOWN else []
    return "; ".join([*map(_text, faults[:_SHOWN]), *more])


def _text(fault: Irregularity) -> str:
    return f"{fault.path}: {fault.detail} ({fault.kind})"
