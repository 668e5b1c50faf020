"""Images that no reader takes: damaged, hostile, or of something else than one cloth."""

import os
import struct
import zlib
from pathlib import Path

import numpy as np
from toy_cloths import draw, wavy_profile, write_image

DRAPE = draw(wavy_profile(7))


class Exploit:
    """Unpickling this would leave a trace."""

    def __reduce__(self):
        return (os.mkdir, ("exploited",))


def huge_png() -> bytes:
    """A few hundred bytes that claim 30000 x 30000 pixels."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", 30000, 30000, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    )


def with_blob(pixels: int) -> np.ndarray:
    image = DRAPE.copy()
    image[4 : 4 + pixels, 4 : 4 + pixels] = 1
    return image


BAD_IMAGES = {
    "unreadable-image": b"this is no image",
    "image-too-large": huge_png(),
    "image-size": np.zeros((128, 128)),
    "empty-image": np.zeros((256, 256)),
    "full-image": np.ones((256, 256)),
    "inverted-image": 1 - DRAPE,
    "two-blobs": with_blob(20),
}


def write_any(path: Path, content: bytes | np.ndarray) -> None:
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        write_image(path, content)
