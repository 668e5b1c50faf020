"""Classifies places as cloth or ground by their nearest neighbours among known places of both.

Colours are compared in Lab, with chroma divided by lightness, which a shadow hardly changes. Known ground is also taken
darker than it is, as shadows make it, and known cloth darker and lighter, as folds do.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial import KDTree

from cusick_bench.photographs.segmentation.polar import STEP, PolarPicture

_SAMPLES = 1500
_FLOOR = 2.5  # differences of features below this are ignored
_MOST = 3.0  # largest log likelihood ratio of one place
_EVERY = 2  # every second row and column is classified
_LIGHTNESS = 0.5  # weight of lightness relative to chroma
_SHADE = (-1.0, 0.1)  # range of the log of the light in a shadow
_FOLDS = (-0.7, 0.3)  # range of the log of the light on folds
_STRANGE = 7.0  # distance of features from all known ones beyond which a place is neither cloth nor ground
_GRAIN = 1.0  # step to which features are rounded, so that equal ones are looked up only once
_MARGIN = 1.5e-3  # [m] margin on both sides of a first outline from which nothing is learnt
_NEAR = 0.015  # [m] width of the ground outside a first outline that is learnt


def colour_features(light: Float[ndarray, "*places 3"]) -> Float[ndarray, "*places 3"]:
    """Features of a place by which it is compared.

    Args:
        light: Linear light, blue first.

    Returns:
        Weighted lightness, and two chromas that a shadow hardly changes.
    """
    flat = np.clip(light, 0, 4).reshape(-1, 1, 3).astype(np.float32)
    lab = cv2.cvtColor(flat, cv2.COLOR_LBGR2Lab).reshape(light.shape)
    return np.stack(
        [
            _LIGHTNESS * lab[..., 0],
            60 * lab[..., 1] / (lab[..., 0] + 12),
            60 * lab[..., 2] / (lab[..., 0] + 12),
        ],
        axis=-1,
    )


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Known places of cloth and of ground.

    Attributes:
        cloth, ground: Trees of their features.
    """

    cloth: KDTree
    ground: KDTree

    def judged(self, features: Float[ndarray, "*places 3"]) -> tuple[ndarray, ndarray]:
        """Compares places with the known ones.

        Args:
            features: Colour features of the places to judge.

        Returns:
            Log likelihood ratio of cloth against ground, positive where cloth is likelier; and whether a place is like
            neither.
        """
        flat, place = _distinct(features.reshape(-1, features.shape[-1]))
        cloth, ground = (tree.query(flat, k=3)[0][place, 2] for tree in (self.cloth, self.ground))
        score = 1.5 * np.log((ground**2 + _FLOOR**2) / (cloth**2 + _FLOOR**2))
        shape = features.shape[:-1]
        return np.clip(score, -_MOST, _MOST).reshape(shape), (np.minimum(cloth, ground) > _STRANGE).reshape(shape)


def _distinct(features: Float[ndarray, "places 3"]) -> tuple[Float[ndarray, "distinct 3"], Int[ndarray, " places"]]:
    """Rounded features without repetition, and which of them each place has."""
    cells = np.round(features / _GRAIN).astype(np.int64)
    low = cells.min(axis=0)
    size = cells.max(axis=0) - low + 1
    keys, place = np.unique(np.ravel_multi_index(tuple((cells - low).T), tuple(size)), return_inverse=True)
    return (np.column_stack(np.unravel_index(keys, tuple(size))) + low) * _GRAIN, place


def _drawn(light: ndarray, count: int, generator: np.random.Generator) -> ndarray:
    return light[generator.integers(0, len(light), count)]


def _shaded(light: ndarray, bounds: tuple[float, float], generator: np.random.Generator) -> ndarray:
    return light * np.exp(generator.uniform(*bounds, len(light)))[:, None]


def learnt(
    picture: PolarPicture, generator: np.random.Generator, outline: Float[ndarray, " angles"] | None = None
) -> Neighbours:
    """Learns cloth and ground from places that are known to be either.

    Args:
        picture: Evenly lit.
        generator: Draws places.
        outline: A first outline [m], inside and outside of which is learnt, too.

    Returns:
        Known places.
    """
    smooth = cv2.GaussianBlur(picture.light, (3, 3), 0.7)
    sure_cloth = smooth[:, picture.top][picture.seen[:, picture.top]]
    around = picture.seen[:, picture.ring]
    sure_ground = smooth[:, picture.ring][around] if around.any() else smooth[:, -4:].reshape(-1, 3)
    cloth = _drawn(sure_cloth, _SAMPLES, generator)
    ground = _drawn(sure_ground, _SAMPLES, generator)
    if outline is None:
        cloth = np.concatenate([cloth[::2], _shaded(cloth, _FOLDS, generator)])
        ground = np.concatenate([ground[::2], _shaded(ground, _SHADE, generator)])
    else:
        radii = picture.radii[None]
        inside = (radii < outline[:, None] - _MARGIN) & (radii > picture.plate) & picture.seen
        outside = (radii > outline[:, None] + _MARGIN) & (radii < outline[:, None] + _NEAR) & picture.seen
        if inside.sum() > 100:
            cloth = np.concatenate([cloth[::3], _drawn(smooth[inside], _SAMPLES, generator)])
        if outside.sum() > 100:
            ground = np.concatenate([ground[::3], _drawn(smooth[outside], _SAMPLES, generator)])
    return Neighbours(KDTree(colour_features(cloth)), KDTree(colour_features(ground)))


def likelihood(
    picture: PolarPicture, known: Neighbours
) -> tuple[Float[ndarray, "angles radii"], Float[ndarray, " judged"]]:
    """Log likelihood ratio of cloth against ground at every place, smoothed over a millimetre.

    Args:
        picture: Evenly lit.
        known: Known places.

    Returns:
        Ratios, positive where cloth is likelier; and at each angle that was judged the share of places between plate
        and ring that are like neither.
    """
    smooth = cv2.GaussianBlur(picture.light, (3, 3), 0.7)
    part = slice(picture.top.stop - 8, picture.ring.start + 8)
    coarse, strange = known.judged(colour_features(smooth[::_EVERY, part][:, ::_EVERY]))
    full = np.full(smooth.shape[:2], -_MOST, np.float32)
    full[:, : part.start] = _MOST
    size = (part.stop - part.start, len(full))
    full[:, part] = cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    wide = max(1, round(1e-3 / STEP)) | 1
    return cv2.blur(np.pad(full, ((4, 4), (0, 0)), mode="wrap"), (wide, 3))[4:-4], strange.mean(axis=1)
