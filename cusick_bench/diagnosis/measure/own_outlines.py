"""Shift of a fabric's statistics by an error of the camera, from its own outlines and without a model of the cloth.

Where the picture's centre, its scale or its grey level is wrong, every outline is moved by a known map. Undoing the map
on the observed outlines gives the statistics without the error; the difference is the shift by the effect. It is right
for the actual folds of the cloth, whereas the atlas knows only the shift of a typical cloth.

    centre    p -> p - shift u(direction)
    scale     p -> p / (1 + error)
    level     p -> p - shift n,   n the normal of the smoothed outline, e_r - (r'/r) e_phi over its length

Two more effects depend on how deep the outline lies below the plate, which is estimated from its radius and from the
slope of the line of sight (`hanging_line`). With the depth h of a point at q that is seen at p,

    near eye  p = q / (1 + k h)
    tilt      p = q - u(direction) ((1 - cos a) u.q + sin a h)

which is solved for q; no outline that is seen from straight above lies inside the plate. Where the plate's edge is
seen, the outline is hidden behind it, and is taken to recede to the edge from where it comes into sight.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.ndimage import distance_transform_edt, gaussian_filter1d

from cusick_bench.datasets.files.hanging_line import outline_depth, without_perspective
from cusick_bench.diagnosis.measure.captures import ANGLES, Captures
from cusick_bench.diagnosis.measure.features import SPREADS, contrast_weights, features
from cusick_bench.diagnosis.measure.statistics import NAMES, capture_statistics

UNDONE: Final = ("camera-offset", "camera-scale", "threshold", "perspective", "camera-tilt")
"""Effects that act on the outline alone."""
DEPTH_MISMATCH: Final = {"perspective": (0.15, 0.3), "camera-tilt": (0.12, 0.12)}
"""Relative error of such a shift along and across it, for the effects that depend on depth: that of the model, which on
the shipped cloths is up to .1 and .15 of the limp one and less of the others, with what a lens or a near eye adds.
Where much of limp cloth is hidden, perspective is known worse."""
_ROUNDS = 30  # iterations for the true outline; steps are halved, as the depth of stiff cloth is steep in the radius
_EDGE = 0.0007  # [m] half a pixel of the release; points nearer to the plate's edge count as the plate
_HIDING = 5.0  # [deg] distance from where the rim comes into sight, over which it recedes to the plate's edge
_SMOOTH = 2.0 * ANGLES / 360  # angles over which moves are averaged: close to the edge they amplify noise
_HARMONICS = 24  # harmonics of the outline from which normals are taken; finer detail is due to pixels
_ANGLE = 2 * np.pi * np.arange(ANGLES) / ANGLES
_NODES = 2 * np.pi * np.arange(8) / 8
"""Directions between which shifts are interpolated; shifts are nearly linear in the offset, so a few are enough."""


@dataclass(frozen=True, eq=False)
class OutlineChange:
    """Shift of a fabric's features by an effect of given strengths.

    Attributes:
        contrast: Shift of the even and odd parts of every statistic; 0 where they are unknown [its unit].
        spread: Shift of the entries of `SPREADS`.
    """

    contrast: Float[ndarray, "values 2 statistics"]
    spread: Float[ndarray, "values spreads"]


@dataclass(frozen=True, eq=False)
class OwnOutlines:
    """Outlines of one fabric.

    Attributes:
        captures: The fabric's silhouettes, in the lengths that statistics are to have.
    """

    captures: Captures
    _known: dict[tuple[str, bytes], OutlineChange] = field(default_factory=dict, repr=False)
    _at_nodes: dict[tuple[str, float], ndarray] = field(default_factory=dict, repr=False)

    def change(
        self, effect: str, severity: Float[ndarray, "values"], direction: Float[ndarray, "2 values"] | None
    ) -> OutlineChange:
        """Shift of the features by an effect of `UNDONE`.

        Args:
            effect: Its name.
            severity: In the unit of its parameter.
            direction: Directions in the camera's frame on captures with the face up and with the face down [rad].

        Returns:
            The shifts.

        Raises:
            KeyError: An effect that is not in `UNDONE`.
        """
        if effect not in UNDONE:
            raise KeyError(f"{effect!r} does not act on the outline alone; such effects are {', '.join(UNDONE)}")
        turned = np.zeros((2, len(severity))) if direction is None else direction
        key = effect, np.vstack([severity, turned]).tobytes()
        if key not in self._known:
            self._known[key] = self._made(effect, severity, turned)
        return self._known[key]

    def _made(self, effect: str, severity: ndarray, direction: ndarray) -> OutlineChange:
        seen = self.captures
        mean, weights, known = _averages(seen)
        plain = capture_statistics(seen.cloth_frame(), seen.protocol)
        first = _spread(mean, plain, known)
        angle = direction[(seen.side == "down").astype(int)].T  # of every value and capture
        contrast = np.empty((len(severity), 2, len(NAMES)))
        spread = np.empty((len(severity), len(SPREADS)))
        for size in np.unique(severity):
            own = severity == size
            values = self._statistics(effect, float(size), angle[own])
            contrast[own] = np.einsum("rc,vck->vrk", weights, plain - values)
            spread[own] = [first - _spread(mean, value, known) for value in values]
        return OutlineChange(contrast, np.nan_to_num(spread))

    def _statistics(
        self, effect: str, size: float, angle: Float[ndarray, "values captures"]
    ) -> Float[ndarray, "values captures statistics"]:
        """Statistics without the effect; many directions are interpolated trigonometrically between a few."""
        if len(angle) <= len(_NODES):
            return self._directly(effect, size, angle)
        if (effect, size) not in self._at_nodes:  # the same in both frames
            nodes = np.tile(_NODES[:, None], (1, len(self.captures)))
            self._at_nodes[effect, size] = self._directly(effect, size, nodes)
        values = self._at_nodes[effect, size]
        away = angle[..., None] - _NODES
        kernel = 1 + 2 * sum(np.cos(m * away) for m in range(1, len(_NODES) // 2)) + np.cos(len(_NODES) // 2 * away)
        return np.einsum("vcn,nck->vck", kernel / len(_NODES), values)

    def _directly(self, effect: str, size: float, angle: Float[ndarray, "values captures"]) -> ndarray:
        seen = self.captures
        radii = _undone(effect, seen, size, angle)[:, np.arange(len(seen))[:, None], seen.seen_at()]
        return capture_statistics(radii.reshape(-1, ANGLES), seen.protocol).reshape(len(angle), len(seen), -1)


def _averages(seen: Captures) -> tuple[Float[ndarray, "specimens captures"], Float[ndarray, "2 captures"], ndarray]:
    """Means over captures of every sample and face, weights of the captures in the contrasts, and what is known."""
    samples, row = np.unique(seen.sample, return_inverse=True)
    face = (seen.side == "down").astype(int)  # an unknown side counts as up, where that is missing: `sample_statistics`
    mean = np.zeros((len(samples), 2, len(seen)))
    mean[row, face, np.arange(len(seen))] = (seen.side != "") | ~np.isin(seen.sample, seen.sample[seen.side == "up"])
    count = mean.sum(2)
    mean /= np.maximum(count, 1)[..., None]
    known = count > 0
    weights = np.einsum("rsf,sfc->rc", contrast_weights(known), mean)
    return mean.reshape(-1, len(seen)), weights, known


def _spread(mean: ndarray, values: Float[ndarray, "captures statistics"], known: ndarray) -> ndarray:
    specimens = (mean @ values).reshape(*known.shape, -1)
    return features(np.where(known[..., None], specimens, np.nan)).spread


def _undone(
    effect: str, seen: Captures, size: float, angle: Float[ndarray, "values captures"]
) -> Float[ndarray, "values captures angles"]:
    """Outlines as they would be seen without the effect."""
    radii = seen.radii
    if effect == "camera-scale":
        return np.tile(radii / (1 + size), (len(angle), 1, 1))
    if effect == "perspective":
        moved = _over_hidden(seen, without_perspective(radii, seen.protocol, 1 / size) - radii)
        return np.tile(radii + moved, (len(angle), 1, 1))
    if effect == "camera-offset":
        away = size * np.exp(1j * angle[..., None])
    elif effect == "camera-tilt":
        away = -_lean(seen, np.deg2rad(size), angle)
    else:
        wave = np.fft.rfft(radii, axis=1)
        wave[:, _HARMONICS + 1 :] = 0
        slope = np.fft.irfft(1j * np.arange(wave.shape[1]) * wave, ANGLES, axis=1) / np.fft.irfft(wave, ANGLES, axis=1)
        normal = (1 - 1j * slope) / np.sqrt(1 + slope**2)
        away = np.tile(size * normal * np.exp(1j * _ANGLE), (len(angle), 1, 1))
    points = radii * np.exp(1j * _ANGLE) - away
    return _at_whole_degrees(points.reshape(-1, ANGLES)).reshape(points.shape)


def _lean(seen: Captures, lean: float, angle: Float[ndarray, "values captures"]) -> ndarray:
    """How far every point is moved to where it would be seen by an upright camera [m], as complex numbers."""
    points, towards = seen.radii * np.exp(1j * _ANGLE), np.exp(1j * angle[..., None])
    true, least = points + np.zeros_like(towards), np.minimum(seen.radii, seen.protocol.plate_radius_m)
    for _ in range(_ROUNDS):
        radii, along = np.abs(true), np.real(true * towards.conj())
        depth = outline_depth(radii, np.tan(lean) * along / radii, seen.protocol)
        moved = points + towards * ((1 - np.cos(lean)) * along + np.sin(lean) * depth)
        halfway = (true + moved) / 2
        distance = np.abs(halfway)
        true = halfway * np.maximum(distance, least) / distance
    return _over_hidden(seen, true - points)


def _over_hidden(seen: Captures, moved: ndarray) -> ndarray:
    """Moves of all points, those of hidden ones replaced: where the plate's edge is seen, the outline may lie anywhere.

    They fall with the distance from the nearest point that is seen, as the outline recedes to the edge from there.
    """
    rim = seen.radii > seen.protocol.plate_radius_m + _EDGE
    whole, places = moved.copy(), np.arange(ANGLES)
    for capture in np.flatnonzero(~rim.all(1) & rim.any(1)):
        around = np.tile(rim[capture], 3)
        found = distance_transform_edt(~around, return_distances=False, return_indices=True)
        nearest = np.asarray(found)[0, ANGLES : 2 * ANGLES] - ANGLES
        share = np.exp(-np.abs(nearest - places) * (360 / ANGLES) / _HIDING)
        whole[..., capture, :] = moved[..., capture, nearest % ANGLES] * share
    return gaussian_filter1d(whole, _SMOOTH, axis=-1, mode="wrap")


def _at_whole_degrees(points: ndarray) -> Float[ndarray, "outlines angles"]:
    """Radii at whole degrees of outlines given by points that are nearly at them."""
    distance, angle = np.abs(points), np.angle(points) % (2 * np.pi)
    return np.array([np.interp(_ANGLE, a, d, period=2 * np.pi) for a, d in zip(angle, distance, strict=True)])
