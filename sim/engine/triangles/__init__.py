"""Forces of laws with hinges (`paper`, `published`): of triangles that stretch and of the hinges between them.

system: `DrapeSystem`, forces, stiffness and adjoint; elements, layout, assembly, workspace, face_kernels and
hinge_kernels: its parts; force_basis, force_modes: forces as linear functions of stiffness tables and of random fields.
"""
