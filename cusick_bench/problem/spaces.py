"""The registered parameter spaces; a name does not wait for its space."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import LazyTable

if TYPE_CHECKING:
    from cusick_bench.problem.space import ParameterSpace

SPACES: "LazyTable[type[ParameterSpace]]" = LazyTable(
    {
        "homo": "cusick_bench.problem.space:HomogeneousSpace",
        "heter": "cusick_bench.problem.space:HeterogeneousSpace",
        "field": "cusick_bench.problem.field_space:FieldSpace",
    }
)
DEFAULT_SPACE = "homo"
"""Of a solver that works in any space."""
