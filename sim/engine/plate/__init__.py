"""Forces of law `plate`, at the quadrature points of a shell on a subdivision surface (see `cusick_bench.sim.shell`).

system: `ShellSystem`, forces, stiffness and adjoint; layout, workspace: index tables and buffers of its points;
placement: the undeformed cloth on the plate; points, kernels, adjoint_kernels, block_sums: compiled code; unknowns:
maps between vertices and control points; secants: plates of constant stiffness with the same moments.
"""
