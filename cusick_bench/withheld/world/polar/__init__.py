"""A plate of cubic B-splines on a polar grid: no triangle mesh, and none of the mechanics of `sim`.

splines: one-dimensional bases; outer_edge: where the cut runs; grid: their tensor product on a cloth whose centre may
lie off the plate's axis; material: stiffness at the points of integration; kernels: forces there; band: solver; drop:
the plate under its loads, and its fall; history: laws with internal variables; cloths: all that together.
"""
