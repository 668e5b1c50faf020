"""Damaged and hostile meshes are refused; the usual variants of OBJ are read."""

import gzip
import pickle

import pytest
from bad_images import Exploit

from cusick_bench.datasets.errors import BadMesh
from cusick_bench.datasets.files.mesh_file import read_mesh

BAD_MESHES = {
    "no text": b"\x00\xff\xfe binary",
    "no faces": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "two corners": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n",
    "missing vertex": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
    "vertex zero": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    "word": b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "two coordinates": b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n",
    "not finite": b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "pickle": pickle.dumps(Exploit()),
}


@pytest.mark.parametrize("fault", BAD_MESHES)
def test_bad_meshes_are_refused(tmp_path, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "drape.obj"
    path.write_bytes(BAD_MESHES[fault])
    with pytest.raises(BadMesh) as caught:
        read_mesh(path)
    assert caught.value.kind == "unreadable-mesh"
    assert str(path) in str(caught.value)
    assert not (tmp_path / "exploited").exists()


def test_huge_meshes_are_not_read(tmp_path, monkeypatch):
    bomb = tmp_path / "drape.obj.gz"
    bomb.write_bytes(gzip.compress(b"v 0 0 0\n" * 10_000_000))
    assert bomb.stat().st_size < 1 << 20
    with pytest.raises(BadMesh) as caught:
        read_mesh(bomb)
    assert caught.value.kind == "mesh-too-large"
    (tmp_path / "broken.obj.gz").write_bytes(b"no gzip")
    with pytest.raises(BadMesh, match="cannot be read"):
        read_mesh(tmp_path / "broken.obj.gz")
    sparse = tmp_path / "drape.obj"
    with sparse.open("wb") as file:
        file.truncate(1 << 33)
    with pytest.raises(BadMesh, match="64 MiB"):
        read_mesh(sparse)


def test_obj_variants(tmp_path):
    path = tmp_path / "square.obj"
    path.write_text(
        "# quad\no cloth\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nf 1/1 2/1 3/1 4//1\n"
    )
    mesh = read_mesh(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertices[2].tolist() == [1, 1, 0]
    path.write_text("v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nf -3 -2 -1\r\n")
    assert read_mesh(path).faces.tolist() == [[0, 1, 2]]
