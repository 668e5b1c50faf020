"""A fabric's stiffness as the material of another program. One module a program, and `PROGRAMS` knows them.

DIR/README.md       what carries over, what does not, and the values with their intervals
DIR/...             what the program reads, or the table to be typed in
"""

from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.export.material.program import Program
from cusick_bench.export.material.programs import PROGRAMS, write_material
from cusick_bench.export.material.result import read_material

__all__ = ["PROGRAMS", "FabricMaterial", "Program", "read_material", "write_material"]
