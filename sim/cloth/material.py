"""Cloth parameters: stretch stiffness C per face, bending stiffness B per hinge, areal density.

C is a table (6, 4): rows are strain samples (0 at rest; 1..5 stretched along 0, 22.5, 45, 67.5, 90 degrees), columns
c11, c12, c22, c33. B is a table (3, 5): rows are hinge directions 0, 45, 90 degrees from the warp, columns curvatures
0, 10, 20, 30, 40 per metre. Under laws `plate` and `paper` B is the bending stiffness of the plate; under law
`published` the plate bends as if it had a quarter of the tabulated stiffness (`PUBLISHED_BENDING_FACTOR`).
"""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

PUBLISHED_BENDING_FACTOR = 4.0
"""Tabulated over effective bending stiffness under law `published`.

Its hinge stiffness is B l^2 / (4 (A1 + A2)); on equilateral triangles bent to a cylinder, summing hinges gives the
energy density of a plate when the hinge stiffness is B l^2 / (A1 + A2)."""

STRETCH_SAMPLES = 6
BENDING_SHAPE = (3, 5)


@dataclass(frozen=True, eq=False)
class Material:
    """A cloth; arrays of numpy are copied, tensors are kept with their gradients.

    Attributes:
        stretch: C, shared (6, 4) or per face [N/m].
        bending: B, shared (3, 5) or per hinge [N m].
        density: Areal density, shared () or per face [kg/m2].
        poisson: Poisson's ratio of bending, () in (-1, 1), which law `plate` has: D12 = poisson sqrt(D11 D22).

    Raises:
        SimulationError: Wrong shape, a value that is not finite, or a density that is not positive.
    """

    stretch: Float[Tensor, "*#faces 6 4"]
    bending: Float[Tensor, "*hinges 3 5"]
    density: Float[Tensor, "*#faces"]
    poisson: Float[Tensor, ""] = field(default_factory=lambda: torch.zeros((), dtype=torch.float64))

    def __post_init__(self) -> None:
        for name, shape, unit in (("stretch", (6, 4), "N/m"), ("bending", (3, 5), "N m"), ("density", (), "kg/m2")):
            given = getattr(self, name)
            value = torch.as_tensor(given.copy() if isinstance(given, np.ndarray) else given, dtype=torch.float64)
            object.__setattr__(self, name, value)
            if value.shape[value.ndim - len(shape) :] != shape or value.ndim > len(shape) + 1:
                raise SimulationError(
                    f"{name} must have shape {shape}, or one such table per element; got {tuple(value.shape)}"
                )
            if not torch.isfinite(value).all():
                where = tuple(int(i) for i in torch.nonzero(~torch.isfinite(value))[0])
                found = float(value.detach()[where])
                raise SimulationError(f"{name} must be finite [{unit}], got {found} at index {where}")
        object.__setattr__(self, "poisson", torch.as_tensor(self.poisson, dtype=torch.float64))
        if self.poisson.ndim or not abs(float(self.poisson.detach())) < 1:
            raise SimulationError(f"Poisson's ratio must be one number within -1 and 1, got {self.poisson.tolist()}")
        if (self.density <= 0).any():
            least = float(self.density.detach().min())
            raise SimulationError(f"areal density must be > 0 kg/m2, got {least:g}; weigh it, or see fabrics.csv")

    def check_fits(self, mesh: Mesh) -> None:
        """Checks that per-element parameters belong to this mesh.

        Args:
            mesh: The cloth.

        Raises:
            SimulationError: The number of tables differs from the number of elements.
        """
        for name, inner, count, element in (
            ("stretch", 2, len(mesh.faces), "faces"),
            ("bending", 2, len(mesh.hinges), "hinges"),
            ("density", 0, len(mesh.faces), "faces"),
        ):
            value = getattr(self, name)
            if value.ndim > inner and len(value) != count:
                raise SimulationError(
                    f"{name} has {len(value)} tables but the mesh has {count} {element}; use the mesh it was made for"
                )

    def vertex_mass(self, mesh: Mesh) -> Float[Tensor, "vertices"]:
        """Lumped masses: a third of every adjacent face's mass [kg].

        Args:
            mesh: The cloth.

        Returns:
            Masses, differentiable by the density.
        """
        areas = torch.from_numpy(mesh.areas).to(self.density.device)
        share = (self.density * areas / 3).repeat_interleave(3)
        corners = torch.from_numpy(mesh.faces.ravel()).to(self.density.device)
        return torch.zeros(mesh.vertices, dtype=torch.float64, device=share.device).index_add(0, corners, share)


def uniform_material(
    *, density: float, bending: float | tuple[float, float, float], stretch: float = 300.0, shear: float = 60.0,
    poisson: float = 0.0,
) -> Material:  # fmt: skip
    """A cloth whose stiffness depends neither on strain nor on curvature.

    Args:
        density: Areal density [kg/m2].
        bending: Table value of B, one for all directions or (0, 45, 90 degrees) [N m].
        stretch: Membrane stiffness along warp and weft, in force per width at unit strain [N/m]; Poisson's ratio 0.
        shear: Shear stiffness, in force per width at unit shear angle [N/m].
        poisson: Poisson's ratio of bending, which law `plate` has.

    Returns:
        The cloth, homogeneous.

    Raises:
        SimulationError: A value is not positive and finite, bending is neither one number nor three, or a value is a
            tensor with a gradient, which the cloth's tables would not have.
    """
    given = {"density": density, "bending": bending, "stretch": stretch, "shear": shear, "poisson": poisson}
    for name, value in given.items():
        if _has_gradient(value):
            table = "stretch" if name == "shear" else name
            raise SimulationError(
                f"{name} must be a number, got a tensor with a gradient, which the cloth would not pass on; make the "
                f"cloth of numbers and ask for the gradient of its {table} (requires_grad_), or make a Material of "
                "tensors"
            )
    numbers = np.asarray(bending, dtype=np.float64)
    if numbers.shape not in ((), (1,), (3,)):
        raise SimulationError(
            f"bending must be one number or three (hinges at 0, 45, 90 degrees to the warp), got shape {numbers.shape}"
        )
    rows = np.broadcast_to(numbers, (3,))
    for name, value in (("bending", rows.min()), ("stretch", stretch), ("shear", shear)):
        if not (np.isfinite(value) and value > 0):
            raise SimulationError(f"{name} stiffness must be > 0 and finite, got {value:g}")
    # The law doubles the table; shear energy k3 G01^2 = (k3 / 4) angle^2, so k3 is twice the shear stiffness.
    table = torch.tensor([stretch / 2, 0.0, stretch / 2, shear], dtype=torch.float64).repeat(STRETCH_SAMPLES, 1)
    tables = torch.from_numpy(np.repeat(rows[:, None], 5, axis=1))
    return Material(
        table, tables, torch.tensor(density, dtype=torch.float64), torch.tensor(poisson, dtype=torch.float64)
    )


def _has_gradient(value: object) -> bool:
    if isinstance(value, Tensor):
        return value.requires_grad
    return isinstance(value, tuple | list) and any(map(_has_gradient, value))


def project_admissible(material: Material, *, margin: float = 1e-3) -> Material:
    """The nearest admissible cloth: every [[c11, c12], [c12, c22]] positive definite, c33 and B positive.

    Solves one convex programme (least squares under second-order cones, each scaled by its table's mean), which has no
    gradient.

    Args:
        material: Any finite tables, e.g. Gaussian draws.
        margin: Smallest eigenvalue and entry, as a fraction of the table's mean magnitude, > 0.

    Returns:
        The cloth with the least squared change; the same numbers (to solver accuracy) where it was admissible.

    Raises:
        SimulationError: A margin of 0 or less, tables without any magnitude, stretch tables with a gradient, or a
            programme that ends without a solution.
    """
    if material.stretch.requires_grad and torch.is_grad_enabled():
        raise SimulationError(
            "stretch tables to be projected must have no gradient, which the projection would not pass on; detach "
            "them, or project under torch.no_grad()"
        )
    if not (np.isfinite(margin) and margin > 0):
        raise SimulationError(f"the margin must be > 0 and finite, got {margin}: stiffness of 0 is not admissible")
    import cvxpy as cp  # slow to import, and no drape needs it

    table = material.stretch.detach().cpu().numpy().reshape(-1, 4)
    scale, size = float(np.abs(table[:, [0, 2]]).mean()), float(material.bending.detach().abs().mean())
    for name, magnitude in (("stretch", scale), ("bending", size)):
        if magnitude == 0:
            raise SimulationError(f"{name} must have a magnitude to be projected, and all of its entries are 0")
    given = table / scale
    found = cp.Variable(given.shape)
    # [[c11, c12], [c12, c22]] >= margin I as a cone: |(c11 - c22, 2 c12)| <= c11 + c22 - 2 margin
    constraints: list[cp.Constraint] = [
        cp.SOC(found[:, 0] + found[:, 2] - 2 * margin, cp.vstack([found[:, 0] - found[:, 2], 2 * found[:, 1]]), axis=0),
        found[:, 3] >= margin,
    ]
    weights = np.sqrt(np.array([1.0, 2.0, 1.0, 1.0]))  # Frobenius norm of the symmetric matrix
    problem = cp.Problem(cp.Minimize(cp.sum_squares(cp.multiply(found - given, weights[None, :]))), constraints)
    problem.solve(solver=cp.CLARABEL)
    if found.value is None:
        raise SimulationError(f"cannot project the stretch tables: the convex programme ended {problem.status}")
    stretch = torch.from_numpy(found.value * scale).reshape(material.stretch.shape)
    bending = material.bending.clamp_min(margin * size)
    return Material(stretch.to(material.stretch.device), bending, material.density, material.poisson)
