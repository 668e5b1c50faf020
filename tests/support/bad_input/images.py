"""Silhouettes: damaged, of other kinds, hostile, or of no drape that can be. Each is a sample of a lab's fabric."""

import gzip
import io
import os
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy import ndarray
from PIL import Image
from toy_cloths import draw, toy_profile, wavy_profile

from bad_input.case import Case, Outcome, Stock
from cusick_bench.datasets.profile import drape_coefficient

RUN = "run --data {here}/lab --solver null:disc --out {here}/out --json"
STATS = "data stats {here}/lab --json"
DRAPE = draw(toy_profile(7, 1, 1))
GREY = np.round(255 * (1 - DRAPE)).astype(np.uint8)
_COEFFICIENT = 0.002  # by which a drape coefficient may differ for the file format's sake


def place(here: Path, stock: Stock, suffix: str = "png") -> Path:
    """The first sample's silhouette, removed from a copy of the lab: a case writes its own there."""
    folder = stock.copy_lab(here) / "data" / "Fabric 7" / "silhouettes"
    (folder / "Fabric_7_Sample_1_Capture_1.png").unlink()
    return folder / f"Fabric_7_Sample_1_Capture_1.{suffix}"


def _bytes(content: bytes, suffix: str, here: Path, stock: Stock) -> None:
    place(here, stock, suffix).write_bytes(content)


def _save(make: Callable[[], Image.Image], suffix: str, options: dict[str, object], here: Path, stock: Stock) -> None:
    make().save(place(here, stock, suffix), **options)


def _coverage(image: ndarray, here: Path, stock: Stock) -> None:
    Image.fromarray(np.round(255 * (1 - image)).astype(np.uint8)).save(place(here, stock))


def encoded(form: str, image: Image.Image | None = None, **options: object) -> bytes:
    """The drape in a file format."""
    file = io.BytesIO()
    (image or Image.fromarray(GREY)).save(file, form, **options)
    return file.getvalue()


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(width: int, height: int, *, bits: int = 8, colour: int = 0, body: bytes = b"\0" * 100) -> bytes:
    """A PNG file that claims a size, whatever its content."""
    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    packed = _chunk(b"IDAT", zlib.compress(body))
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + packed + _chunk(b"IEND", b"")


def _same_drape(outcome: Outcome) -> bool:
    """Whether the drape coefficient is that of the plain file."""
    (cloth,) = outcome.document["cloths"]
    plain = np.mean([drape_coefficient(draw(toy_profile(7, sample, 1))) for sample in (1, 2, 3)])
    return cloth["unusable"] == 0 and abs(cloth["drape_coefficient"] - plain) < _COEFFICIENT


def _alpha(mode: str) -> Image.Image:
    image = Image.fromarray(GREY).convert(mode)
    image.putalpha(Image.new("L", image.size, 255))
    return image


def _palette() -> Image.Image:
    return Image.fromarray(GREY).convert("P", palette=Image.Palette.ADAPTIVE, colors=256)


def _animated(form: str) -> bytes:
    grey = Image.fromarray(GREY)
    return encoded(form, grey, save_all=True, append_images=[Image.fromarray(255 - GREY)])


_READ: dict[str, tuple[str, Callable[[], Image.Image], dict[str, object]]] = {
    "16 bit": ("png", lambda: Image.fromarray(GREY.astype(np.uint16) * 257), {}),
    "one bit": ("png", lambda: Image.fromarray(GREY > 127), {}),
    "palette": ("png", _palette, {}),
    "palette of two colours": ("png", lambda: Image.fromarray(GREY).convert("P", colors=2), {}),
    "grey with alpha": ("png", lambda: _alpha("LA"), {}),
    "colour with alpha": ("png", lambda: _alpha("RGBA"), {}),
    "colour": ("png", lambda: Image.fromarray(GREY).convert("RGB"), {}),
    "JPEG of CMYK": ("jpg", lambda: Image.fromarray(GREY).convert("CMYK"), {"quality": 95}),
    "progressive JPEG": ("jpg", lambda: Image.fromarray(GREY), {"progressive": True, "quality": 95}),
    "coarse JPEG": ("jpg", lambda: Image.fromarray(GREY), {"quality": 60}),
    "turned by its camera's note": ("jpg", lambda: Image.fromarray(GREY), {"exif": b"Exif\0\0MM\0*\0\0\0\x08\0\0"}),
    "BMP": ("bmp", lambda: Image.fromarray(GREY), {}),
    "TIFF": ("tif", lambda: Image.fromarray(GREY), {}),
    "TIFF of packed bits": ("tif", lambda: Image.fromarray(GREY), {"compression": "packbits"}),
    "TIFF with LZW": ("tiff", lambda: Image.fromarray(GREY), {"compression": "tiff_lzw"}),
    "suffix in capitals": ("PNG", lambda: Image.fromarray(GREY), {}),
    "interlaced PNG text": ("png", lambda: Image.fromarray(GREY), {"optimize": True, "dpi": (1, 1)}),
}


def _drawn(**changes: float) -> ndarray:
    return draw(wavy_profile(7, **changes))


def _two(image: ndarray) -> ndarray:
    image = image.copy()
    image[4:34, 4:34] = 1
    return image


def _ring() -> ndarray:
    rows, columns = np.indices((256, 256))
    radius = np.hypot(rows - 127.5, columns - 127.5)
    return ((radius > 40) & (radius < 90)).astype(float)


def _shapes() -> dict[str, tuple[ndarray, str]]:
    rows, columns = np.indices((256, 256))
    noise = np.random.default_rng(0).random((256, 256))
    half = (columns > 128).astype(float)
    return {
        "no cloth": (np.zeros((256, 256)), "shows no cloth"),
        "all cloth": (np.ones((256, 256)), "shows no background"),
        "all grey": (np.full((256, 256), 0.5), "no background|grey|no cloth"),
        "noise": (noise, "cloth|separate|grey"),
        "inverted": (1 - DRAPE, "corners are cloth"),
        "two pieces": (_two(DRAPE), "one cloth"),
        "half of the picture": (half, "border|reach|plate|edge|larger|beyond|corners"),
        "one pixel of cloth": (np.where((rows == 127) & (columns == 127), 1.0, 0.0), "plate"),
        "a disc of half the plate": ((np.hypot(rows - 127.5, columns - 127.5) < 32).astype(float), "plate"),
        "a ring without its plate": (_ring(), "hole|plate"),
        "far off centre": (np.roll(DRAPE, 40, axis=1), "plate|centre|border"),
        "far off centre in rows": (np.roll(DRAPE, -38, axis=0), "plate|centre|border"),
        "beyond the cloth's own size": (_drawn(mean=0.165), "beyond|larger|border|own|reach"),
        "a grey photograph": (np.clip(0.35 + 0.3 * noise + 0.2 * DRAPE, 0, 1), "grey|between|separate|cloth|dark"),
        "checkers": (((rows // 16 + columns // 16) % 2).astype(float), "cloth|separate|plate|border"),
    }


def _refused() -> dict[str, tuple[str, bytes, str]]:
    whole, photo = encoded("PNG"), encoded("JPEG", quality=95)
    bomb = png(256, 256, body=b"\0" * (64 << 20))
    deep = Image.fromarray(GREY.astype(np.int32) * 2**23)
    damaged = whole[:600] + bytes(byte ^ 0x55 for byte in whole[600:700]) + whole[700:]
    return {
        "empty file": ("png", b"", "cannot be decoded"),
        "text": ("png", b"this is no image\n", "cannot be decoded"),
        "zero bytes": ("jpg", bytes(4096), "cannot be decoded"),
        "signature alone": ("png", whole[:8], "cannot be decoded"),
        "header alone": ("png", whole[:33], "cannot be decoded"),
        "PNG cut short": ("png", whole[: len(whole) // 2], "cannot be decoded"),
        "PNG short of its end": ("png", whole[:-40], "cannot be decoded"),
        "PNG with damaged pixels": ("png", damaged, "cannot be decoded"),
        "JPEG cut short": ("jpg", photo[: len(photo) // 2], "cannot be decoded"),
        "JPEG without pixels": ("jpg", photo[:300], "cannot be decoded"),
        "BMP cut short": ("bmp", encoded("BMP")[:1000], "cannot be decoded"),
        "TIFF cut short": ("tif", encoded("TIFF")[:1000], "cannot be decoded"),
        "GIF": ("png", encoded("GIF"), "cannot be decoded"),
        "animated GIF": ("png", _animated("GIF"), "cannot be decoded"),
        "WebP": ("png", encoded("WEBP"), "cannot be decoded"),
        "PDF": ("png", b"%PDF-1.4\n1 0 obj\n<<>>\nendobj\n", "cannot be decoded"),
        "SVG": ("png", b"<svg xmlns='http://www.w3.org/2000/svg'/>", "cannot be decoded"),
        "gzipped PNG": ("png", gzip.compress(whole, mtime=0), "cannot be decoded"),
        "PNG of 30000 x 30000 pixels": ("png", png(30000, 30000), "exceeds limit|30000 x 30000"),
        "PNG of 2^31 pixels a side": ("png", png(2**31 - 1, 2**31 - 1), "pixels|decoded"),
        "PNG without a row": ("png", png(256, 0), "cannot be decoded|256 x 0"),
        "PNG with 64 MB for 64 kB": ("png", bomb, "cannot be decoded|shows no"),
        "PNG of 3 bits": ("png", png(256, 256, bits=3), "cannot be decoded"),
        "1 x 1 pixel": ("png", encoded("PNG", Image.new("L", (1, 1))), "must be 256 x 256 pixels, got 1 x 1"),
        "512 pixels": ("png", encoded("PNG", Image.fromarray(GREY).resize((512, 512))), "got 512 x 512"),
        "not square": ("png", encoded("PNG", Image.fromarray(GREY[:200])), "got 256 x 200"),
        "thin": ("png", encoded("PNG", Image.fromarray(GREY[:, :1])), "got 1 x 256"),
        "TIFF with transparency": ("tif", encoded("TIFF", _alpha("RGBA")), "with transparency"),
        "TIFF of two pages": ("tif", _animated("TIFF"), "pages|frames|pictures"),
        "animated PNG": ("png", _animated("PNG"), "frames|pictures|pages"),
        "TIFF of 32 bits": ("tif", encoded("TIFF", deep), "none is known to be white"),
    }


def _made(make: Callable[[Path, Path], None], here: Path, stock: Stock) -> None:
    path = place(here, stock)
    make(path, here)


def _loop(path: Path, here: Path) -> None:
    path.symlink_to(path)


def _link_out(path: Path, here: Path) -> None:
    (here / "elsewhere.png").write_bytes(encoded("PNG"))
    path.symlink_to(here / "elsewhere.png")


def _link_in(path: Path, here: Path) -> None:
    path.symlink_to(path.with_name("Fabric_7_Sample_2_Capture_1.png"))


def _sparse(path: Path, here: Path) -> None:
    with path.open("wb") as file:
        file.write(encoded("PNG"))
        file.truncate(4 << 30)


def _fifo(path: Path, here: Path) -> None:
    os.mkfifo(path)


def _folder(path: Path, here: Path) -> None:
    path.mkdir()


def _loop_of_folders(path: Path, here: Path) -> None:
    path.write_bytes(encoded("PNG"))
    (path.parent / "silhouettes").symlink_to(path.parent)


def _three(outcome: Outcome) -> bool:
    return outcome.document["silhouettes"] == 3


def _two_left(outcome: Outcome) -> bool:
    return outcome.document["silhouettes"] == 2


_AUDIT = "data audit {here}/lab --json"

CASES = [
    *(
        Case(f"{name}", STATS, partial(_save, make, suffix, options), right=_same_drape)
        for name, (suffix, make, options) in _READ.items()
    ),
    *(
        Case(name, RUN, partial(_coverage, image), refused=said, codes=(1, 2))
        for name, (image, said) in _shapes().items()
    ),
    *(
        Case(name, RUN, partial(_bytes, content, suffix), refused=said, codes=(1, 2))
        for name, (suffix, content, said) in _refused().items()
    ),
    Case("PNG that is named JPEG", STATS, partial(_bytes, encoded("PNG"), "jpg"), right=_same_drape),
    Case("JPEG that is named PNG", STATS, partial(_bytes, encoded("JPEG", quality=95), "png"), right=_same_drape),
    Case("text after the image", STATS, partial(_bytes, encoded("PNG") + b"<script>", "png"), right=_same_drape),
    Case("link to itself", _AUDIT, partial(_made, _loop), right=_two_left),
    Case("link out of the folder", _AUDIT, partial(_made, _link_out), right=_two_left),
    Case("link to another sample", _AUDIT, partial(_made, _link_in), right=_three),
    Case(
        "4 GB of nothing after the image",
        RUN,
        partial(_made, _sparse),
        refused="far more than any silhouette",
        codes=(1, 2),
    ),
    Case("pipe for an image", _AUDIT, partial(_made, _fifo), right=_two_left),
    Case("folder named as an image", _AUDIT, partial(_made, _folder), right=_two_left),
    Case("folder linked into itself", _AUDIT, partial(_made, _loop_of_folders), right=_three),
]
