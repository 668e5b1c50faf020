"""The mechanical systems that drops, descents and their adjoints take: of laws with hinges, and of law `plate`.

Both offer the same: `evaluate` a batch's configurations into forces, energy and matrix, `adjoint`, `layout`, `linear`,
`free`, `fixed`, `spring`. Configurations are arrays over the mesh's vertices; what stands there is the system's
(vertices, or the control points of a shell, see `plate.unknowns`).
"""

from cusick_bench.sim.engine.plate.system import ShellEvaluation, ShellSystem
from cusick_bench.sim.engine.triangles.system import DrapeSystem, Evaluation

ClothSystem = DrapeSystem | ShellSystem
"""A cloth on its support, under gravity, with one material law."""

Evaluated = Evaluation | ShellEvaluation
"""A batch's elements at its configurations; valid until the system's next evaluation."""
