"""The mechanical systems for drops, descents and their adjoints: of laws with hinges, and of law `plate`.

Both have the same interface: `evaluate` computes forces, energy and matrix of a batch's configurations; `adjoint`,
`layout`, `linear`, `free`, `fixed`, `spring`. Configurations are arrays over the mesh's vertices, which hold positions
of the vertices, or of the control points of a shell (see `plate.unknowns`).
"""

from cusick_bench.sim.engine.plate.system import ShellEvaluation, ShellSystem
from cusick_bench.sim.engine.triangles.system import DrapeSystem, Evaluation

ClothSystem = DrapeSystem | ShellSystem
"""A cloth on its support, under gravity, with one material law."""

Evaluated = Evaluation | ShellEvaluation
"""A batch's elements at its configurations; valid until the system's next evaluation."""
