"""How far drapes depend on the mesh and on the time step, and how fast they converge.

order: observed order and extrapolated limit; linear_plate: an exact solution; reference: drapes of an ideal plate;
mesh_dependence: drapes and their statistics from mesh to mesh; time_step: drops against rests, and shorter steps.
"""
