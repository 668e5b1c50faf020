"""The cloth of a garment: stiffness tables from a fit or given by numbers, and draws of them for every element.

Where tables come from, in this order:

- `cloths`: cloths drawn from the posterior of `bdp-field` (`posterior_cloths` in `prediction.npz`, whitened), from a
  Gaussian over whole cloths (as below, of a fit in the space `homo`), or by a solver of another package, whose `redraw`
  is asked for them (`redrawn`). Every garment is made of one of them, homogeneous apart from factors exp(sd N(0, 1))
  with a given sd;
- `posterior`: the Gaussian over all elements that `bdp` has learned (`posterior_mean`, `posterior_scale` in
  `prediction.npz`: whitened logarithms). Every element of a garment draws its own tables, as in the paper;
- `elements`: a fit with a table per element: every element of the garment gets the table of a random element of the
  fit, since the disc's places have no counterpart on a skirt;
- `spread`: a homogeneous cloth, every entry times exp(sd N(0, 1)) with a given sd.

A fit with the effect `density-bias` holds for the weight that this effect gives the cloth, and the garment has that
weight. Other effects stay behind.

Tables are aligned with warp and weft, so they are the same numbers on any pattern. Of a fit's six samples of stretch
stiffness only the one at rest is used, for every strain: a drape strains cloth by a few per cent and tells nothing
about the others, which are at a stretch of a sixth. Their values from the prior may be so soft that the cloth becomes
unstable where a skirt pulls at the waist, and never comes to rest.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 5.1.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.files import BadFile, read_json_object, read_npz
from cusick_bench.garment.errors import GarmentError
from cusick_bench.garment.redrawn import redrawn_tables
from cusick_bench.problem.cloth_prior import CLOTH
from cusick_bench.problem.cloth_tables import cloth_tables
from cusick_bench.problem.priors import BENDING_SIZE, BENDING_TABLE_FACTOR, STRETCH_SIZE, StiffnessPrior
from cusick_bench.problem.scene import parse_causes
from cusick_bench.runner.cell_files import stored_posterior
from cusick_bench.runner.labels import recorded_settings
from cusick_bench.runner.store import CELL_FILE, MOST_PREDICTION_BYTES, PREDICTION_FILE
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import HEAVIEST_CLOTH, LIGHTEST_CLOTH, Law
from cusick_bench.sim.effects.material.density_bias import DensityBias
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.solvers.registry import is_built_in

SHAPES = {"stretch": (6, 4), "bending": (3, 5)}
_WHOLE = STRETCH_SIZE + BENDING_SIZE  # logarithms of a cloth whose elements all have the same tables
_POOL = 4096  # tables drawn from a posterior, of which every element gets one
_COUPLING = 0.95  # most that |c12| / sqrt(c11 c22) may be: the tables stay positive definite


@dataclass(frozen=True, eq=False)
class Cloth:
    """What a garment is made of.

    Attributes:
        name: Name of the cloth; a colour in it is used for pictures.
        source: `cloths`, `posterior`, `elements` or `spread`.
        law: Material law that the tables are meant for.
        density: Areal density [kg/m2].
        stretch: Median C; of several, every element gets one at random, or every garment if they are of cloths [N/m].
        bending: Median B; of several likewise, of cloths that of the same cloth [N m].
        stretch_sd: Standard deviation of log C between elements.
        bending_sd: Standard deviation of log B between elements.
    """

    name: str
    source: str
    law: Law
    density: float
    stretch: Float[ndarray, "stretch_tables 6 4"]
    bending: Float[ndarray, "bending_tables 3 5"]
    stretch_sd: Float[ndarray, "6 4"]
    bending_sd: Float[ndarray, "3 5"]

    def draw(self, mesh: Mesh, members: int, generator: np.random.Generator) -> Parameters:
        """Draws tables for every element of a garment.

        Args:
            mesh: The garment.
            members: Number of draws.
            generator: Source of randomness.

        Returns:
            A batch of cloths.

        Raises:
            GarmentError: No draws.
        """
        if members < 1:
            raise GarmentError(f"the number of draws must be at least 1, got {members}")
        own = generator.integers(len(self.bending), size=(members, 1)) if self.source == "cloths" else None
        stretch = _scattered(self.stretch, self.stretch_sd, (members, len(mesh.faces)), generator, own)
        limit = _COUPLING * np.sqrt(stretch[..., 0] * stretch[..., 2])
        stretch[..., 1] = np.clip(stretch[..., 1], -limit, limit)
        bending = _scattered(self.bending, self.bending_sd, (members, len(mesh.hinges)), generator, own)
        mass = np.bincount(mesh.faces.ravel(), np.repeat(self.density * mesh.areas / 3, 3), mesh.vertices)
        return Parameters(stretch, bending, np.tile(mass, (members, 1)), np.zeros((members, len(mesh.hinges))))

    def spread_by(self, spread: float) -> "Cloth":
        """This cloth with one standard deviation for all entries; a posterior over elements keeps its own.

        Args:
            spread: Standard deviation of log stiffness between elements.

        Returns:
            The cloth.

        Raises:
            GarmentError: A negative sd.
        """
        if not (np.isfinite(spread) and spread >= 0):
            raise GarmentError(f"the spread of log stiffness must be >= 0 and finite, got {spread}")
        if self.source not in ("spread", "cloths"):
            return self
        return replace(self, stretch_sd=np.full((6, 4), spread), bending_sd=np.full((3, 5), spread))


def _scattered(
    tables: ndarray, sd: ndarray, shape: tuple[int, int], generator: np.random.Generator, own: ndarray | None
) -> ndarray:
    """Tables of the elements: those of their garment (`own`), or at random, times what every entry scatters by."""
    if own is None:
        own = generator.integers(len(tables), size=shape) if len(tables) > 1 else np.zeros(shape, np.int64)
    return tables[own] * np.exp(sd * generator.standard_normal((*shape, *sd.shape)))


def cloth_of_numbers(
    *, density: float, bending: tuple[float, float, float], stretch: float = 300.0, shear: float = 60.0,
    spread: float = 0.0,
) -> Cloth:  # fmt: skip
    """A cloth given by a few numbers, as `uniform_material` takes them.

    Args:
        density: Areal density [kg/m2].
        bending: Bending stiffness of hinges at 0, 45, 90 degrees [N m].
        stretch: Membrane stiffness [N/m].
        shear: Shear stiffness [N/m].
        spread: Standard deviation of log stiffness between elements.

    Returns:
        The cloth.

    Raises:
        CusickError: A value out of range.
    """
    material = uniform_material(density=density, bending=bending, stretch=stretch, shear=shear)
    cloth = Cloth("cloth", "spread", "paper", density, *_tables(material), np.zeros((6, 4)), np.zeros((3, 5)))
    return cloth.spread_by(spread)


def _tables(material: Material) -> tuple[ndarray, ndarray]:
    return material.stretch.numpy().reshape(-1, 6, 4), material.bending.numpy().reshape(-1, 3, 5)


def cloth_of_cell(folder: Path, *, spread: float = 0.0) -> Cloth:
    """The cloth that a cell of a run has found.

    Args:
        folder: The cell's folder, with `cell.json` and `prediction.npz`.
        spread: Standard deviation of log stiffness between elements, where the fit has neither a posterior nor tables
            per element.

    Returns:
        The cloth.

    Raises:
        GarmentError: No such folder, a damaged file, a predictor without stiffness, or tables of another problem.
    """
    record, arrays, density = _found_by(folder)
    law: Any = recorded_settings(record)["drape"].get("law", "paper")
    if not isinstance(law, str) or law not in BENDING_TABLE_FACTOR:
        raise GarmentError(f"{folder / CELL_FILE}: law must be plate, paper or published, got {law!r}")
    name = str(record.get("cloth", "cloth"))
    tables = {key: _checked(arrays[key], shape, f"{folder}: {key}") for key, shape in SHAPES.items()}
    source, sds = "spread", {key: np.zeros(shape) for key, shape in SHAPES.items()}
    posterior = stored_posterior(arrays)
    if posterior and not is_built_in(str(record.get("solver"))):
        source, drawn = "cloths", redrawn_tables(folder, record, posterior)
        tables = {key: _checked(drawn[key], shape, f"{folder}: redrawn {key}") for key, shape in SHAPES.items()}
    elif "posterior_cloths" in arrays:
        source = "cloths"
        tables = _of_cloths(arrays["posterior_cloths"], StiffnessPrior(law, density), folder)
    elif "posterior_mean" in arrays and arrays["posterior_mean"].shape[:1] in ((), (_WHOLE,)):
        source = "cloths" if arrays.get("tau", np.zeros(0)).shape == (_WHOLE,) else "posterior"
        tables = _pool(arrays, StiffnessPrior(law, density), folder)
    elif any(len(table) > 1 for table in tables.values()):
        source = "elements"
        _check_elements(arrays, tables, folder)
    tables["stretch"] = np.repeat(tables["stretch"][:, :1], SHAPES["stretch"][0], axis=1)
    cloth = Cloth(
        name,
        source,
        law_of_garment(law),
        _draped_density(record, density),
        tables["stretch"],
        tables["bending"],
        sds["stretch"],
        sds["bending"],
    )
    return cloth.spread_by(spread)


def density_of_cell(folder: Path) -> float:
    """The areal density that a cell's cloth was fitted with.

    Args:
        folder: The cell's folder, with `cell.json` and `prediction.npz`.

    Returns:
        Its mean over the cloth [kg/m2]; under the effect `density-bias` not the one in the data's table.

    Raises:
        GarmentError: No such folder, a damaged file, or a predictor without stiffness.
    """
    record, _, density = _found_by(folder)
    return _draped_density(record, density)


def _draped_density(record: dict[str, Any], nominal: float) -> float:
    """Areal density of the cloth that was draped, whose nominal one the prediction has [kg/m2]."""
    causes = recorded_settings(record)["causes"]
    biases = parse_causes([text for text in causes if text.partition(":")[0] == DensityBias.name])
    return nominal * math.prod(1 + float(cause.effect.complete(cause.value)["bias"]) for cause in biases)


def _found_by(folder: Path) -> tuple[dict[str, Any], dict[str, ndarray], float]:
    """Record and arrays of a cell that has found stiffness, and its nominal areal density [kg/m2]."""
    record, arrays = _read_record(folder), _read_arrays(folder / PREDICTION_FILE)
    missing = [name for name in ("stretch", "bending", "density") if name not in arrays]
    if missing:
        raise GarmentError(
            f"{folder} has no {', '.join(missing)}: its solver ({record.get('solver', 'unknown')}) predicts drapes "
            "without simulating a cloth; give a cell of a solver that fits stiffness, such as homo"
        )
    density = arrays["density"]
    light, heavy = LIGHTEST_CLOTH, HEAVIEST_CLOTH
    if density.dtype.kind != "f" or not density.size or not ((density >= light) & (density <= heavy)).all():
        raise GarmentError(f"{folder}: areal density must be {light} to {heavy} kg/m2 everywhere; run the cell again")
    return record, arrays, float(density.mean())


def law_of_garment(law: str) -> Law:
    """The law that garments of a cloth hang by.

    Law `plate` needs cloth of one piece that is clamped in a circle, so that its surface can be mirrored there; a skirt
    has seams, and hangs on a waist that moves. Law `paper` reads the same tables as the stiffness of the same plate.

    Args:
        law: Law that the cloth's tables were found by.

    Returns:
        `paper` for tables of law `plate`, and the law itself else.

    Raises:
        GarmentError: No such law.
    """
    if law not in BENDING_TABLE_FACTOR:
        raise GarmentError(f"law must be one of {', '.join(BENDING_TABLE_FACTOR)}, got {law!r}")
    return "published" if law == "published" else "paper"


def _read_record(folder: Path) -> dict[str, Any]:
    path = folder / CELL_FILE
    if not folder.is_dir():
        raise GarmentError(f"no result at {folder}; give a cell's folder of a run, OUT/cells/HASH")
    try:
        record = read_json_object(path, remedy="give a cell's folder of a run, OUT/cells/HASH, that has finished")
        recorded_settings(record)
    except BadFile as error:
        raise GarmentError(f"cannot read {path} ({error.what}); {error.remedy}") from error
    except ValueError as error:
        raise GarmentError(f"{path} is damaged ({error}); run the cell again") from error
    return record


def _read_arrays(path: Path) -> dict[str, ndarray]:
    """The stiffness arrays of a prediction, read without trusting the file."""
    if not path.is_file():
        raise GarmentError(f"no prediction at {path}: the cell failed or has not finished; run it again")
    try:
        return read_npz(
            path,
            remedy="run the cell again",
            most_bytes=MOST_PREDICTION_BYTES,
            wanted=lambda name: name in (*SHAPES, "density", "faces", "tau") or name.startswith("posterior"),
        )
    except BadFile as error:
        raise GarmentError(f"cannot read {path} ({error.what}); {error.remedy}") from error


def _checked(array: ndarray, shape: tuple[int, int], name: str) -> Float[ndarray, "tables rows columns"]:
    """Tables (n, *shape), finite, with positive stiffness."""
    if array.shape[-2:] != shape or array.ndim > 3 or array.dtype.kind != "f" or array.size == 0:
        raise GarmentError(
            f"{name} must be tables of shape {shape}, got {array.dtype} {array.shape}; it belongs to another problem"
        )
    tables = np.asarray(array, dtype=np.float64).reshape(-1, *shape)
    positive = tables if shape == SHAPES["bending"] else tables[..., [0, 2, 3]]
    if not np.isfinite(tables).all() or not (positive > 0).all():
        raise GarmentError(f"{name} must be finite, with positive stiffness; run the cell again")
    return tables


def _pool(arrays: dict[str, ndarray], prior: StiffnessPrior, folder: Path) -> dict[str, ndarray]:
    """Tables drawn from a posterior over the elements of a cloth, always the same ones."""
    mean, scale = arrays["posterior_mean"], arrays.get("posterior_scale", np.zeros(0))
    sound = scale.shape == mean.shape == (_WHOLE,)
    sound = sound and mean.dtype.kind == scale.dtype.kind == "f" and np.isfinite([mean, scale]).all()
    if not sound or (scale < 0).any():
        raise GarmentError(
            f"{folder}: posterior_scale must be finite and >= 0 with shape {mean.shape}, as posterior_mean; the "
            "posterior is of another problem, or damaged: run the cell again"
        )
    noise = np.random.default_rng(0).standard_normal((_POOL, len(mean)))
    stretch, bending = torch.as_tensor(mean + scale * noise).split([STRETCH_SIZE, BENDING_SIZE], -1)
    return {"stretch": prior.stretch(stretch).numpy(), "bending": prior.bending(bending).numpy()}


def _of_cloths(cloths: ndarray, prior: StiffnessPrior, folder: Path) -> dict[str, ndarray]:
    """Tables of cloths drawn from a posterior."""
    sound = cloths.dtype.kind == "f" and cloths.ndim == 2 and len(cloths) and cloths.shape[1] == CLOTH
    if not sound or not np.isfinite(cloths).all():
        raise GarmentError(
            f"{folder}: posterior_cloths must be finite with shape (cloths, {CLOTH}), got {cloths.shape}; it is of "
            "another version or problem, or damaged: run the cell again"
        )
    stretch, bending = cloth_tables(prior, torch.as_tensor(cloths, dtype=torch.float64))
    return {"stretch": stretch.numpy(), "bending": bending.numpy()}


def _check_elements(arrays: dict[str, ndarray], tables: dict[str, ndarray], folder: Path) -> None:
    faces = len(arrays.get("faces", ()))
    if faces and len(tables["stretch"]) not in (1, faces):
        raise GarmentError(
            f"{folder}: {len(tables['stretch'])} stretch tables for a mesh of {faces} faces: they belong to another "
            "problem; run the cell again"
        )
