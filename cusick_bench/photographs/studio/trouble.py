"""Disturbed photographs from which no outline can be read, and which a confidence should recognise."""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from cusick_bench.photographs.studio.scene import Laboratory, Piece, bare_plate, make_drape
from cusick_bench.photographs.studio.shot import photograph
from cusick_bench.sim.constants import PLATE_RADIUS

TROUBLES = ("camouflage", "hand", "cut", "blurred", "dark", "bare", "second-cloth", "glare")


def troubled(laboratory: Laboratory, shot: int, trouble: str) -> tuple[UInt8[ndarray, "height width 3"], Piece]:
    """A photograph with a fault.

    Args:
        laboratory: Where it is taken.
        shot: Number of the photograph.
        trouble: One of `TROUBLES`.

    Returns:
        Levels, blue first; and the drape, as it lies.
    """
    generator = np.random.default_rng([laboratory.seed, shot, 7])
    drape = make_drape(laboratory, shot, contrast=0.0 if trouble == "camouflage" else 12.0)
    if trouble == "bare":
        return photograph(laboratory, bare_plate(laboratory, PLATE_RADIUS), shot), drape
    if trouble == "blurred":
        return photograph(replace(laboratory, blur=generator.uniform(8, 14)), drape, shot), drape
    if trouble == "dark":
        dim = replace(laboratory.light, tint=laboratory.light.tint * generator.uniform(0.004, 0.012))
        return photograph(replace(laboratory, light=dim, noise=6.0), drape, shot), drape
    if trouble == "cut":
        camera = laboratory.camera
        aside = (camera.middle[0] + generator.choice([-1, 1]) * generator.uniform(380, 480), camera.middle[1])
        return photograph(replace(laboratory, camera=replace(camera, middle=aside)), drape, shot), drape
    taken = photograph(laboratory, drape, shot)
    if trouble in ("hand", "second-cloth"):
        _cover(taken, laboratory, generator, alike=trouble == "second-cloth")
    if trouble == "glare":
        _glare(taken, laboratory, generator)
    return taken, drape


def _rim_place(laboratory: Laboratory, generator: np.random.Generator, radius: float) -> tuple[ndarray, float]:
    angle = generator.uniform(0, 2 * np.pi)
    place = laboratory.camera.project(np.array([[radius * np.cos(angle), radius * np.sin(angle), 0.0]]))[0]
    return place, angle


def _cover(taken: ndarray, laboratory: Laboratory, generator: np.random.Generator, alike: bool) -> None:
    """A hand, or a rag of the same cloth, over the rim."""
    place, angle = _rim_place(laboratory, generator, 0.118)
    reach, thick = generator.uniform(180, 300), generator.uniform(60, 110)
    way = np.array([np.cos(angle), -np.sin(angle)])
    far = place + way * reach
    if alike:
        middle = laboratory.camera.project(np.array([[0.0, 0.0, 0.0]]))[0].astype(int)
        colour = np.median(taken[middle[1] - 40 : middle[1] + 40, middle[0] - 40 : middle[0] + 40], axis=(0, 1))
    else:
        colour = np.array([110, 140, 200]) * generator.uniform(0.5, 1.1)
    mask = np.zeros(taken.shape[:2], np.uint8)
    cv2.line(mask, tuple(place.astype(int).tolist()), tuple(far.astype(int).tolist()), 255, int(thick), cv2.LINE_AA)
    share = cv2.GaussianBlur(mask, (0, 0), 0.8)[..., None] / 255
    grain = generator.normal(0, 3, taken.shape)
    taken[:] = np.clip(taken * (1 - share) + (colour + grain) * share, 0, 255).astype(np.uint8)


def _glare(taken: ndarray, laboratory: Laboratory, generator: np.random.Generator) -> None:
    """A reflection that burns out part of the rim and of the ground beside it."""
    place, _ = _rim_place(laboratory, generator, 0.12)
    rows, columns = np.mgrid[: taken.shape[0], : taken.shape[1]]
    distance = np.hypot(columns - place[0], rows - place[1])
    light = 900 * np.exp(-0.5 * (distance / generator.uniform(50, 90)) ** 2)
    taken[:] = np.clip(taken + light[..., None], 0, 255).astype(np.uint8)
