"""A small atlas without any simulation: random folded outlines instead of drapes, effects planted on the outlines.

Stiffer cloth is wider and has fewer folds. The crests of a toy drape lie on one circle and its valleys on another, both
with low harmonics of their own; a sample's level of stiffness shows on both of its faces.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import LOW
from cusick_bench.diagnosis.atlas.design import BASE, Design
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.emulator_fit import fit
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import scaled
from cusick_bench.diagnosis.measure.statistics import capture_statistics
from cusick_bench.sim.effects import effect

ANGLES = 360
_THETA = np.arange(ANGLES) * (2 * np.pi / ANGLES)
_TURNED = (ANGLES // 2 - np.arange(ANGLES)) % ANGLES
_POINTS, _SAMPLES = 90, 4

Outlines = Float[ndarray, "samples 2 angles"]


def toy_outlines(theta: Float[ndarray, "parameters"], samples: int, generator: np.random.Generator) -> Outlines:
    """Outlines of samples of a toy cloth, up and down, in the cloth's frame [m].

    Args:
        theta: Base parameters; only the level of bending, the anisotropy and the scatter between samples do anything.
        samples: Number of samples.
        generator: Of all chance.

    Returns:
        Radii at whole degrees from the warp.
    """
    level, anisotropy = scaled(theta)[:2]
    between = 0.1 * np.exp(0.5 * scaled(theta)[8])
    rows = []
    for _ in range(samples):
        own = level + between * generator.standard_normal()
        rows.append([_outline(own, anisotropy, generator) for _ in range(2)])
    return np.array(rows)


def _outline(level: float, anisotropy: float, generator: np.random.Generator) -> Float[ndarray, "angles"]:
    folds = 10 - 3 * level + 0.7 * generator.standard_normal()
    low = generator.standard_normal((2, 3, 2)) * 1e-3
    waves = [[np.cos(m * _THETA), np.sin(m * _THETA)] for m in (1, 2, 3)]
    crests, valleys = (np.einsum("mp,mpa->a", one, waves) for one in low)
    crests = 0.13 + 0.008 * level + crests + 1e-3 * anisotropy * np.cos(2 * _THETA)
    valleys = 0.105 + 0.012 * level + valleys
    bent = _THETA + 0.15 * np.cos(_THETA - generator.uniform(0, 2 * np.pi))
    wave = (1 + np.cos(round(folds) * bent - generator.uniform(0, 2 * np.pi))) / 2
    return valleys + (crests - valleys) * wave**1.3


def _moved(radii: Float[ndarray, "angles"], shift: complex) -> Float[ndarray, "angles"]:
    """A closed outline seen beside its place."""
    points = radii * np.exp(1j * _THETA) + shift
    angle, order = np.angle(points) % (2 * np.pi), np.argsort(np.angle(points) % (2 * np.pi))
    return np.interp(_THETA, angle[order], np.abs(points)[order], period=2 * np.pi)


def _off_centre(radii: Float[ndarray, "angles"], shift: complex) -> Float[ndarray, "angles"]:
    """What hangs farther out moves more."""
    share = (radii - radii.min()) / max(float(np.ptp(radii)), 1e-9)
    return radii + share * np.real(shift * np.exp(-1j * _THETA))


PLANTED: Mapping[str, Callable[[ndarray, Mapping[str, float]], ndarray]] = {
    "camera-offset": lambda r, v: _moved(r, v["shift"] * np.exp(1j * np.deg2rad(v["direction"]))),
    "off-centre": lambda r, v: _off_centre(r, v["shift"] * np.exp(1j * np.deg2rad(v["direction"]))),
    "camera-scale": lambda r, v: r * (1 + v["error"]),
    "threshold": lambda r, v: r + v["shift"],
}
"""Effects on an outline as the camera sees it."""


def with_planted(outlines: Outlines, name: str, value: Mapping[str, float]) -> Outlines:
    """Outlines with an effect of the camera or of the laying.

    Args:
        outlines: Radii in the cloth's frame [m].
        name: A key of `PLANTED`.
        value: Its parameters.

    Returns:
        The outlines with it.
    """
    changed = np.empty_like(outlines)
    for sample, faces in enumerate(outlines):
        changed[sample, 0] = PLANTED[name](faces[0], value)
        changed[sample, 1] = PLANTED[name](faces[1][_TURNED], value)[_TURNED]
    return changed


def statistics_of(outlines: Outlines) -> Float[ndarray, "samples 2 statistics"]:
    """Statistics of outlines in the cloth's frame.

    Args:
        outlines: Radii [m].

    Returns:
        One vector a sample and face.
    """
    return capture_statistics(outlines.reshape(-1, ANGLES)).reshape(len(outlines), 2, -1)


@lru_cache(maxsize=1)
def toy_emulator() -> Emulator:
    """The toy atlas, fitted: the base model and the effects of `PLANTED`."""
    design = Design(points=_POINTS, stiff_points=0)
    points: dict[str, dict[int, Point]] = {name: {} for name in (BASE, *PLANTED)}
    for number, theta in enumerate(design.theta()):
        generator = np.random.default_rng([3, number])
        outlines = toy_outlines(theta, _SAMPLES, generator)
        points[BASE][number] = Point(np.zeros(0), statistics_of(outlines))
        for name in PLANTED:
            value = {
                p.name: p.typical * float(np.exp(generator.uniform(-1, 1.5)))
                if p.role == "severity"
                else float(generator.uniform(0, 360))
                for p in effect(name).parameters
            }
            changed = statistics_of(with_planted(outlines, name, value))
            points[name][number] = Point(np.array(list(value.values())), changed)
    assert design.theta().shape == (_POINTS, len(LOW))
    return fit(design, points)
