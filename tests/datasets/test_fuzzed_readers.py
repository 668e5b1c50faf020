"""Readers fed with random and with damaged files (Hypothesis): a value, or one clear error, and nothing else.

CUSICK_EXAMPLES=20000 python -m pytest -m nightly tests/datasets/test_fuzzed_readers.py
"""

import gzip
import io
import json
import os
import runpy
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from cusick_bench.datasets import load
from cusick_bench.datasets.files.fabrics import read_fabrics
from cusick_bench.datasets.files.image import read_silhouette
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.plate_drapes import read_plate_drapes
from cusick_bench.datasets.files.protocol import read_protocol
from cusick_bench.files import BadFile, npz_file, read_json_object, read_npz
from cusick_bench.photographs.reading import read_photograph
from cusick_bench.sim.errors import CusickError

EXAMPLES = int(os.environ.get("CUSICK_EXAMPLES", "2000"))
FEW = 40  # in the default suite

SHIPPED = Path(str(load("synthetic").root))


def _picture(form: str) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.tri(256, dtype=np.uint8) * 200).save(buffer, format=form)
    return buffer.getvalue()


def _arrays() -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, vertices=np.arange(9.0).reshape(3, 3), faces=np.array([[0, 1, 2]]))
    return buffer.getvalue()


OBJ = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
FABRICS = b"fabric,areal_density_kg_m2,thickness_m\nfabric_1,0.2,0.0004\n2,0.15,\n"
PLATES = (
    b"folds,ln_bending,poisson,drape_coefficient,rim_min_mm,rim_max_mm,rim_lowest_mm,accuracy\n"
    b"7,-11.5,0.1,0.61,110,140,-50,1e-4\n"
)
PROTOCOL = (SHIPPED / "protocol.json").read_bytes()
JSON = json.dumps({"a": [1, 2.5, None, {"b": "\u00e9"}]}).encode()

# Name: ending, a sound file, reader.
READERS: dict[str, tuple[str, bytes, Callable[[Path], Any]]] = {
    "png": (".png", _picture("PNG"), read_silhouette),
    "jpeg": (".jpg", _picture("JPEG"), read_silhouette),
    "tiff photograph": (".tif", _picture("TIFF"), read_photograph),
    "png photograph": (".png", _picture("PNG"), read_photograph),
    "mesh": (".obj", OBJ, read_mesh),
    "packed mesh": (".obj.gz", gzip.compress(OBJ), read_mesh),
    "fabrics": (".csv", FABRICS, read_fabrics),
    "plates": (".csv", PLATES, read_plate_drapes),
    "protocol": (".json", PROTOCOL, read_protocol),
    "json": (".json", JSON, lambda path: read_json_object(path, remedy="mend it")),
    "arrays": (".npz", _arrays(), lambda path: read_npz(path, remedy="mend it")),
}


@st.composite
def _damaged(draw: st.DrawFn, sound: bytes) -> bytes:
    """A sound file with some bytes changed, put in, repeated or taken out."""
    content = bytearray(sound)
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, max(0, len(content) - 1)))
        length = draw(st.integers(0, 12))
        kind = draw(st.sampled_from(("change", "put in", "take out", "cut", "repeat")))
        if kind == "change":
            content[place : place + length] = draw(st.binary(min_size=length, max_size=length))
        elif kind == "put in":
            words = (b"nan", b"-1", b"1e999", b"\x00", b'"', b",", b"\n", b"[" * 50, b"9" * 400, b"\xff\xfe", b"=1+1")
            content[place:place] = draw(st.sampled_from(words))
        elif kind == "take out":
            del content[place : place + length]
        elif kind == "cut":
            del content[place:]
        else:
            content += content[place : place + 200]
    return bytes(content)


def _read(reader: Callable[[Path], Any], path: Path, content: bytes) -> None:
    """Reads a file; an error must be one of ours, and say something."""
    path.write_bytes(content)
    try:
        reader(path)
    except CusickError as error:
        text = str(error)
        assert text.strip()
        assert "Traceback" not in text


def _fuzzed(name: str, folder: Path, examples: int) -> None:
    ending, sound, reader = READERS[name]
    path = folder / f"file{ending}"

    @settings(
        max_examples=examples, deadline=None, database=None, derandomize=examples == FEW,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture],
    )  # fmt: skip
    @given(st.one_of(_damaged(sound), st.binary(max_size=300)))
    def tried(content: bytes) -> None:
        _read(reader, path, content)

    tried()


@pytest.mark.parametrize("name", READERS)
def test_the_sound_file_is_read(name: str, tmp_path: Path):
    """Or fuzzing would only try how unsound ones are refused."""
    ending, sound, reader = READERS[name]
    (tmp_path / f"file{ending}").write_bytes(sound)
    assert reader(tmp_path / f"file{ending}") is not None


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(name: str, tmp_path: Path):
    _fuzzed(name, tmp_path, FEW)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", READERS)
def test_many_damaged_files_are_read_or_refused(name: str, tmp_path: Path):
    _fuzzed(name, tmp_path, EXAMPLES)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
def test_data_sets_with_a_damaged_file_are_loaded_or_refused(toy_data: Path, tmp_path: Path):
    """The whole loader, its index, audit and samples, with one file replaced by a damaged one."""
    files = sorted(path for path in toy_data.rglob("*") if path.is_file())

    @settings(
        max_examples=max(1, EXAMPLES // 20), deadline=None, database=None, suppress_health_check=list(HealthCheck)
    )
    @given(st.data())
    def tried(data: st.DataObject) -> None:
        victim = data.draw(st.sampled_from(files))
        sound = victim.read_bytes()
        try:
            victim.write_bytes(data.draw(_damaged(sound)))
            dataset = load(toy_data)
            dataset.audit()
            for row in range(min(3, len(dataset))):
                dataset.sample(row)
        except CusickError:
            pass
        finally:
            victim.write_bytes(sound)

    tried()


@pytest.mark.filterwarnings("ignore")
def test_a_zip_that_is_no_npz_is_refused(tmp_path: Path):
    path = tmp_path / "file.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../escape.npy", b"x")
    with pytest.raises(CusickError):
        read_npz(path, remedy="mend it")
    assert not (tmp_path.parent / "escape.npy").exists()


def _packed(header: bytes, method: int = zipfile.ZIP_STORED) -> bytes:
    """An .npz file of one array with such a header."""
    buffer, text = io.BytesIO(), header.ljust(117) + b"\n"
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(1 << 16))
    return buffer.getvalue()


HEADER = b"{'descr': '<f8', 'fortran_order': False, 'shape': (8192,), }"


@pytest.mark.parametrize(
    "content",
    [
        _packed(HEADER.replace(b"}", b" ")),
        _packed(HEADER.replace(b"'<f8'", b"()")),
        _packed(HEADER, zipfile.ZIP_LZMA).replace(b"\x09\x04\x05\x00\x5d", b"\x09\x04\x05\x00\xff"),
    ],
    ids=["brace", "type", "lzma"],
)
def test_an_npz_whose_arrays_cannot_be_understood_is_refused(tmp_path: Path, content: bytes):
    """One wrong byte in the header of a large array ended in a traceback: sums are checked after headers are read."""
    path = tmp_path / "file.npz"
    path.write_bytes(_packed(HEADER))
    assert read_npz(path, remedy="mend it")["a"].shape == (8192,)
    path.write_bytes(content)
    with pytest.raises(BadFile, match=r"cannot be read as an \.npz file"):
        read_npz(path, remedy="mend it")


def test_a_python_without_lzma_reads_npz_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every command ended in `No module named '_lzma'`: such a Python is built where the library's headers lack."""
    monkeypatch.setitem(sys.modules, "lzma", None)
    read, path = runpy.run_path(str(npz_file.__file__))["read_npz"], tmp_path / "file.npz"
    path.write_bytes(_packed(HEADER))
    assert read(path, remedy="mend it")["a"].shape == (8192,)
    path.write_bytes(_packed(HEADER.replace(b"}", b" ")))
    with pytest.raises(BadFile, match=r"cannot be read as an \.npz file"):
        read(path, remedy="mend it")
