"""The piece of cloth: mesh, stiffness tables, and how shape and stiffness vary over it.

mesh: `disc_mesh`, `Mesh`; ring_mesh: discs in staggered rings; conform: a ring of vertices moved onto the plate's edge;
material: `Material`, `uniform_material`, `project_admissible`; membrane: cloth that a coarse mesh can bend;
shape: how the cloth is laid down and how it would lie without load; heterogeneity, matern: random fields of stiffness;
warp: cloth that lies or is cut otherwise; folds: how many folds a closed curve has.
"""
