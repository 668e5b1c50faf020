"""Blender's cloth modifier with the angular bending model: a script that sets it on the active object.

Blender's fields are not in SI units: gravity is multiplied by 0.001 before it acts on a vertex's mass, so a force of 1
in its code holds up 1 N of a cloth whose mass is given in grams. With masses in grams all stiffnesses are SI numbers.
Only the balance of weight and stiffness, the shape at rest, is converted in this way; time is not.

Squares of side l, cloth bent along the mesh's lines:

- Bending. The force on each of two faces is k (theta - theta0), k = 0.1 bending_stiffness l, shared by the face's four
  corners, while each end of the edge gets half of it back. The two far corners so turn about the edge by
  0.1 bending_stiffness l theta l / 2, which a plate does by B theta: bending_stiffness = 20 B / l^2.
- Shear. Each diagonal is a spring of stiffness shear_stiffness / l, the mean edge length: two of them store
  1/2 (shear_stiffness / l) l^2 gamma^2, so shear_stiffness = G l.
- Tension. An edge's spring of stiffness tension_stiffness / l carries a strip of width l, to which the diagonals add G:
  tension_stiffness = (C - G) l, at least a tenth of C l; compression_stiffness likewise.

Equilateral triangles of edge l:

- Bending. A face has three corners and the far one stands sqrt(3) l / 2 off the edge: the torque is
  0.1 bending_stiffness l theta l / (2 sqrt(3)), which is edge_ke l theta with edge_ke = 2 B / (sqrt(3) l) (see
  `cusick_bench.export.material.newton`): bending_stiffness = 40 B / l^2.
- Tension. A lattice of springs s has lambda = mu = sqrt(3) s / 4, so that C = 3 sqrt(3) s / 4:
  tension_stiffness = 4 C l / (3 sqrt(3)); there are no diagonals, and shear follows as C / 3.

References:
    blender/blender, source/blender/simulation/intern: `cloth_calc_spring_force` and `cloth_calc_force`
    (SIM_mass_spring.cpp), `SIM_mass_spring_force_spring_angular` (implicit_blender.cc); mean spring length and corners
    of faces in blenkernel/intern/cloth.cc.
"""

from __future__ import annotations

from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.export.material.program import Program
from cusick_bench.export.written import fill, literal


def _files(fabric: FabricMaterial, edge_length: float | None) -> dict[str, str]:
    cloth = {
        "density": fabric.density,
        "bending": fabric.mean_bending.value,
        "stretch": fabric.mean_stretch.value,
        "shear": fabric.stretch["shear"].value,
    }
    return {"blender_cloth.py": fill("material/blender.py", name=literal(fabric.name), cloth=cloth)}


BLENDER = Program(
    name="blender",
    title="Blender, cloth modifier with angular bending",
    files=_files,
    use="Open `blender_cloth.py` in Blender's text editor, select the cloth and run it; or "
    "`blender SCENE.blend --python blender_cloth.py`. The object should have a mesh of nearly equal squares (or "
    "equilateral triangles) in metres; run the script again when its mesh has changed.",
    kept=(
        "Ratios between cloths, whatever the units: on one mesh, bending stiffness over mass has the ratio of B over "
        "areal density.",
        "The balance of weight, bending and stretch at rest, as far as Blender's code says: vertex mass is set in "
        "grams (Blender's field says kg), since gravity is multiplied by 0.001 there.",
    ),
    lost=(
        "Units: Blender's stiffnesses have none that are physical; they depend on the mesh's edge length, and the "
        "script computes them from the object.",
        "Anisotropy: one bending stiffness, the geometric mean of warp, weft and both diagonals; a square mesh has it "
        "along its lines, and bends otherwise between them. Tension is the geometric mean of warp and weft.",
        "Dependence of bending stiffness on curvature, and of stretch on strain.",
        "Motion: time, air and damping are not converted, and are left as they are set in the modifier.",
    ),
    source="Force terms of Blender's own code (SIM_mass_spring.cpp, implicit_blender.cc), as worked out in "
    "`cusick_bench.export.material.blender`. No drape was simulated in Blender to confirm the absolute values.",
)
"""Blender's cloth modifier."""
