"""Stiffness from drapes of known shape: the convex problem behind the equilibrium gap, and what it leaves undetermined.

At rest elastic forces balance gravity, A(x) theta + b = 0 at every free vertex. The equation is linear in the tables
theta = (C, B) (see `engine.triangles.force_basis`), and gravity b sets the scale. Shapes are measured with errors,
which cause large forces in the stiff membrane, and no cloth is as uniform as its model. With displacement errors
N(0, s_x^2) and force errors N(0, D), D the square of a share of each vertex's weight plus the forces of an uneven cloth
(`cusick_bench.sim.engine.triangles.force_modes`), the gap linearised at the corrected shape x_k = x + d_k is

    A(x_k) theta + b + H_k d_k ~ N(0, s_x^2 H_k H_k^T + D),    H = -df/dx,

and theta minimises its whitened square plus |tau|^2, tau the prior's whitened vector, linearised at theta_k, over
admissible tables: [[c11, c12], [c12, c22]] positive definite and c33 > 0 at every strain sample, B > 0. Each round
corrects the shape by the most likely displacement and solves anew: an errors-in-variables form of the reconditioned
gap, without which noisy shapes look too soft.

How well the data alone determine theta is shown by the singular values s of the whitened map, per relative change of
theta: along a singular vector theta is known with a relative standard deviation of 1 / s.

References:
    Claire, Hild, Roux, A finite element formulation to identify damage fields: the equilibrium gap method, Int. J.
    Numerical Methods in Engineering 61(2), 2004.
    Fuller, Measurement Error Models, 1987, Section 3.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.linalg import cholesky, solve_triangular

from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE, StiffnessPrior
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.triangles.force_basis import STRETCH_NUMBERS, TABLE_NUMBERS, stiffness, unit_forces
from cusick_bench.sim.engine.triangles.force_modes import field_modes, uneven_forces
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.solvers.base import SolverError

ROUNDS = 12
SETTLED = 5e-3  # change of tau between rounds [prior standard deviations]
REACH = 3.0  # largest factor on a table entry in one round
MARGIN = 1e-3  # least eigenvalue of C over the mean of its diagonal
KNOWN = 0.05  # relative standard deviation up to which a combination of entries counts as identifiable
UNKNOWN = 1e6  # relative standard deviation beyond which nothing is known

NAMES = tuple(f"C[{row},{name}]" for row in range(6) for name in ("c11", "c12", "c22", "c33")) + tuple(
    f"B[{direction},{curvature}]" for direction in ("0", "45", "90") for curvature in ("0", "10", "20", "30", "40")
)

Theta = Float[np.ndarray, " 39"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A drape at rest.

    Attributes:
        system: Mesh, law and support.
        x: Positions [m].
        mass: Mass of the vertices [kg].
    """

    system: DrapeSystem
    x: Float[np.ndarray, "vertices 3"]
    mass: Float[np.ndarray, " vertices"]

    @property
    def gravity(self) -> Float[np.ndarray, " coordinates"]:
        """Gravity's forces on the free vertices [N]."""
        load = np.zeros((len(self.system.free), 3))
        load[:, 2] = -self.system.gravity * self.mass[self.system.free]
        return load.ravel()


@dataclass(frozen=True)
class Errors:
    """How far measured shapes and the model's forces are off.

    Attributes:
        position: Standard deviation of a vertex's coordinate [m].
        force: Standard deviation of the force on a vertex, as a share of its weight.
        rest_height: Standard deviation of the rest shape's height, which is not known [m].
        rest_length: Its correlation length [m].
        unevenness: Standard deviation of log stiffness over the cloth, of which the tables are the mean.
        unevenness_length: Its correlation length [m].
    """

    position: float
    force: float
    rest_height: float = 0.0
    rest_length: float = 0.03
    unevenness: float = 0.0
    unevenness_length: float = 0.02

    def __post_init__(self) -> None:
        for name in ("position", "force", "rest_length", "unevenness_length"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SolverError(f"the {name} error must be > 0 and finite, got {value}; give what the meshes have")
        for name in ("rest_height", "unevenness"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise SolverError(f"the {name} error must be >= 0 and finite, got {value}; 0 for an even, flat cloth")

    def modes(self, mesh: Mesh) -> tuple[Float[np.ndarray, "vertices rest"], Float[np.ndarray, "vertices uneven"]]:
        """Modes of the rest shape's height [m] and of log stiffness; none where there is no spread.

        Args:
            mesh: The flat cloth.

        Returns:
            One column a mode, for heights and for log stiffness.
        """
        fields = ((self.rest_height, self.rest_length), (self.unevenness, self.unevenness_length))
        rest, uneven = (
            amplitude * field_modes(mesh, length) if amplitude > 0 else np.zeros((mesh.vertices, 0))
            for amplitude, length in fields
        )
        return rest, uneven


@dataclass(frozen=True, eq=False)
class Balance:
    """The stiffness that balances gravity, and how well it is known.

    Attributes:
        theta: C and B in one row [N/m, N m].
        tau: The same, whitened by the prior.
        relative_sd: Relative standard deviation of every entry from the data alone (c12: relative to sqrt(c11 c22)).
        singular_values: Singular values of the whitened map per relative change, descending.
        directions: Its right singular vectors, one a row.
        misfit: Mean square of the whitened gap; about 1 where the errors are as assumed.
        correction: Root mean square of the displacements that balance needs [m].
        unexplained: Norm of the force that no admissible table balances at the shape as measured, over gravity's.
    """

    theta: Theta
    tau: Theta
    relative_sd: Theta
    singular_values: Float[np.ndarray, " 39"]
    directions: Float[np.ndarray, "39 39"]
    misfit: float
    correction: float
    unexplained: float

    @property
    def identifiable(self) -> Bool[np.ndarray, " 39"]:
        """Which singular directions the data fix to 5 %."""
        return self.singular_values > 1 / KNOWN


def whitened(prior: StiffnessPrior, theta: Theta) -> Theta:
    """The vector tau of admissible tables: inverse of the prior's `stretch` and `bending`.

    Args:
        prior: The prior of stiffness.
        theta: C and B in one row [N/m, N m].

    Returns:
        Whitened vector tau.
    """
    table, bending = theta[:STRETCH_NUMBERS].reshape(6, 4), theta[STRETCH_NUMBERS:].reshape(3, 5)
    return np.concatenate([prior.stretch_tau(table), prior.bending_tau(bending)])


def tables_at(prior: StiffnessPrior, tau: Theta) -> tuple[Theta, Float[np.ndarray, "39 39"]]:
    """theta of a whitened vector, and its derivative.

    Args:
        prior: The prior of stiffness.
        tau: Whitened vector.

    Returns:
        C and B in one row [N/m, N m], and their derivatives by tau.
    """

    def both(vector: torch.Tensor) -> torch.Tensor:
        stretch, bending = vector.split([STRETCH_SIZE, BENDING_SIZE])
        return torch.cat([prior.stretch(stretch).flatten(), prior.bending(bending).flatten()])

    point = torch.as_tensor(tau)
    slope = torch.autograd.functional.jacobian(both, point)
    assert isinstance(slope, torch.Tensor)
    return both(point).numpy(), slope.numpy()


def relative_scale(theta: Theta) -> Theta:
    """Unit of a relative change of every entry: itself, and for c12 the geometric mean of c11 and c22.

    Args:
        theta: C and B in one row [N/m, N m].

    Returns:
        What an entry is relative to [N/m, N m].
    """
    scale = theta.copy()
    table = scale[:STRETCH_NUMBERS].reshape(6, 4)
    table[:, 1] = np.sqrt(table[:, 0] * table[:, 2])
    return scale


@dataclass(frozen=True, eq=False)
class _Gap:
    """A whitened gap: map and offset of one shape, and the way back to displacements."""

    columns: Float[np.ndarray, "coordinates 39"]
    offset: Float[np.ndarray, " coordinates"]
    factor: Float[np.ndarray, "coordinates coordinates"]
    hessian: Float[np.ndarray, "coordinates coordinates"]
    position: float

    def displacement(self, theta: Theta) -> Float[np.ndarray, " coordinates"]:
        """Most likely error of the measured shape, given the tables [m]."""
        whitened = self.columns @ theta + self.offset
        return self.position**2 * self.hessian.T @ solve_triangular(self.factor, whitened, trans=1, lower=True)


def _gap(
    shape: Shape, correction: np.ndarray, theta: Theta, errors: Errors, modes: tuple[np.ndarray, np.ndarray]
) -> _Gap:
    system, rest = shape.system, np.zeros(len(shape.system.elements.hinges))
    x = shape.x.copy()
    x[system.free] += correction.reshape(-1, 3)
    hessian = stiffness(system, x, theta, rest).toarray()
    weight = np.repeat(system.gravity * shape.mass[system.free], 3)
    uneven = uneven_forces(system, x, theta, *modes)
    covariance = errors.position**2 * (hessian @ hessian.T) + uneven @ uneven.T
    covariance[np.diag_indices_from(covariance)] += (errors.force * weight) ** 2
    factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
    sides = np.column_stack([unit_forces(system, x, rest), shape.gravity + hessian @ correction])
    sides = solve_triangular(factor, sides, lower=True, check_finite=False)
    return _Gap(sides[:, :-1], sides[:, -1], factor, hessian, errors.position)


def _admissible_fit(
    columns: np.ndarray, offset: np.ndarray, tau: Theta, theta: Theta, slope: np.ndarray, law: str
) -> Theta:
    """Tables with the least whitened gap and |tau|^2, linearised at `tau`; a convex programme."""
    import cvxpy as cp  # slow to import, and few need it

    scale = relative_scale(theta)
    whole = np.column_stack([columns * scale, offset])
    triangle = np.asarray(np.linalg.qr(whole, mode="r"))
    share = cp.Variable(TABLE_NUMBERS)  # theta over scale
    prior = np.linalg.solve(slope, np.diag(scale))
    found = cp.multiply(share, scale)
    gap = triangle[:, :-1] @ share + triangle[:, -1]
    pull = prior @ share + (tau - np.linalg.solve(slope, theta))
    c11, c12, c22, c33 = (found[i:STRETCH_NUMBERS:4] / theta[[0, 2]].mean() for i in range(4))
    positive = np.delete(np.arange(TABLE_NUMBERS), np.arange(1, STRETCH_NUMBERS, 4))
    constraints: list[cp.Constraint] = [
        # [[c11, c12], [c12, c22]] >= margin I as a cone
        cp.SOC(c11 + c22 - 2 * MARGIN, cp.vstack([c11 - c22, 2 * c12]), axis=0),
        c33 >= MARGIN,
        share[positive] >= 1 / REACH,
        share[positive] <= REACH,
    ]
    if law == "published":
        constraints.append(c12 >= 0)  # its tables are read linearly only where they are not negative
    problem = cp.Problem(cp.Minimize(cp.sum_squares(gap) + cp.sum_squares(pull)), constraints)
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError as error:
        raise SolverError(
            f"the convex programme of the force balance failed: {error}; check mesh and density"
        ) from error
    if share.value is None:
        raise SolverError(f"the convex programme of the force balance ended {problem.status}; check mesh and density")
    return share.value * scale


def balance(shapes: Sequence[Shape], prior: StiffnessPrior, errors: Errors) -> Balance:
    """Fits one C and one B to drapes of known shape.

    Args:
        shapes: Drapes of one cloth, at rest.
        prior: Where the tables lie without data.
        errors: Errors of shapes and forces.

    Returns:
        The fit with what it knows.

    Raises:
        SolverError: No shape, or the convex programme fails.
    """
    if not shapes:
        raise SolverError("the force balance needs at least one drape of known shape, got none")
    law, tau = shapes[0].system.law, np.zeros(TABLE_NUMBERS)
    theta, slope = tables_at(prior, tau)
    corrections = [np.zeros(3 * len(shape.system.free)) for shape in shapes]
    modes = [errors.modes(shape.system.mesh) for shape in shapes]
    gaps: list[_Gap] = []
    for _ in range(ROUNDS):
        gaps = [_gap(s, d, theta, errors, m) for s, d, m in zip(shapes, corrections, modes, strict=True)]
        columns, offset = np.concatenate([g.columns for g in gaps]), np.concatenate([g.offset for g in gaps])
        found = _admissible_fit(columns, offset, tau, theta, slope, law)
        before, tau = tau, whitened(prior, found)
        theta, slope = tables_at(prior, tau)
        corrections = [gap.displacement(theta) for gap in gaps]
        if np.abs(tau - before).max() < SETTLED:
            break
    return _summary(shapes, gaps, corrections, theta, tau)


def _summary(
    shapes: Sequence[Shape], gaps: list[_Gap], corrections: list[np.ndarray], theta: Theta, tau: Theta
) -> Balance:
    gap = np.concatenate([gap.columns @ theta + gap.offset for gap in gaps])
    misfit = float(np.mean(gap**2))
    # where errors are larger than assumed, what is known is known less well
    relative = np.concatenate([gap.columns for gap in gaps]) * relative_scale(theta) / max(misfit, 1.0) ** 0.5
    _, values, directions = np.linalg.svd(relative, full_matrices=False)
    spread = 1 / np.maximum(values, 1 / UNKNOWN)
    return Balance(
        theta=theta,
        tau=tau,
        relative_sd=np.sqrt(((directions.T * spread) ** 2).sum(1)),
        singular_values=values,
        directions=directions,
        misfit=misfit,
        correction=float(np.sqrt(np.mean(np.concatenate(corrections) ** 2))),
        unexplained=_unexplained(shapes),
    )


def _unexplained(shapes: Sequence[Shape]) -> float:
    """Least norm of elastic plus gravity forces over tables with entries >= 0, over that of gravity: 1 without any."""
    from scipy.optimize import nnls

    rest = [np.zeros(len(shape.system.elements.hinges)) for shape in shapes]
    columns = np.concatenate([unit_forces(s.system, s.x, r) for s, r in zip(shapes, rest, strict=True)])
    load = np.concatenate([shape.gravity for shape in shapes])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    _, left = nnls(columns / size, -load, maxiter=100 * TABLE_NUMBERS)
    return float(left / np.linalg.norm(load))
