"""The registered parameter spaces."""

from cusick_bench.problem.field_space import FieldSpace
from cusick_bench.problem.space import HeterogeneousSpace, HomogeneousSpace, ParameterSpace

SPACES: dict[str, type[ParameterSpace]] = {
    space.name: space for space in (HomogeneousSpace, HeterogeneousSpace, FieldSpace)
}
