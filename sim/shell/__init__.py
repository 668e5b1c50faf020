"""Geometry of a Kirchhoff-Love shell on a Loop subdivision surface: what law `plate` integrates over.

control_mesh: the control mesh, extended across the clamp and the rim; loop_rows: derivatives of the limit surface at
the midpoints of edges; vertex_rows: slopes at the vertices; coefficients: which entries of the stiffness tables belong
to an edge or a vertex; rest_curvature: curvature from stress-free dihedral angles; padded: stencils of unequal size in
one array; stencils: `shell_stencils`, all of it for one mesh.
"""
