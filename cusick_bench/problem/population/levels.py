"""How simulated samples differ at every level, beside real ones: repeats, faces, samples of a fabric.

Of each fabric and face that was placed (`population`), specimens of its cloth are draped, each three times: laid down
twice (a repeat: stiffness and rest shape are the specimen's own, the laid shape is new), and turned over. Real repeats
are the second captures of a sample.
"""

import math
from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import fold_count_of, profile_of
from cusick_bench.problem.drape_problem import DrapeProblem
from cusick_bench.problem.field_space import FieldSpace
from cusick_bench.problem.population.derivation import Population, Samples, field_space_of, placed_at
from cusick_bench.problem.statistics import STATISTICS, drape_statistics

Images = Float[ndarray, "samples size size"]
_AREA, _DEPTH = STATISTICS.index("area_log_odds"), STATISTICS.index("fold_depth_log")


def compare_levels(
    problem: DrapeProblem,
    population: Population,
    groups: list[Samples],
    specimens: int,
    *,
    done: Callable[[int], None] = lambda drapes: None,
) -> list[dict[str, str | float]]:
    """Drapes specimens of every fabric's cloth and describes them beside its samples.

    Args:
        problem: Who drapes.
        population: Where the cloths were placed.
        groups: The samples.
        specimens: Number of specimens of each fabric and face, two or more.
        done: Called with the number of drapes made, `level_drapes` in all.

    Returns:
        Rows, real and simulated in turn: `fabric`, `turned`, `of`, `drapes`, `dc` and `dc_sd` [points], `folds`,
        `folds_sd`, `depth_mm`, mean squared errors `other_mse`, `repeat_mse`, `flip_mse`, and `dc_drift`, by how much
        the drape coefficient changes from a drape to its repeat, in the mean [points]; NaN where there is none, of the
        two faces where they are not of the same samples.
    """
    rows: list[dict[str, str | float]] = []
    space = field_space_of(problem)
    for group in groups:
        generator = np.random.default_rng(1)
        taus = np.stack([placed_at(problem, population.places[group.fabric], generator) for _ in range(specimens)])
        again = taus.copy()
        laying = space.weights("laying")
        again[:, laying] = generator.standard_normal(again[:, laying].shape)
        turned = np.stack([turned_over(space, tau) for tau in again])
        first, second = (turned, None) if group.turned else (taus, again)
        images, repeats = _drape(problem, first, done), None if second is None else _drape(problem, second, done)
        flips = _drape(problem, taus if group.turned else turned, done)
        other = next((one for one in groups if one.fabric == group.fabric and one.turned != group.turned), None)
        flipped = other.images if other is not None and other.numbers == group.numbers else None
        name: dict[str, str | float] = {"fabric": group.fabric, "turned": str(group.turned)}
        rows.append({**name, "of": "samples", **_described(group.images, group.repeats, flipped, group.protocol)})
        rows.append({**name, "of": "simulated", **_described(images, repeats, flips, problem.protocol)})
    return rows


def level_drapes(groups: list[Samples], specimens: int) -> int:
    """Number of drapes that `compare_levels` makes.

    Args:
        groups: The samples.
        specimens: Number of specimens of each fabric and face.

    Returns:
        Three of each specimen face up, two of one that is turned over, which is not laid down again.
    """
    return specimens * sum(2 if group.turned else 3 for group in groups)


def turned_over(space: FieldSpace, tau: Float[ndarray, " dimension"]) -> Float[ndarray, " dimension"]:
    """The same specimen on its other face, turned over about y: fields mirrored, rest shape reversed.

    Args:
        space: What tau means.
        tau: A specimen.

    Returns:
        Its parameter vector, the laid shape unchanged.
    """
    turned, modes = space.turned(tau), space.modes
    mirror = np.where(modes.sine, -1.0, 1.0) * (-1.0) ** modes.order  # x -> -x
    for field in ("stiffness", "rest"):
        turned[space.weights(field)] *= mirror
    return turned


def _drape(problem: DrapeProblem, taus: ndarray, done: Callable[[int], None]) -> Images:
    """Silhouettes; NaN where a drape fails."""
    seen = problem.draw_batch(taus)
    done(len(taus))
    nothing = np.full(problem.train_image.shape, math.nan)
    return np.stack([nothing if one is None else one.image for one in seen])


def _described(images: Images, repeats: Images | None, flips: Images | None, protocol: Protocol) -> dict[str, float]:
    rest = images[np.isfinite(images).all((1, 2))]
    statistics = drape_statistics(torch.as_tensor(rest), protocol).numpy()
    coefficients = _coefficients(statistics)
    folds = np.array([float(fold_count_of(profile_of(image, protocol), protocol)) for image in rest])
    pairs = [_mse(a, b, protocol) for i, a in enumerate(rest) for b in rest[:i]]
    return {
        "drapes": float(len(rest)),
        "dc": float(coefficients.mean()),
        "dc_sd": float(coefficients.std(ddof=1)),
        "folds": float(folds.mean()),
        "folds_sd": float(folds.std(ddof=1)),
        "depth_mm": float(1e3 * protocol.overhang_m * np.exp(statistics[:, _DEPTH]).mean()),
        "other_mse": float(np.mean(pairs)),
        "repeat_mse": math.nan if repeats is None else _mse(images, repeats, protocol),
        "flip_mse": math.nan if flips is None else _mse(images, flips[:, :, ::-1], protocol),  # mirrored back
        "dc_drift": math.nan if repeats is None else _drift(images, repeats, protocol),
    }


def _coefficients(statistics: Float[ndarray, "samples statistics"]) -> Float[ndarray, " samples"]:
    """Drape coefficients [points]."""
    return 100 / (1 + np.exp(-statistics[:, _AREA]))


def _drift(images: Images, repeats: Images, protocol: Protocol) -> float:
    """Mean change of the drape coefficient from drapes to their repeats [points], without drapes that failed."""
    both = np.isfinite(images).all((1, 2)) & np.isfinite(repeats).all((1, 2))
    if not both.any():
        return math.nan
    before, after = (drape_statistics(torch.as_tensor(one[both]), protocol).numpy() for one in (images, repeats))
    return float((_coefficients(after) - _coefficients(before)).mean())


def _mse(images: ndarray, others: ndarray, protocol: Protocol) -> float:
    """Mean squared error of drapes and their counterparts, without drapes that failed."""
    return protocol.mse_scale * float(np.nanmean((images - others) ** 2))
