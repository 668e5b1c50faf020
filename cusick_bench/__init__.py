"""cusick-bench: identify cloth stiffness from the Cusick drape test, and compare the methods that do it.

What a first script needs stands here in one line (`from cusick_bench import load, DrapeSimulator, disc_mesh, ...`).
Names are imported when they are first used: whoever asks for the version does not wait for torch.
"""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.datasets.dataset import DrapeDataset, DrapeSample
    from cusick_bench.datasets.errors import DataError
    from cusick_bench.datasets.loading import load
    from cusick_bench.datasets.profile import Profile, drape_coefficient, fold_count, profile_from_image
    from cusick_bench.metrics.distances.hausdorff_distance import hausdorff
    from cusick_bench.metrics.distances.image import iou, mse
    from cusick_bench.problem.drape_problem import DrapeProblem
    from cusick_bench.problem.errors import BudgetExceeded
    from cusick_bench.problem.metering.budget import Budget
    from cusick_bench.sim.cloth.material import Material, project_admissible, uniform_material
    from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
    from cusick_bench.sim.cloth.resolution import cloth_mesh
    from cusick_bench.sim.drape import Drape, DrapeSimulator
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.sim.errors import DrapeDiverged, SimulationError
    from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera
    from cusick_bench.sim.render.silhouette import render

_MODULES = {
    "Budget": "problem.metering.budget",
    "BudgetExceeded": "problem.errors",
    "DataError": "datasets.errors",
    "Drape": "sim.drape",
    "DrapeDataset": "datasets.dataset",
    "DrapeDiverged": "sim.errors",
    "DrapeProblem": "problem.drape_problem",
    "DrapeSample": "datasets.dataset",
    "DrapeSettings": "sim.engine.settings",
    "DrapeSimulator": "sim.drape",
    "Material": "sim.cloth.material",
    "Mesh": "sim.cloth.mesh",
    "ParallelCamera": "sim.render.camera",
    "PinholeCamera": "sim.render.camera",
    "Profile": "datasets.profile",
    "SimulationError": "sim.errors",
    "cloth_mesh": "sim.cloth.resolution",
    "disc_mesh": "sim.cloth.mesh",
    "drape_coefficient": "datasets.profile",
    "fold_count": "datasets.profile",
    "hausdorff": "metrics.distances.hausdorff_distance",
    "iou": "metrics.distances.image",
    "load": "datasets.loading",
    "mse": "metrics.distances.image",
    "profile_from_image": "datasets.profile",
    "project_admissible": "sim.cloth.material",
    "render": "sim.render.silhouette",
    "uniform_material": "sim.cloth.material",
}

__all__ = [
    "Budget",
    "BudgetExceeded",
    "DataError",
    "Drape",
    "DrapeDataset",
    "DrapeDiverged",
    "DrapeProblem",
    "DrapeSample",
    "DrapeSettings",
    "DrapeSimulator",
    "Material",
    "Mesh",
    "ParallelCamera",
    "PinholeCamera",
    "Profile",
    "SimulationError",
    "cloth_mesh",
    "disc_mesh",
    "drape_coefficient",
    "fold_count",
    "hausdorff",
    "iou",
    "load",
    "mse",
    "profile_from_image",
    "project_admissible",
    "render",
    "uniform_material",
]

__version__ = "0.1.0"

__getattr__ = lazy_names(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
