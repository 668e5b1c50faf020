"""Fits the network that reads outlines (`segmentation/edge_model.py`) to synthetic photographs.

    python -m cusick_bench.photographs.edge_fitting edge_model.npz --first 100 200 --laboratories 20

Every photograph is read along two curves: the outline that is found without the network, and the true one, bent at
random. Colours are turned and profiles mirrored at random, so that none of the studio's colours is learnt.
"""

import argparse
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from cusick_bench.photographs.calibration.view import PlateView, Uncertainty
from cusick_bench.photographs.reading import Photograph
from cusick_bench.photographs.segmentation.curve import Curve, curve_of, normals, resampled, smoothed
from cusick_bench.photographs.segmentation.edge_model import LEAST_SPREAD
from cusick_bench.photographs.segmentation.outline import found_by_light
from cusick_bench.photographs.segmentation.plane import PlanePicture
from cusick_bench.photographs.segmentation.polar import polar_picture
from cusick_bench.photographs.segmentation.profiles import REACH, profiles
from cusick_bench.photographs.segmentation.shading import evenly_lit
from cusick_bench.photographs.studio.lens import StudioCamera
from cusick_bench.photographs.studio.scene import make_drape, make_laboratory
from cusick_bench.photographs.studio.shot import photograph
from cusick_bench.photographs.studio.truth import apparent_radii
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

SHOTS = 5
_ANGLES = 720
_FINE = 5e-5  # [m] between places where the truth is looked for along a normal
_BENDS, _LENGTHS = (0.0, 0.3e-3, 0.8e-3, 1.6e-3), (1e-3, 3e-3, 8e-3)  # [m] sizes and lengths of random bends
_UNITS, _BATCH, _RATE, _DECAY = 48, 1024, 2e-3, 1e-3


def view_of(camera: StudioCamera) -> PlateView:
    """The view of a camera that is known exactly.

    Args:
        camera: The camera.

    Returns:
        Its view.
    """
    matrix = np.array([[camera.focal, 0, camera.middle[0]], [0, camera.focal, camera.middle[1]], [0, 0, 1]])
    rotation = camera.rotation()
    view = PlateView(
        (camera.width, camera.height), matrix, np.array([*camera.distortion, 0, 0, 0]), rotation,
        -rotation @ np.array(camera.eye), Uncertainty(0, 0, 0, 0), "the studio",
    )  # fmt: skip
    return view.centred(np.zeros(2))


def offsets_to(radii: Float[ndarray, " angles"], curve: Curve) -> Float[ndarray, " points"]:
    """Distances from a curve to an outline.

    Args:
        radii: The outline at equidistant angles [m].
        curve: Points in even distances, counter-clockwise [m].

    Returns:
        Distances along the normals, positive where the outline lies outside [m]; NaN where it is out of reach.
    """
    along = np.arange(-REACH, REACH, _FINE)
    places = curve[:, None] + along[:, None] * normals(curve)[:, None]
    turn = np.mod(np.arctan2(places[..., 1], places[..., 0]), 2 * np.pi) * len(radii) / (2 * np.pi)
    before = np.floor(turn).astype(int) % len(radii)
    share = turn - np.floor(turn)
    inside = (1 - share) * radii[before] + share * radii[(before + 1) % len(radii)] > np.hypot(
        *np.moveaxis(places, -1, 0)
    )
    leaves = inside[:, :-1] & ~inside[:, 1:]
    middle = (along[:-1] + along[1:]) / 2
    nearest = np.where(leaves, np.abs(middle), np.inf).argmin(axis=1)
    return np.where(leaves.any(axis=1), middle[nearest], np.nan)


def bent(curve: Curve, generator: np.random.Generator) -> Float[ndarray, "even 2"]:
    """Bends a curve at random, as an outline that was found badly.

    Args:
        curve: Points of the outline in order [m].
        generator: Source of random numbers.

    Returns:
        Points in even distances [m].
    """
    curve = resampled(curve)
    bend = smoothed(generator.normal(size=(len(curve), 1)), generator.choice(_LENGTHS))
    return resampled(smoothed(resampled(curve + normals(curve) * bend * generator.choice(_BENDS) / bend.std()), 8e-4))


def examples(laboratories: Iterable[int]) -> Iterator[tuple[ndarray, ndarray]]:
    """Draws photographs, and what is true of them.

    Args:
        laboratories: Their numbers.

    Yields:
        Profiles, and the true offsets [mm], of one curve.
    """
    for number in laboratories:
        laboratory = make_laboratory(number)
        view = view_of(laboratory.camera)
        for shot in range(SHOTS):
            drape = make_drape(laboratory, shot)
            taken = Photograph(photograph(laboratory, drape, shot), None)
            seen = view.on_plane(laboratory.camera.project(drape.vertices))
            flat = np.column_stack([seen, np.zeros(len(seen))])
            radii = apparent_radii(flat, drape.faces, np.inf, np.arange(_ANGLES) * 2 * np.pi / _ANGLES)
            picture = evenly_lit(polar_picture(taken, view, PLATE_RADIUS, CLOTH_RADIUS))
            found = curve_of(found_by_light(picture).radii)
            for curve in (found, bent(curve_of(radii), np.random.default_rng([number, shot]))):
                yield _example(picture.plane, radii, curve)


def _example(picture: PlanePicture, radii: ndarray, curve: Curve) -> tuple[ndarray, ndarray]:
    offsets = 1e3 * offsets_to(radii, curve)
    known = np.isfinite(offsets)
    return profiles(picture, curve)[known].astype(np.float32), offsets[known].astype(np.float32)


def _turned(features: Tensor, generator: torch.Generator) -> Tensor:
    """The same in other colours, some of them mirrored along the outline."""
    count = len(features)

    def chance() -> Tensor:
        return torch.rand(count, generator=generator)

    parts = features[:, :-2].reshape(count, 3, -1, 3)
    angle, sign, side = (2 * torch.pi * chance())[:, None, None], torch.sign(chance() - 0.5), torch.sign(chance() - 0.5)
    blue, red = parts[..., 1], parts[..., 2]
    turned = torch.stack(
        [
            parts[..., 0] * sign[:, None, None],
            torch.cos(angle) * blue - torch.sin(angle) * red,
            (torch.sin(angle) * blue + torch.cos(angle) * red) * side[:, None, None],
        ],
        dim=-1,
    )
    mirrored = (chance() < 0.5)[:, None, None, None]
    turned = torch.where(mirrored, turned.flip(1), turned)
    return torch.cat([turned.reshape(count, -1), features[:, -2:]], dim=1)


def fit(
    features: Float[Tensor, "points features"], offsets: Float[Tensor, " points"], steps: int, seed: int
) -> dict[str, Any]:
    """Fits the network by the likelihood of Laplace's distribution.

    Args:
        features: Profiles.
        offsets: True offsets [mm].
        steps: Steps of the optimiser.
        seed: Seed of weights and draws.

    Returns:
        Arrays of `edge_model.npz`.
    """
    generator = torch.Generator().manual_seed(seed)
    sizes = (features.shape[1], _UNITS, _UNITS, 2)
    linear = [cast(torch.nn.Linear, torch.nn.utils.skip_init(torch.nn.Linear, *pair)) for pair in pairwise(sizes)]
    for layer in linear:
        torch.nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=generator)
        torch.nn.init.zeros_(layer.bias)
    network = torch.nn.Sequential(linear[0], torch.nn.ReLU(), linear[1], torch.nn.ReLU(), linear[2])
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=steps)
    for _ in range(steps):
        drawn = torch.randint(len(features), (_BATCH,), generator=generator)
        place, spread = network(_turned(features[drawn], generator)).T
        spread = torch.nn.functional.softplus(spread) + LEAST_SPREAD
        loss = ((place - offsets[drawn]).abs() / spread + torch.log(spread)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    kept: dict[str, Any] = {}
    for number, layer in enumerate(linear):
        kept[f"weights{number}"] = layer.weight.detach().numpy().T.astype(np.float32)
        kept[f"offsets{number}"] = layer.bias.detach().numpy().astype(np.float32)
    return kept


def main() -> None:
    """Fits the network and writes its weights."""
    parser = argparse.ArgumentParser(description="Fits the network that reads outlines.")
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, nargs="+", default=[100, 200], help="first laboratory of each row")
    parser.add_argument("--laboratories", type=int, default=20, help="laboratories in a row")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=0)
    told = parser.parse_args()
    numbers = [first + number for first in told.first for number in range(told.laboratories)]
    features, offsets = zip(*examples(numbers), strict=True)
    kept = fit(
        torch.from_numpy(np.concatenate(features)), torch.from_numpy(np.concatenate(offsets)), told.steps, told.seed
    )
    np.savez_compressed(told.out, **kept)


if __name__ == "__main__":
    main()
