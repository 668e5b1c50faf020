"""The piece of cloth: mesh, stiffness tables, and how shape and stiffness vary over it.

mesh: `disc_mesh`, `Mesh`; ring_mesh: discs in staggered rings; conform: a ring of vertices moved onto the plate's edge;
material: `Material`, `uniform_material`, `project_admissible`; membrane: membranes softened for coarse meshes;
shape: laid-down shapes and rest shapes; heterogeneity, matern: random fields of stiffness; warp: cloth that lies off
centre or has another cut; rim: the rim as a smooth curve; folds: number of folds of a closed curve; obj: mesh files;
resolution: the mesh of each law.
"""
