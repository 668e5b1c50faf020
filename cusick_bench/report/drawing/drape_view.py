"""A small software renderer for draped cloth: depth buffer, smooth normals, soft self-shadow, no dependencies.

A mesh is drawn in perspective from the side, lit by one key light and the sky, with the pedestal below it and its
shadow on the ground. The background is transparent, so a picture sits on a light and on a dark page.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.kernel_cache import numba

SUPERSAMPLING = 2
_GAMMA = 2.2
_PEDESTAL_HEIGHT = 0.095  # [m], a little more than the longest drop of the rim
SHADOW_SIZE = 900  # [px] of the light's depth map
_SHADOW_BIAS = 0.0025  # [m]
_SHADOW_REACH = 0.22  # [m], radius on the ground at which its shadow has faded, still within the picture
_LIGHT = np.array([-0.62, -0.28, 0.85])  # towards the key light
_NEEDLE = 20  # longest over shortest edge from which a face is shaded flat
_PEDESTAL = (0.62, 0.63, 0.65)
# Cloth colours (sRGB) by the words of a cloth's name; the first that occurs is taken.
_COLOURS = {
    "blue": (0.40, 0.54, 0.76),
    "pink": (0.90, 0.64, 0.72),
    "red": (0.76, 0.30, 0.27),
    "white": (0.88, 0.87, 0.84),
}
_NEUTRAL = (0.72, 0.64, 0.50)


@dataclass(frozen=True)
class View:
    """Where the picture is taken from.

    Attributes:
        azimuth: Direction of the eye about z, counter-clockwise from +x [deg].
        elevation: Height of the eye above the plate's plane [deg].
        distance: From the point looked at [m].
        width: Width of the picture [px].
        height: Height of the picture [px].
        fov: Vertical field of view [deg].
        target: Height of the point looked at [m].
    """

    azimuth: float = -70.0
    elevation: float = 30.0
    distance: float = 0.84
    width: int = 640
    height: int = 420
    fov: float = 18.5
    target: float = -0.047


def cloth_colour(name: str) -> tuple[float, float, float]:
    """A colour for a cloth.

    Args:
        name: Name of the cloth, such as "cotton_blue".

    Returns:
        sRGB in [0, 1]; sand where the name has no colour in it.
    """
    return next((colour for word, colour in _COLOURS.items() if word in name.lower()), _NEUTRAL)


def render_drape(
    vertices: Float[ndarray, "vertices 3"],
    faces: Int[ndarray, "faces 3"],
    colour: tuple[float, float, float] = _NEUTRAL,
    view: View | None = None,
    stand: tuple[Float[ndarray, "points 3"], Int[ndarray, "triangles 3"]] | None = None,
    plate_radius: float = PLATE_RADIUS,
) -> UInt8[ndarray, "height width 4"]:
    """Draws a drape from the side.

    Args:
        vertices: Positions [m], plate in the plane z = 0.
        faces: Vertex indices of each triangle.
        colour: Colour of the cloth, sRGB in [0, 1].
        view: Where from.
        stand: Positions [m] and triangles of what the cloth lies on; the plate's pedestal by default.
        plate_radius: Radius of the plate on that pedestal [m].

    Returns:
        RGBA picture; where there is neither cloth nor shadow it is transparent.
    """
    view = view or View()
    cloth = _Part(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64), colour)
    parts = [cloth, _pedestal(plate_radius - 0.004) if stand is None else _Part(*stand, _PEDESTAL)]
    shadow = _ShadowMap.of(parts)
    canvas = _shade(parts, shadow, view)
    size = SUPERSAMPLING
    canvas = canvas.reshape(view.height, size, view.width, size, 4).mean((1, 3))
    colours = canvas[..., :3] / np.maximum(canvas[..., 3:], 1e-9)
    encoded = np.clip(colours, 0, 1) ** (1 / _GAMMA)
    return np.round(255 * np.concatenate([encoded, canvas[..., 3:]], axis=-1)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Part:
    vertices: ndarray
    faces: ndarray
    colour: tuple[float, float, float]

    @cached_property
    def face_normals(self) -> ndarray:
        """Normals of the faces, as long as twice their areas."""
        corner = self.vertices[self.faces]
        return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])

    @cached_property
    def normals(self) -> ndarray:
        """Area-weighted vertex normals."""
        normals = np.zeros_like(self.vertices)
        for side in range(3):
            np.add.at(normals, self.faces[:, side], self.face_normals)
        return _unit(normals)

    @cached_property
    def needles(self) -> ndarray:
        """Which faces are so long that a crease at one end would round off all of them, as in a fan over the plate."""
        corner = self.vertices[self.faces]
        edges = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
        return edges.max(1) > _NEEDLE * edges.min(1)

    def shading(self, faces: ndarray, share: ndarray) -> ndarray:
        """Normals to be lit by, at points of faces given by their weights of the corners."""
        smooth = _unit(np.einsum("pk,pkd->pd", share, self.normals[self.faces[faces]]))
        return np.where(self.needles[faces, None], _unit(self.face_normals[faces]), smooth)


def _pedestal(radius: float, sides: int = 96) -> _Part:
    """The stand under the plate, a shade thinner than the plate so that it never shows through the cloth."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    top, bottom = np.full((sides, 1), -0.004), np.full((sides, 1), -_PEDESTAL_HEIGHT)
    vertices = np.vstack([np.hstack([ring, top]), np.hstack([ring, bottom])])
    here, following = np.arange(sides), (np.arange(sides) + 1) % sides
    wall = np.vstack(
        [
            np.column_stack([here, here + sides, following]),
            np.column_stack([following, here + sides, following + sides]),
        ]
    )
    return _Part(vertices, wall, _PEDESTAL)


def _unit(vectors: ndarray) -> ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _frame(forward: ndarray) -> ndarray:
    """Rows: right, up, forward."""
    forward = _unit(forward)
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    return np.stack([right, np.cross(right, forward), forward])


@numba.njit(cache=True)
def _rasterise(points, faces, width, height):
    """Nearest face in each pixel, its barycentric coordinates, and 1/depth; `points` are (column, row, 1/depth).

    1/depth is linear on the screen in perspective. A parallel view gives any value that falls linearly with depth.
    """
    nearest = np.full((height, width), -np.inf)
    owner = np.full((height, width), -1, dtype=np.int64)
    weights = np.zeros((height, width, 3))
    for face in range(len(faces)):
        a, b, c = points[faces[face, 0]], points[faces[face, 1]], points[faces[face, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-12:
            continue
        left, right = max(0, int(np.ceil(min(a[0], b[0], c[0])))), min(width - 1, int(max(a[0], b[0], c[0])))
        low, high = max(0, int(np.ceil(min(a[1], b[1], c[1])))), min(height - 1, int(max(a[1], b[1], c[1])))
        for row in range(low, high + 1):
            for column in range(left, right + 1):
                u = ((b[0] - column) * (c[1] - row) - (b[1] - row) * (c[0] - column)) / area
                v = ((c[0] - column) * (a[1] - row) - (c[1] - row) * (a[0] - column)) / area
                w = 1.0 - u - v
                if min(u, v, w) < -1e-9:  # or rounding would leave holes where edges and corners meet
                    continue
                closeness = u * a[2] + v * b[2] + w * c[2]
                if closeness > nearest[row, column]:
                    nearest[row, column] = closeness
                    owner[row, column] = face
                    weights[row, column, 0], weights[row, column, 1], weights[row, column, 2] = u, v, w
    return owner, weights, nearest


@dataclass(frozen=True, eq=False)
class _ShadowMap:
    """How near to the light the first surface lies, in a parallel view along the light."""

    frame: ndarray
    scale: float
    closeness: ndarray

    @classmethod
    def of(cls, parts: list[_Part]) -> "_ShadowMap":
        frame = _frame(-_LIGHT)
        reach = max(float(np.linalg.norm(part.vertices, axis=1).max()) for part in parts)
        scale = SHADOW_SIZE / (2.2 * reach)
        maps = []
        for part in parts:
            points = part.vertices @ frame.T
            screen = np.column_stack([scale * points[:, :2] + SHADOW_SIZE / 2, -points[:, 2]])
            maps.append(_rasterise(screen, part.faces, SHADOW_SIZE, SHADOW_SIZE)[2])
        return cls(frame, scale, np.maximum.reduce(maps))

    def light(self, positions: ndarray, reach: int = 1) -> ndarray:
        """Share of the (2 reach + 1)^2 nearest pixels of the map that let the light through to each position."""
        points = positions @ self.frame.T
        column, row = (np.round(self.scale * points[:, axis] + SHADOW_SIZE / 2).astype(int) for axis in (0, 1))
        lit = np.zeros(len(positions))
        steps = range(-reach, reach + 1)
        for i in steps:
            rows = np.clip(row + 2 * i, 0, SHADOW_SIZE - 1)
            for j in steps:
                columns = np.clip(column + 2 * j, 0, SHADOW_SIZE - 1)
                lit += self.closeness[rows, columns] <= _SHADOW_BIAS * (1 + reach) - points[:, 2]
        return lit / len(steps) ** 2


def _shade(parts: list[_Part], shadow: _ShadowMap, view: View) -> ndarray:
    """Premultiplied linear RGBA at the supersampled size."""
    azimuth, elevation = np.radians(view.azimuth), np.radians(view.elevation)
    ray = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    eye = np.array([0.0, 0.0, view.target]) + view.distance * ray
    frame = _frame(-ray)
    width, height = view.width * SUPERSAMPLING, view.height * SUPERSAMPLING
    focal = height / 2 / np.tan(np.radians(view.fov) / 2)
    canvas = _ground(shadow, eye, frame, focal, width, height)
    nearest = np.full((height, width), -np.inf)
    for part in parts:
        points = (part.vertices - eye) @ frame.T
        screen = np.column_stack(
            [
                focal * points[:, 0] / points[:, 2] + width / 2,
                -focal * points[:, 1] / points[:, 2] + height / 2,
                1 / points[:, 2],
            ]
        )
        owner, weights, closeness = _rasterise(screen, part.faces, width, height)
        seen = closeness > nearest
        nearest = np.maximum(nearest, closeness)
        corners = part.faces[owner[seen]]
        # Linear weights on the screen become linear weights on the face.
        share = weights[seen] * screen[corners, 2]
        share /= share.sum(1, keepdims=True)
        position = np.einsum("pk,pkd->pd", share, part.vertices[corners])
        normal = part.shading(owner[seen], share)
        upper = np.einsum("pd,pd->p", part.face_normals[owner[seen]], eye - position) > 0
        canvas[seen, :3] = _light(
            position, np.where(upper[:, None], normal, -normal), upper, np.array(part.colour) ** _GAMMA, eye, shadow
        )
        canvas[seen, 3] = 1.0
    return canvas


def _light(
    position: ndarray, normal: ndarray, upper: ndarray, colour: ndarray, eye: ndarray, shadow: _ShadowMap
) -> ndarray:
    """Key light with shadow, sky from above, a faint fill, and the sheen of fibres at grazing angles."""
    facing = np.clip(np.einsum("pd,pd->p", normal, _unit(eye - position)), 0, 1)
    key = np.clip(normal @ _unit(_LIGHT), 0, 1) * shadow.light(position + 0.002 * normal)
    sky = 0.5 + 0.5 * normal[:, 2]
    fill = np.clip(normal @ _unit(np.array([0.8, -0.5, 0.1])), 0, 1)
    # Deep in a fold less of the sky is seen; the height below the plate is a fair stand-in.
    open_sky = np.clip(1 + position[:, 2] / 0.09, 0.35, 1)
    sheen = 0.05 * (1 - facing) ** 3
    inside = np.where(upper, 1.0, 0.6)
    light = 1.05 * key + (0.30 * sky + 0.05) * open_sky + 0.08 * fill
    return (inside * light)[:, None] * colour + (sheen * open_sky)[:, None]


def _ground(shadow: _ShadowMap, eye: ndarray, frame: ndarray, focal: float, width: int, height: int) -> ndarray:
    """Nothing but the shadow on the ground: black, as opaque as the light is blocked."""
    row, column = np.mgrid[:height:2, :width:2]  # it is blurred anyway
    screen = np.stack([(column - width / 2) / focal, (height / 2 - row) / focal, np.ones(row.shape)], -1)
    rays = screen @ frame
    along = (-_PEDESTAL_HEIGHT - eye[2]) / np.minimum(rays[..., 2], -1e-6)
    position = eye + along[..., None] * rays
    near = np.hypot(position[..., 0], position[..., 1]) < _SHADOW_REACH
    dark = np.zeros(row.shape)
    dark[near] = 1 - shadow.light(position[near], 0)
    fading = np.clip(2 - 2 * np.hypot(position[..., 0], position[..., 1]) / _SHADOW_REACH, 0, 1)
    canvas = np.zeros((height, width, 4))
    canvas[..., 3] = np.kron(0.34 * fading * gaussian_filter(dark, 5.0), np.ones((2, 2)))[:height, :width]
    return canvas
