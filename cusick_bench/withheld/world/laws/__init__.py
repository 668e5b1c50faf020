"""True laws: each effect's own, different from the one that the package simulates it by, and some beyond its list."""

from collections.abc import Callable, Mapping

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.laws import boundary, contact, history, imaging, material, outside
from cusick_bench.withheld.world.scene import Scene

Law = Callable[[Scene, Mapping[str, float]], Scene]

LAWS: dict[str, Law] = {
    "rest-curvature": material.rest_curvature,
    "face-asymmetry": material.face_asymmetry,
    "grain-skew": material.grain_skew,
    "density-bias": material.density_bias,
    "stiffness-field": material.stiffness_field,
    "local-stiff-patch": material.local_stiff_patch,
    "local-mass-patch": material.local_mass_patch,
    "rim-stiffening": material.rim_stiffening,
    "creep": history.creep,
    "bending-friction": history.bending_friction,
    "shear-friction": history.shear_friction,
    "off-centre": boundary.off_centre,
    "plate-tilt": boundary.plate_tilt,
    "plate-radius": boundary.plate_radius,
    "plate-slip": boundary.plate_slip,
    "cut-size": boundary.cut_size,
    "self-contact": contact.self_contact,
    "camera-scale": imaging.camera_scale,
    "camera-offset": imaging.camera_offset,
    "camera-tilt": imaging.camera_tilt,
    "perspective": imaging.perspective,
    "threshold": imaging.threshold,
}
"""Laws of the package's effects, by their names; parameters have their names and units too."""

OUTSIDE: dict[str, Law] = {
    "draught": outside.draught,
    "charge": outside.charge,
    "seam": outside.seam,
    "crease-ring": outside.crease_ring,
    "elliptical-cut": outside.elliptical_cut,
    "lens": outside.lens,
    "smear": outside.smear,
    "frilled": outside.frilled,
}
"""Laws of what is not on the package's list; labels call all of them `unknown`."""


def law(name: str) -> Law:
    """A law by name.

    Raises:
        WithheldError: No such law.
    """
    found = LAWS.get(name) or OUTSIDE.get(name)
    if found is None:
        raise WithheldError(f"no law of the true world is called {name!r}; use {', '.join((*LAWS, *OUTSIDE))}")
    return found
