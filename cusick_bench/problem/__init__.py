"""The problem a solver sees: parameters, loss, budget, meter and memory."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.problem.drape_problem import DrapeProblem, Observation
    from cusick_bench.problem.errors import BudgetExceeded, ProblemError, StaleJournal
    from cusick_bench.problem.field_space import FieldSpace
    from cusick_bench.problem.laying import laid_like
    from cusick_bench.problem.losses import LOSSES
    from cusick_bench.problem.metering.budget import Budget, Evaluation, Meter
    from cusick_bench.problem.metering.journal import Checkpoint, Journal
    from cusick_bench.problem.priors import StiffnessPrior
    from cusick_bench.problem.scene import Scene, canonical, parse_causes, profile_in_cloth_frame
    from cusick_bench.problem.space import HeterogeneousSpace, HomogeneousSpace, ParameterSpace, Specimen
    from cusick_bench.problem.spaces import SPACES
    from cusick_bench.problem.train_mesh import TrainMesh

NUMERICS_VERSION = 3  # raised when a problem's numbers change: see runner/numerics.py

__all__ = [
    "LOSSES",
    "SPACES",
    "Budget",
    "BudgetExceeded",
    "Checkpoint",
    "DrapeProblem",
    "Evaluation",
    "FieldSpace",
    "HeterogeneousSpace",
    "HomogeneousSpace",
    "Journal",
    "Meter",
    "Observation",
    "ParameterSpace",
    "ProblemError",
    "Scene",
    "Specimen",
    "StaleJournal",
    "StiffnessPrior",
    "TrainMesh",
    "canonical",
    "laid_like",
    "parse_causes",
    "profile_in_cloth_frame",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Budget": "metering.budget",
        "BudgetExceeded": "errors",
        "Checkpoint": "metering.journal",
        "DrapeProblem": "drape_problem",
        "Evaluation": "metering.budget",
        "FieldSpace": "field_space",
        "HeterogeneousSpace": "space",
        "HomogeneousSpace": "space",
        "Journal": "metering.journal",
        "LOSSES": "losses",
        "Meter": "metering.budget",
        "Observation": "drape_problem",
        "ParameterSpace": "space",
        "ProblemError": "errors",
        "SPACES": "spaces",
        "Scene": "scene",
        "Specimen": "space",
        "StaleJournal": "errors",
        "StiffnessPrior": "priors",
        "TrainMesh": "train_mesh",
        "canonical": "scene",
        "laid_like": "laying",
        "parse_causes": "scene",
        "profile_in_cloth_frame": "scene",
    },
)
