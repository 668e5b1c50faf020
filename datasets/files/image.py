"""Reads a silhouette safely and checks that it shows one cloth on a plate.

Pillow reads the header, OpenCV the pixels: OpenCV does not report an image's size before it has decoded it, and a file
of some hundred bytes may claim enough pixels to fill the memory. For the 450 JPEG files of the public release both give
the same pixels.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from PIL import ExifTags, Image

from cusick_bench.datasets.errors import BadImage
from cusick_bench.datasets.files.protocol import MAXIMUM_SIZE, Protocol
from cusick_bench.files.silence import without_warnings
from cusick_bench.sim.constants import IMAGE_SIZE

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")
UNREAD_SUFFIXES = (".webp", ".gif", ".heic", ".heif", ".avif", ".jfif", ".jp2", ".jxl", ".tga", ".pbm", ".pgm", ".ppm")
"""Pictures in formats that are not read."""
_FORMATS = ("JPEG", "PNG", "BMP", "TIFF")
_MODES = ("1", "L", "P", "LA", "RGB", "RGBA", "CMYK", "I", "I;16", "I;16B", "F", "YCbCr")
_TRANSPARENT = {("PNG", "LA"), ("PNG", "P"), ("PNG", "RGB"), ("PNG", "RGBA")}  # elsewhere OpenCV loses transparency
_MAXIMUM_BYTES = 64 << 20  # as much as is hashed; colours of the largest size have 48 MiB without compression
_MAXIMUM_PIXELS = MAXIMUM_SIZE**2  # checked before decoding
_SECOND_BLOB = 0.005  # a second object above this share of the cloth's area makes the image ambiguous
_COLOUR_STEP = 24  # grey levels by which channels may differ (JPEG colour rounding)
_FULL_SCALES = (1.0, 255.0, 65535.0)  # levels of white that are in use; the first of floating-point images only
_OVERSHOOT = 1.5  # times full scale: more than levels reach beyond white where an image was scaled with a sharp filter
_FAINT = 25.5  # levels: a tenth of full scale
_OUTLINE = 4.0  # [px of a 256 px image] of grey on either side of an outline are no fault
_NEXT = np.ones((3, 3), dtype=np.uint8)  # a pixel and those next to it
_PLATE_TOLERANCE = 0.95  # share of the plate's radius that a silhouette must hold


def read_silhouette(path: Path, protocol: Protocol | None = None) -> Float[ndarray, "size size"]:
    """Reads a silhouette: coverage 1 - grey/255 where the cloth is dark.

    Args:
        path: Image file.
        protocol: Gives the size and which part is the cloth; the public release's by default.

    Returns:
        Coverage in [0, 1], cloth = 1.

    Raises:
        BadImage: Unreadable, of another size, without cloth or without background, inverted, or with a second
            object beside the cloth. Nothing larger than a silhouette is decoded.
    """
    return inspect(path, protocol or Protocol())[0]


def inspect(path: Path, protocol: Protocol) -> tuple[Float[ndarray, "size size"], bool]:
    """Reads a silhouette and looks at its colours.

    Args:
        path: Image file.
        protocol: Gives the size and which part is the cloth.

    Returns:
        What `read_silhouette` gives; and whether the channels differ by more than compression explains.
    """
    levels = _decode(path, protocol)
    image = coverage(levels, protocol.foreground)
    _check(image, levels, path)
    return image, levels.ndim == 3 and int(np.ptp(levels.astype(int), axis=2).max()) > _COLOUR_STEP


def coverage(levels: ndarray, foreground: str) -> Float[ndarray, "height width"]:
    """Coverage of the cloth from grey levels or colours.

    Args:
        levels: Levels 0 to 255: (height, width), or (height, width, 3) with red first.
        foreground: "dark" or "light": which part of the image is the cloth.

    Returns:
        Coverage in [0, 1], cloth = 1.
    """
    grey = levels if levels.ndim == 2 else levels @ np.array([0.299, 0.587, 0.114])
    share = np.clip(grey / 255.0, 0.0, 1.0)
    return 1.0 - share if foreground == "dark" else share


def without_specks(image: Float[ndarray, "size size"]) -> Float[ndarray, "size size"]:
    """Takes what does not hang together with the cloth, such as dust, for background.

    Where the outermost radius is looked for, a speck of two millimetres beside the cloth is a fold. Objects that are
    too large for a speck are refused where a silhouette is read.

    Args:
        image: Coverage, cloth = 1.

    Returns:
        The same without specks and their blurred edges; the image itself where there are none.
    """
    count, parts, properties, _ = cv2.connectedComponentsWithStats((image >= 0.5).astype(np.uint8), connectivity=8)
    if count <= 2:  # background and cloth
        return image
    cloth = parts == 1 + int(properties[1:, cv2.CC_STAT_AREA].argmax())
    specks, near_cloth = (cv2.dilate(part.astype(np.uint8), _NEXT) > 0 for part in ((parts > 0) & ~cloth, cloth))
    return np.where(specks & ~near_cloth, 0.0, image)


def _bad(path: Path, kind: str, what: str, remedy: str) -> BadImage:
    return BadImage(what, where=path, remedy=remedy, kind=kind)


def _decode(path: Path, protocol: Protocol) -> ndarray:
    """Grey levels 0..255 (size, size), or three channels, red first, if they differ."""
    size, replace = protocol.image_size_px, "replace it by the original image or remove it"
    try:
        content = _content(path, size, replace)
        with _silent_opencv():
            levels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except BadImage:
        raise
    except PermissionError as error:
        raise _bad(path, "no-permission", "may not be read", "change its mode") from error
    except Image.DecompressionBombError as error:
        raise _bad(path, "image-too-large", str(error), replace) from error
    except Exception as error:  # decoders raise anything on damaged or hostile files
        raise _bad(path, "unreadable-image", f"cannot be decoded ({error})", replace) from error
    if levels is None or levels.shape[:2] != (size, size):
        raise _bad(path, "unreadable-image", "cannot be decoded (damaged or cut short)", replace)
    if not np.isfinite(levels).all():  # such as ImageJ's background of NaN
        raise _bad(path, "unreadable-image", "holds levels that are no numbers", "save it as a grey or RGB image")
    if (most := float(levels.max())) > _OVERSHOOT * _FULL_SCALES[-1]:
        what = f"holds levels up to {most:.0f}, of which none is known to be white"
        raise _bad(path, "unreadable-image", what, "save it as a grey or RGB image of 8 or 16 bits")
    return _levels(levels, 255.0 if protocol.foreground == "dark" else 0.0)


def _content(path: Path, size: int, replace: str) -> bytes:
    """The file, once its header promises a small image of a known kind; nothing has been decoded so far."""
    length = path.stat().st_size
    if length > _MAXIMUM_BYTES:
        raise _bad(path, "image-too-large", f"has {length} bytes; at most {_MAXIMUM_BYTES} are read", "save it as PNG")
    with without_warnings(), Image.open(path, formats=_FORMATS) as image:
        width, height = image.size
        mode, transparent = image.mode, "A" in image.getbands() or "transparency" in image.info
        form = str(image.format)
        pictures = int(getattr(image, "n_frames", 1)) if form in ("PNG", "TIFF") else 1
        turn = image.getexif().get(ExifTags.Base.Orientation, 1) if form == "TIFF" else 1  # OpenCV turns TIFF alone
    if width * height > _MAXIMUM_PIXELS:
        raise _bad(path, "image-too-large", f"{width} x {height} pixels are no silhouette", replace)
    if pictures > 1:
        raise _bad(path, "unreadable-image", f"holds {pictures} pictures, not one", "save the silhouette alone")
    if turn in range(2, 9):
        raise _bad(
            path, "unreadable-image", f"is to be turned or mirrored, by its header (orientation {turn})",
            "turn the pixels themselves, or save it as PNG",
        )  # fmt: skip
    if (width, height) != (size, size):
        raise _bad(
            path,
            "image-size",
            f"image must be {size} x {size} pixels, got {width} x {height}",
            f"scale the image to {size} x {size}, the size that px_per_m is for, or set image_size_px, px_per_m and "
            "centre_px in protocol.json"
            if width == height
            else f"crop or pad the image to a square, then scale it to {size} x {size}",
        )
    if mode not in _MODES or (transparent and (form, mode) not in _TRANSPARENT):
        kind = f"{form} of mode {mode}" + (" with transparency" if transparent else "")
        raise _bad(path, "unreadable-image", f"cannot be decoded ({kind})", "save it as a grey or RGB image")
    return path.read_bytes()


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keeps OpenCV's log of damaged files off the terminal: the error that is raised says all."""
    silent = cv2.utils.logging.LOG_LEVEL_SILENT
    level = cv2.utils.logging.setLogLevel(silent)
    try:
        yield
    finally:
        if level != silent:  # else another thread reads an image too, and sets the level back itself
            cv2.utils.logging.setLogLevel(level)


def _levels(decoded: ndarray, paper: float) -> ndarray:
    """Grey levels 0..255, or three channels, red first, if they differ; `paper` is that of what is transparent."""
    levels = decoded
    if decoded.dtype != np.uint8:  # 16 bit or more: the levels themselves tell what white is
        levels = decoded.astype(np.float64)
        scales = _FULL_SCALES if decoded.dtype.kind == "f" else _FULL_SCALES[1:]
        white = next(scale for scale in scales if levels.max() <= _OVERSHOOT * scale)
        levels = np.clip(levels * (255.0 / white), 0.0, 255.0)
    if levels.ndim == 2:
        return levels
    if levels.shape[2] == 4:
        opacity = levels[..., 3:] / 255.0
        levels = np.round(opacity * levels[..., :3] + (1.0 - opacity) * paper)
    same = (levels == levels[..., :1]).all()
    return levels[..., 0] if same else levels[..., ::-1]  # OpenCV's order is blue, green, red


def _check(image: ndarray, levels: ndarray, path: Path) -> None:
    cloth = image >= 0.5
    corners = cloth[[0, 0, -1, -1], [0, -1, 0, -1]]
    if not cloth.any():
        raise _uniform(path, "empty-image", "shows no cloth, all is background", levels)
    if cloth.all():
        raise _uniform(path, "full-image", "shows no background, all is cloth", levels)
    areas = _areas(cloth)
    if len(areas) > 1 and areas[1] > _SECOND_BLOB * areas[0]:
        raise _bad(
            path,
            "two-blobs",
            f"must show one cloth, found {len(areas)} separate objects of {areas[0]} and {areas[1]} pixels",
            "erase what is not the cloth",
        )
    if corners.all():  # not of a frame around the cloth, which is a second object
        raise _bad(
            path, "inverted-image", "all four corners are cloth", 'set "foreground" in protocol.json, or invert it'
        )


def _uniform(path: Path, kind: str, what: str, levels: ndarray) -> BadImage:
    """An image of one kind all over; a mask of 0 and 1 is one, and is told so."""
    most = float(levels.max())
    if float(levels.min()) < most < _FAINT:
        return _bad(path, kind, f"{what}: levels reach only {most:.0f} of 255", "save the mask as 0 and 255")
    return _bad(path, kind, what, "take the image again or remove it")


def _areas(mask: Bool[ndarray, "height width"]) -> list[int]:
    """Sizes [px] of the parts that are connected along rows and columns, largest first."""
    _, _, properties, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    return sorted(properties[1:, cv2.CC_STAT_AREA].tolist(), reverse=True)  # the first part is the background


@dataclass(frozen=True)
class PlateFit:
    """Fit of the plate, which lies under the cloth, into a silhouette.

    Attributes:
        fault: "", "off-centre" or "shrunken-image".
        shift: Columns and rows [px] by which the image must be moved to be centred.
        inscribed: Radius of the largest circle inside the silhouette, at most looked for up to the plate's [px].
    """

    fault: str
    shift: tuple[float, float]
    inscribed: float


def fit_plate(image: Float[ndarray, "size size"], protocol: Protocol) -> PlateFit:
    """Tells a shifted silhouette from a shrunken one: the cloth always covers the plate.

    If the plate's circle does not fit where it should be, it may fit elsewhere (the image is off-centre) or nowhere
    (the image has another scale).

    Args:
        image: Coverage, cloth = 1.
        protocol: Gives the scale and where the plate should be.

    Returns:
        Where the plate fits, and what is wrong with the image.
    """
    plate = protocol.plate_radius_m * protocol.px_per_m
    column, row = protocol.centre_px
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    inside = np.hypot(columns - column, rows - row) < _PLATE_TOLERANCE * plate
    if (image >= 0.5)[inside].all():
        return PlateFit("", (0.0, 0.0), plate)
    depth = cv2.distanceTransform((image >= 0.5).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    deepest = np.unravel_index(int(depth.argmax()), depth.shape)
    if depth.max() < _PLATE_TOLERANCE * plate:
        return PlateFit("shrunken-image", (0.0, 0.0), float(depth.max()))
    return PlateFit("off-centre", (column - float(deepest[1]), row - float(deepest[0])), float(depth.max()))


@dataclass(frozen=True)
class Blemishes:
    """Measures of further irregularities of a silhouette.

    Attributes:
        cloth: Size of the cloth [px].
        specks, largest_speck: Separate objects beside the cloth, and the largest's size [px].
        holes, largest_hole: Patches of background in the cloth, and the largest's size [px].
        touches_border: Whether the cloth reaches the image's border.
        grey: By how much pixels away from the outline are neither cloth nor background, in all, as a share of the
            cloth's size: 0 for a silhouette, about as large as the error of its drape coefficient.
        centroid: Column and row of the middle of the cloth [px].
    """

    cloth: int
    specks: int
    largest_speck: int
    holes: int
    largest_hole: int
    touches_border: bool
    grey: float
    centroid: tuple[float, float]


def blemishes(image: Float[ndarray, "size size"]) -> Blemishes:
    """Looks for small objects, holes, a cut cloth and grey parts.

    Args:
        image: Coverage, cloth = 1.

    Returns:
        Their number and sizes.
    """
    cloth, whole = image >= 0.5, without_specks(image) >= 0.5
    objects, gaps = _areas(cloth), _areas(~cloth)
    border = bool(whole[[0, -1]].any() or whole[:, [0, -1]].any())
    largest = [parts[1] if len(parts) > 1 else 0 for parts in (objects, gaps)]
    size, rows, columns = int(cloth.sum()), cloth.sum(axis=1), cloth.sum(axis=0)
    centroid = tuple(float(counts @ np.arange(len(counts))) / size for counts in (columns, rows))
    return Blemishes(
        size,
        len(objects) - 1,
        largest[0],
        len(gaps) - 1,
        largest[1],
        border,
        float(np.abs(image - cloth)[_away_from_the_outline(cloth)].sum()) / size,
        (centroid[0], centroid[1]),
    )


def _away_from_the_outline(cloth: Bool[ndarray, "size size"]) -> Bool[ndarray, "size size"]:
    """Pixels so far from the outline that smoothing, compression or a little blur cannot reach them."""
    within, beyond = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for part in (cloth, ~cloth)
    )
    return np.maximum(within, beyond) > max(_OUTLINE, _OUTLINE * len(cloth) / IMAGE_SIZE)
