"""Reads photographs safely: Pillow reads the header and turns the picture to the orientation that it states."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped, UInt8
from numpy import ndarray
from PIL import ExifTags, Image, ImageOps

from cusick_bench.files.silence import without_warnings
from cusick_bench.photographs.errors import BadPhotograph

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
UNREAD_SUFFIXES = (
    ".heic", ".heif", ".hif", ".avif", ".jxl", ".jp2", ".jfif", ".gif",
    ".jpe", ".tga", ".pbm", ".pgm", ".ppm", ".psd",
    ".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw",
)  # fmt: skip
"""Pictures of phones, cameras and programs that are not read."""
_FORMATS = ("JPEG", "PNG", "TIFF", "BMP", "WEBP")
_DEEP = ("I", "F")  # beginnings of Pillow's modes of 16 and 32 bits
_MOST_PIXELS = 120_000_000
_LEAST_SIDE = 240  # [px]
_SAME_SHAPE = 0.01  # largest difference of the sides' ratio of a picture that was scaled and not cropped
_FULL_FRAME = math.hypot(36, 24)  # [mm] diagonal of the film that "35 mm equivalent" refers to


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture.

    Attributes:
        levels: Levels 0 to 255, blue first.
        focal: Focal length that its header tells [px], None if it tells none.
        turn: How its header says that it is to be turned and mirrored, 1 to 8 as Exif has it; 1 if it says nothing.
    """

    levels: UInt8[ndarray, "height width 3"]
    focal: float | None
    turn: int = 1

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.levels.shape[1], self.levels.shape[0]


def read_photograph(path: Path) -> Photograph:
    """Reads a photograph.

    Args:
        path: JPEG, PNG, TIFF, BMP or WebP file.

    Returns:
        The picture, upright.

    Raises:
        BadPhotograph: Missing, unreadable, of more than 8 bits a pixel, too small or too large.
    """
    try:
        with without_warnings(), Image.open(path, formats=_FORMATS) as image:
            if image.width * image.height > _MOST_PIXELS:
                raise _bad(path, f"has {image.width} x {image.height} px, at most {_MOST_PIXELS // 10**6} million")
            if min(image.size) < _LEAST_SIDE:
                raise _bad(path, f"has {image.width} x {image.height} px, at least {_LEAST_SIDE} a side are needed")
            if image.mode.startswith(_DEEP):  # which Pillow would cut off at 255
                raise BadPhotograph(
                    "has more than 8 bits a pixel", where=path, remedy="save it with 8 bits a channel",
                    kind="unreadable-photograph",
                )  # fmt: skip
            focal, turn = _focal(image), _turn(image)
            upright = ImageOps.exif_transpose(image).convert("RGB")
    except (BadPhotograph, MemoryError):
        raise
    except PermissionError as error:
        raise BadPhotograph("may not be read", where=path, remedy="change its mode", kind="no-permission") from error
    except Image.DecompressionBombError as error:
        raise _bad(path, f"has more than {_MOST_PIXELS // 10**6} million px") from error
    except Exception as error:  # decoders raise anything on damaged or hostile files
        raise _bad(path, "cannot be read as a picture") from error
    return Photograph(np.ascontiguousarray(np.asarray(upright)[:, :, ::-1]), focal, turn)


def linear_light(levels: Shaped[ndarray, "*places"]) -> Float[ndarray, "*places"]:
    """Undoes the curve of sRGB, so that a pixel half covered by cloth has half of the cloth's light.

    Args:
        levels: Levels 0 to 255; whole, or interpolated between pixels.

    Returns:
        Light, 0 to 1.
    """
    share = np.asarray(levels, np.float32) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4).astype(np.float32)


def focal_in_pixels(film: float, size: tuple[int, int]) -> float:
    """Focal length of a picture whose header tells the 35 mm equivalent.

    Args:
        film: Focal length of a camera for 35 mm film that sees as much along the diagonal [mm].
        size: Width and height of the picture [px].

    Returns:
        Focal length [px].
    """
    return film / _FULL_FRAME * math.hypot(*size)


def _focal(image: Image.Image) -> float | None:
    """Focal length from the 35 mm equivalent in the header [px]."""
    try:
        header = image.getexif().get_ifd(ExifTags.IFD.Exif)
        value = float(header.get(ExifTags.Base.FocalLengthIn35mmFilm, 0))
        taken = [float(header.get(side, 0)) for side in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)]
    except Exception:  # a damaged header, of which decoders raise anything, tells no focal length
        return None
    if min(taken) > 0 and abs(max(taken) / min(taken) * min(image.size) / max(image.size) - 1) > _SAME_SHAPE:
        return None  # it was cropped: the focal length is that of the whole picture's diagonal
    return focal_in_pixels(value, image.size) if 5 <= value <= 1000 else None


def _turn(image: Image.Image) -> int:
    """Orientation that the header tells."""
    try:
        value = int(image.getexif().get(ExifTags.Base.Orientation, 1))
    except Exception:  # as in `_focal`
        return 1
    return value if 1 <= value <= 8 else 1


def _bad(path: Path, what: str) -> BadPhotograph:
    return BadPhotograph(what, where=path, remedy="take it again, or remove it", kind="unreadable-photograph")
