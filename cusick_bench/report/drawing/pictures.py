"""Small pictures as PNG bytes: silhouettes, their signed difference, the drape in three dimensions.

Backgrounds are transparent, so the pictures sit on light and dark pages alike. In a difference, blue is cloth that only
the simulation has, orange cloth that only the real drape has, grey what both have: a pair that colour-blind readers
can tell apart.
"""

import io

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray
from PIL import Image

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.report.drawing.drape_view import View, cloth_colour, render_drape

CLOTH = (110, 116, 128)
ONLY_SIMULATED = (40, 124, 220)
ONLY_REAL = (235, 115, 25)


def silhouette_picture(image: Float[ndarray, "height width"]) -> UInt8[ndarray, "height width 4"]:
    """A silhouette in grey, as opaque as the cloth covers a pixel.

    Args:
        image: The silhouette, cloth = 1.

    Returns:
        RGBA picture.
    """
    return _layer(CLOTH, image)


def difference_picture(
    simulated: Float[ndarray, "height width"], real: Float[ndarray, "height width"]
) -> UInt8[ndarray, "height width 4"]:
    """Signed difference of two silhouettes: blue only simulated, orange only real, pale grey both.

    Args:
        simulated: The simulated silhouette, cloth = 1.
        real: The real one.

    Returns:
        RGBA picture.
    """
    picture = _layer(CLOTH, 0.35 * np.minimum(simulated, real))
    difference = simulated - real
    for colour, part in ((ONLY_SIMULATED, difference), (ONLY_REAL, -difference)):
        stronger = part > 0.04  # below it is the noise of image compression
        picture[stronger] = _layer(colour, part)[stronger]
    return picture


def drape_picture(
    vertices: Float[ndarray, "vertices 3"],
    faces: Int[ndarray, "faces 3"],
    cloth: str,
    view: View | None = None,
    protocol: Protocol = RELEASE,
) -> UInt8[ndarray, "height width 4"]:
    """The drape from the side, in a colour that suits the cloth's name.

    Args:
        vertices: Positions [m].
        faces: Vertex indices of each triangle.
        cloth: Name of the cloth.
        view: Where it is seen from.
        protocol: Gives radii of plate and cloth; a cloth of any size is drawn as large as the release's.

    Returns:
        RGBA picture.
    """
    scale = protocol.cloth_scale
    plate = protocol.plate_radius_m / scale
    return render_drape(np.asarray(vertices) / scale, faces, cloth_colour(cloth), view, plate_radius=plate)


def contact_sheet(images: Float[ndarray, "draws height width"], columns: int = 3) -> UInt8[ndarray, "rows columns 4"]:
    """Silhouettes at half size, side by side; the last row or column of an odd number is left out.

    Args:
        images: The silhouettes, cloth = 1.
        columns: How many stand in a row.

    Returns:
        RGBA picture.
    """
    count, height, width = images.shape
    even = images[:, : height // 2 * 2, : width // 2 * 2]
    halves = even.reshape(count, height // 2, 2, width // 2, 2).mean((2, 4))
    filled = np.concatenate([halves, np.zeros((-count % columns, *halves.shape[1:]))])
    rows = [np.concatenate(list(filled[at : at + columns]), axis=1) for at in range(0, len(filled), columns)]
    return silhouette_picture(np.concatenate(rows))


def png(picture: UInt8[ndarray, "height width 4"]) -> bytes:
    """A picture as a file.

    Args:
        picture: RGBA picture.

    Returns:
        Bytes of the PNG file.
    """
    buffer = io.BytesIO()
    Image.fromarray(picture, "RGBA").save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _layer(colour: tuple[int, int, int], opacity: ndarray) -> ndarray:
    picture = np.zeros((*opacity.shape, 4), dtype=np.uint8)
    picture[..., :3] = colour
    picture[..., 3] = np.round(255 * np.clip(opacity, 0, 1))
    return picture
