"""Arrays of an .npz file that others wrote: their headers are read before memory is asked for."""

import math
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from cusick_bench.files.errors import BadFile
from cusick_bench.files.regular_file import require_regular, size
from cusick_bench.files.silence import without_warnings

_MOST_BYTES = 1 << 30  # of all arrays; a thousand draws have 65 MB
_MOST_ARRAYS = 4096
_KINDS = "biufcUS?"  # kinds of numbers and text; objects would be unpickled


def read_npz(
    path: Path, *, remedy: str, most_bytes: int = _MOST_BYTES, wanted: Callable[[str], bool] = lambda name: True
) -> dict[str, ndarray]:
    """Reads the arrays of an .npz file.

    Args:
        path: The file.
        remedy: What the user can do where it cannot be read.
        most_bytes: Size that the file, and all its arrays together, may have at most [bytes].
        wanted: Whether an array of this name is read; by default all are.

    Returns:
        Arrays by name.

    Raises:
        BadFile: See `require_regular`; or it is no .npz file, damaged, or its arrays are too large or hold neither
            numbers nor text.
    """
    require_regular(path, most_bytes=most_bytes, remedy=remedy)
    try:
        with zipfile.ZipFile(path) as archive, without_warnings():  # numpy's remarks on odd headers
            names = archive.namelist()
            if len(names) > _MOST_ARRAYS or len(set(names)) < len(names):
                raise BadFile(path, f"must hold at most {_MOST_ARRAYS} arrays, none twice, got {len(names)}", remedy)
            chosen = [name for name in names if name.endswith(".npy") and wanted(name.removesuffix(".npy"))]
            total = sum(_promised(archive, name, path, remedy) for name in chosen)
            if total > most_bytes:
                what = f"must hold arrays of at most {size(most_bytes)} together, got {size(total)}"
                raise BadFile(path, what, remedy)
            return {name.removesuffix(".npy"): _array(archive, name) for name in chosen}
    except BadFile:
        raise
    except (  # what zipfile, its decompressors and numpy, which parses headers as Python, raise on damaged files
        OSError,
        EOFError,
        ValueError,
        LookupError,
        TypeError,
        SyntaxError,
        OverflowError,
        RecursionError,
        NotImplementedError,
        RuntimeError,
        tokenize.TokenError,
        zipfile.BadZipFile,
        zlib.error,
        *_lzma_errors(),
    ) as error:
        raise BadFile(path, f"cannot be read as an .npz file ({error})", remedy) from error


def _lzma_errors() -> tuple[type[Exception], ...]:
    """What its decompressor raises; none where Python was built without it, whose zipfile refuses such arrays."""
    try:
        import lzma
    except ImportError:
        return ()
    return (lzma.LZMAError,)


def _promised(archive: zipfile.ZipFile, name: str, path: Path, remedy: str) -> int:
    """Bytes of an array as its header has them, once that is the header of numbers or text."""
    with archive.open(name) as file:
        shape, dtype = _header(file)
    if dtype.kind not in _KINDS:
        raise BadFile(path, f"array {name[:60]!r} must hold numbers or text, got {dtype}", remedy)
    promised, held = math.prod(shape) * dtype.itemsize, archive.getinfo(name).file_size
    if promised > held:
        what = f"array {name[:60]!r} promises {size(promised)}, and the file holds {size(held)} of it"
        raise BadFile(path, what, remedy)
    return promised


def _header(file: Any) -> tuple[tuple[int, ...], np.dtype]:
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if any(length < 0 for length in shape):
        raise ValueError(f"an array has the shape {shape}")
    return shape, dtype


def _array(archive: zipfile.ZipFile, name: str) -> ndarray:
    with archive.open(name) as file:
        return np.lib.format.read_array(file, allow_pickle=False)
