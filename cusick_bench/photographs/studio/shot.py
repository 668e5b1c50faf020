"""Takes the picture: cloth and ground in their light, through the lens, onto the sensor."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.photographs.board import HEIGHT, WIDTH, board_cells
from cusick_bench.photographs.studio.lens import StudioCamera
from cusick_bench.photographs.studio.pattern import Surface
from cusick_bench.photographs.studio.raster import rasterise
from cusick_bench.photographs.studio.scene import Laboratory, Piece
from cusick_bench.photographs.studio.shadow import light_on_ground

_FINE = 2  # oversampling along each side of a pixel
_GAIN = 0.85  # exposure: linear level of a white surface in the lamp's full light
_VIGNETTE = 0.25  # of the light that is lost in the picture's corners


def _normals(piece: Piece) -> Float[ndarray, "vertices 3"]:
    a, b, c = (piece.vertices[piece.faces[:, corner]] for corner in range(3))
    of_faces = np.cross(b - a, c - a)
    total = np.zeros_like(piece.vertices)
    for corner in range(3):
        np.add.at(total, piece.faces[:, corner], of_faces)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def _gradient(laboratory: Laboratory, places: ndarray) -> Float[ndarray, "*places 1"]:
    light = laboratory.light
    x, y = places[..., 0], places[..., 1]
    return np.exp(x * light.slope[0] + y * light.slope[1] + light.bend * (x**2 + y**2)).astype(np.float32)[..., None]


def _ground(laboratory: Laboratory, rays: ndarray, eye: ndarray, shade: Surface) -> Float[ndarray, "rows columns 3"]:
    reach = (-laboratory.ground_depth - eye[2]) / rays[..., 2]
    places = (eye[:2] + reach[..., None] * rays[..., :2]).astype(np.float32)
    light = shade.at(places)[..., None] * _gradient(laboratory, places)
    return laboratory.ground.at(places) * light * laboratory.light.tint


def _on_piece(laboratory: Laboratory, piece: Piece, camera: StudioCamera) -> tuple[ndarray, ndarray]:
    """Which pixels see the piece, and its light there."""
    seen = piece.vertices - np.array(camera.eye)
    corners, depths = camera.project(piece.vertices), seen @ camera.axis()
    face_of, weights = rasterise(corners, depths, piece.faces, (camera.width, camera.height))
    rows, columns = np.nonzero(face_of >= 0)
    known = np.concatenate([piece.vertices, _normals(piece), piece.material], axis=1).astype(np.float32)
    trio, share = piece.faces[face_of[rows, columns]], weights[rows, columns]
    there = sum(known[trio[:, corner]] * share[:, corner, None] for corner in range(3))
    position, normal, flat = np.split(np.asarray(there), [3, 6], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    to_eye = np.array(camera.eye, np.float32) - position
    to_lamp = laboratory.light.lamp.astype(np.float32) - position
    to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
    facing = np.sign((normal * to_eye).sum(axis=1))
    lambert = np.clip((normal * to_lamp).sum(axis=1) * facing, 0, None)
    low = np.clip(-position[:, 2] / 0.06, 0, 1)
    ambient = laboratory.light.ambient
    light = ambient * (1 - 0.35 * low) * (0.6 + 0.4 * np.abs(normal[:, 2])) + (1 - ambient) * lambert
    colour = piece.albedo.at(flat) * light[:, None] * _gradient(laboratory, position[:, :2])
    return face_of >= 0, colour * laboratory.light.tint


def _developed(laboratory: Laboratory, linear: ndarray, generator: np.random.Generator) -> UInt8[ndarray, "h w 3"]:
    """The sensor: exposure, white balance, vignette, blur, noise, gamma, compression."""
    height, width = linear.shape[:2]
    column, row = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    falling = 1 - _VIGNETTE * 0.5 * (column**2 + row**2)
    balance = np.exp(generator.normal(0, 0.02, 3)) * np.exp(generator.normal(0, 0.05)) * _GAIN
    blurred = cv2.GaussianBlur((linear * falling[..., None] * balance).astype(np.float32), (0, 0), laboratory.blur)
    bright = cv2.pow(np.clip(blurred, 0.0031308, None), 1 / 2.4)
    level = np.where(blurred <= 0.0031308, 12.92 * blurred, 1.055 * bright - 0.055)
    noise = cv2.GaussianBlur(generator.standard_normal(level.shape, np.float32), (0, 0), 0.6) * 1.8
    noisy = np.clip(255 * level + laboratory.noise * noise, 0, 255).astype(np.uint8)
    coded = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, laboratory.quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))


def _coarse(fine: ndarray, camera: StudioCamera) -> ndarray:
    return cv2.resize(fine.astype(np.float32), (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def photograph(laboratory: Laboratory, piece: Piece, shot: int) -> UInt8[ndarray, "height width 3"]:
    """A photograph of a piece on the plate.

    Args:
        laboratory: Camera, light and ground.
        piece: What lies on the plate.
        shot: Number of the photograph, which decides exposure and noise.

    Returns:
        Levels, blue first.
    """
    rays, eye = laboratory.camera.rays(), np.array(laboratory.camera.eye)
    shade = light_on_ground(piece, laboratory.light, laboratory.ground_depth)
    fine = laboratory.camera.finer(_FINE)
    seen, colour = _on_piece(laboratory, piece, fine)
    drawn = np.zeros((fine.height, fine.width, 4), np.float32)
    drawn[seen, :3], drawn[seen, 3] = colour, 1.0
    drawn = _coarse(drawn, laboratory.camera)
    picture = _ground(laboratory, rays, eye, shade) * (1 - drawn[..., 3:]) + drawn[..., :3]
    generator = np.random.default_rng([laboratory.seed, shot, 4])
    return _developed(laboratory, picture, generator)


def board_photograph(
    laboratory: Laboratory, shot: int, pose: tuple[Float[ndarray, "3 3"], Float[ndarray, " 3"]] | None = None
) -> UInt8[ndarray, "height width 3"]:
    """A photograph of the printed board.

    Args:
        laboratory: Camera, light and ground.
        shot: Number of the photograph.
        pose: Rotation and place of the board's middle [m]; None for one that lies on the plate.

    Returns:
        Levels, blue first.
    """
    turn, middle = pose or (np.eye(3), np.zeros(3))
    rays, eye = laboratory.camera.rays(), np.array(laboratory.camera.eye)
    nothing = Piece(np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 2)), laboratory.ground)
    shade = light_on_ground(nothing, laboratory.light, laboratory.ground_depth)
    picture = _ground(laboratory, rays, eye, shade)
    normal = turn[:, 2]
    reach = ((middle - eye) @ normal) / (rays @ normal)
    on_board = (eye + reach[..., None] * rays - middle) @ turn[:, :2]
    cells = cv2.blur(board_cells(48), (3, 3))  # about what a pixel sees
    column = (on_board[..., 0] / WIDTH + 0.5) * cells.shape[1] - 0.5
    row = (0.5 - on_board[..., 1] / HEIGHT) * cells.shape[0] - 0.5
    paper = 0.02
    on_sheet = (np.abs(on_board[..., 0]) < WIDTH / 2 + paper) & (np.abs(on_board[..., 1]) < HEIGHT / 2 + paper)
    ink = cv2.remap(
        cells, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=255,
    )  # fmt: skip
    sheet = (0.05 + 0.75 * ink[on_sheet][:, None] / 255.0) * _gradient(laboratory, on_board)[on_sheet]
    picture[on_sheet] = sheet * laboratory.light.tint
    generator = np.random.default_rng([laboratory.seed, shot, 5])
    return _developed(laboratory, picture, generator)


def held_boards(laboratory: Laboratory, count: int) -> list[UInt8[ndarray, "height width 3"]]:
    """Photographs of the board held over the plate at several angles.

    Args:
        laboratory: Camera, light and ground.
        count: Number of them.

    Returns:
        Levels, blue first.
    """
    generator = np.random.default_rng([laboratory.seed, 6])
    taken = []
    for number in range(count):
        lean, turn = np.radians(generator.uniform(15, 40)), generator.uniform(0, 2 * np.pi)
        axis = np.array([np.cos(turn), np.sin(turn), 0.0])
        rotation, _ = cv2.Rodrigues(lean * axis)
        spin, _ = cv2.Rodrigues(np.array([0, 0, generator.uniform(-0.4, 0.4)]))
        middle = np.array([*generator.uniform(-0.05, 0.05, 2), generator.uniform(0.02, 0.1)])
        taken.append(board_photograph(laboratory, 100 + number, (rotation @ spin, middle)))
    return taken
