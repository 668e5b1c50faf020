"""True law of the effect of class contact: a penalty between points on the cloth.

Points on all faces repel each other along the mean of the cloth's normals there, where they lie closer than the
thickness across it and less than a point's own width beside each other. Points that are near on the flat cloth do not.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial import KDTree

from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.withheld.world.scene import EffectParameters, Law, Scene, Vertices

_CORNERS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6  # barycentric coordinates of a face's points
_BESIDE = 0.0025  # [m]
_FLAT_DISTANCE = 0.012  # [m] on the cloth within which points do not repel each other
_STIFFNESS = 40.0  # weights of a point's cloth per thickness of overlap


def _self_contact(scene: Scene, value: EffectParameters) -> Scene:
    """A cloth whose folds keep off each other."""
    return replace(scene, contact=value["thickness"])


def repulsion(system: DrapeSystem, mass: Float[ndarray, "vertices"], x: Vertices, thickness: float) -> Vertices:
    """Forces between the points of a cloth that come too close to each other.

    Args:
        system: The cloth and its support.
        mass: Masses of the vertices [kg].
        x: Positions of the vertices [m].
        thickness: Distance below which points repel each other [m].

    Returns:
        Forces on the vertices [N].
    """
    loose = system.elements.faces[~system.fixed[system.elements.faces].all(1)]
    point, flat, normal = _points(x, loose), _points(system.mesh.material, loose), _normals(x, loose)
    first, second = KDTree(point).query_pairs(float(np.hypot(thickness, _BESIDE)), output_type="ndarray").T
    far = np.hypot(*(flat[first] - flat[second]).T) > _FLAT_DISTANCE
    first, second = first[far], second[far]
    apart = point[first] - point[second]
    mean = normal[first] + np.sign((normal[first] * normal[second]).sum(1))[:, None] * normal[second]
    mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-12)[:, None]
    gap = (apart * mean).sum(1)
    touching = (np.abs(gap) < thickness) & (np.linalg.norm(apart - gap[:, None] * mean, axis=1) < _BESIDE)
    first, second, gap, mean = first[touching], second[touching], gap[touching], mean[touching]
    weight = 9.8 * mass[loose].sum(1).repeat(len(_CORNERS)) / (3 * len(_CORNERS))
    push = _STIFFNESS * np.minimum(weight[first], weight[second]) * (1 - np.abs(gap) / thickness) * np.sign(gap)
    force = np.zeros_like(point)
    np.add.at(force, first, push[:, None] * mean)
    np.add.at(force, second, -push[:, None] * mean)
    return _spread(force, loose, len(x))


def _points(values: Float[ndarray, "vertices axes"], faces: ndarray) -> Float[ndarray, "points axes"]:
    return np.einsum("pc,fcx->fpx", _CORNERS, values[faces]).reshape(-1, values.shape[1])


def _normals(x: Vertices, faces: ndarray) -> Float[ndarray, "points 3"]:
    a, b, c = (x[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    return np.repeat(normal / np.linalg.norm(normal, axis=1)[:, None], len(_CORNERS), axis=0)


def _spread(force: Float[ndarray, "points 3"], faces: ndarray, vertices: int) -> Vertices:
    """Forces on points, shared out to the corners of their faces."""
    corner = np.einsum("pc,fpx->fcx", _CORNERS, force.reshape(len(faces), len(_CORNERS), 3))
    return np.column_stack([np.bincount(faces.ravel(), corner[..., k].ravel(), vertices) for k in range(3)])


LAWS: dict[str, Law] = {
    "self-contact": _self_contact,
}
"""True laws of the effects of class contact."""
