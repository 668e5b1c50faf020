"""Newton (newton-physics), solver VBD: keyword arguments of `ModelBuilder.add_cloth_mesh`.

Bending. VBD's energy of an inner edge of rest length L is 1/2 edge_ke L (theta - theta0)^2, with theta the angle
between the normals, so that edge_ke has the unit N and depends on the mesh. In a mesh of equilateral triangles of edge
l on a curved surface, an edge along which the normal curvature is k_t, and across which it is k_n, has

    theta = l (3 k_n - k_t) / (2 sqrt(3)).

For a cylinder of curvature k whose axis makes the angle a with the edge this is l k (1 + 2 cos 2a) / (2 sqrt(3)). The
three families of edges have a, a + 60 and a + 120 degrees, and the sum of (1 + 2 cos 2a)^2 over them is 9 for every a.
There is half an edge of each family per triangle of area sqrt(3) l^2 / 4, so that the energy per area is

    sqrt(3) / 4 edge_ke l k^2 = 1/2 B k^2,   edge_ke = 2 B / (sqrt(3) l),

as Seung and Nelson (1988) have it for edge_ke l. Such a mesh bends alike in all directions, with a Poisson's ratio of
bending of -1/3. B is the geometric mean of warp, weft and the two diagonals.

In plane. tri_ke and tri_ka are the Lamé parameters mu and lambda of a neo-Hookean membrane [N/m], whose energy at small
strain is mu eps:eps + lambda/2 tr(eps)^2. So mu is the shear stiffness and lambda + 2 mu the stretch stiffness at no
strain across it, of which the geometric mean of warp and weft is taken. Where shear is stiffer than half of stretch,
lambda would be negative: then lambda is 0 and mu half of the stretch stiffness.

References:
    newton-physics/newton at commit 41a5392c: `ModelBuilder.add_cloth_mesh` (newton/_src/sim/builder.py),
    `evaluate_dihedral_angle_based_bending_force_hessian` and `evaluate_neo_hookean_membrane_force_hessian`
    (newton/_src/solvers/vbd/particle_vbd_kernels.py). Other solvers of Newton use these arguments differently.
    Seung, Nelson. Defects in flexible membranes with crystalline order. Physical Review A 38, 1988.
"""

from __future__ import annotations

import json
import math

from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.export.material.program import Program
from cusick_bench.export.written import fill, literal

EDGE_LENGTH = 0.01
"""Edge length that values are written for where none is given [m]."""


def edge_stiffness(bending: float, edge_length: float) -> float:
    """`edge_ke` of a mesh of equilateral triangles, 2 B / (sqrt(3) l).

    Args:
        bending: Bending stiffness B [N m].
        edge_length: Edge length l [m].

    Returns:
        Stiffness per edge length [N].
    """
    return 2 * bending / (math.sqrt(3) * edge_length)


def membrane_stiffness(stretch: float, shear: float) -> tuple[float, float]:
    """`tri_ke` and `tri_ka`, the Lamé parameters mu and lambda.

    Args:
        stretch: Stretch stiffness lambda + 2 mu [N/m].
        shear: Shear stiffness mu [N/m]; at most half of the stretch stiffness is taken.

    Returns:
        mu and lambda [N/m].
    """
    mu = min(shear, stretch / 2)
    return mu, stretch - 2 * mu


def keyword_arguments(fabric: FabricMaterial, edge_length: float) -> dict[str, float]:
    """Arguments of `add_cloth_mesh`, apart from the mesh and its place.

    Damping is 0: a drape at rest says nothing of it.

    Args:
        fabric: The fabric.
        edge_length: Mean edge length of the mesh [m].

    Returns:
        Values by keyword.
    """
    mu, area = membrane_stiffness(fabric.mean_stretch.value, fabric.stretch["shear"].value)
    bending = edge_stiffness(fabric.mean_bending.value, edge_length)
    return {
        "density": fabric.density,
        "tri_ke": mu,
        "tri_ka": area,
        "tri_kd": 0.0,
        "edge_ke": bending,
        "edge_kd": 0.0,
    }


def _files(fabric: FabricMaterial, edge_length: float | None) -> dict[str, str]:
    length = EDGE_LENGTH if edge_length is None else edge_length
    arguments, interval = keyword_arguments(fabric, length), fabric.mean_bending.ci90
    document = {
        "fabric": fabric.name,
        "add_cloth_mesh": arguments,
        "edge_length_m": length,
        "edge_ke_ci90": interval and [edge_stiffness(end, length) for end in interval],
    }
    script = fill(
        "material/newton.py",
        name=literal(fabric.name),
        bending=fabric.mean_bending.value,
        arguments={key: value for key, value in arguments.items() if key != "edge_ke"},
    )
    return {"newton.json": json.dumps(document, indent=1, allow_nan=False) + "\n", "newton_cloth.py": script}


NEWTON = Program(
    name="newton",
    title="Newton (newton-physics), solver VBD",
    files=_files,
    use="`newton.json` holds the keyword arguments of `ModelBuilder.add_cloth_mesh` for one edge length; "
    "`newton_cloth.py` computes them for the edge length of your own mesh, in metres and after its scale.",
    kept=(
        "Areal density.",
        "Bending stiffness, averaged over directions, on meshes of nearly equilateral triangles: `edge_ke` = "
        "2 B / (sqrt(3) l) for edge length l. On another mesh it has to be computed again.",
        "Stretch and shear stiffness, averaged over warp and weft, at small strain.",
    ),
    lost=(
        "Anisotropy: `add_cloth_mesh` gives all edges one stiffness, the geometric mean of warp, weft and both "
        "diagonals.",
        "Dependence of bending stiffness on curvature, and of stretch on strain.",
        "Poisson's ratio of bending, which edges of equilateral triangles fix at -1/3.",
        "Damping, which a drape at rest does not show; it is set to 0.",
        "A shear stiffness of more than half the stretch stiffness, which an isotropic membrane is not given here.",
    ),
    source="Energies of Newton's own code (solver VBD, commit 41a5392c); the bending factor is derived in "
    "`cusick_bench.export.material.newton` and tested on triangulated cylinders. Newton itself was not run. Its other "
    "solvers use the same arguments differently.",
    needs_edge_length=True,
)
"""Newton's VBD."""
