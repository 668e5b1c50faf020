"""A plate of cubic B-splines on a polar grid: a discretisation that is no triangle mesh and shares no code with `sim`.

splines: one-dimensional bases; outer_edge: where the cut runs; grid: their tensor product on a cloth beside its plate;
kernels: forces and stiffness at the points of integration; band: solver; plate: the mechanical system; drop: its fall;
history: its laws with internal variables; world: the world that hangs from it.
"""
