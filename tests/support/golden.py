"""A few numbers of every part of the numerics, to notice when they change.

python tests/support/golden.py            # what has changed
python tests/support/golden.py --write    # keeps the numbers of parts that have a new version, and of new parts

`tests/golden/numerics.json` holds them with the versions that they were made by (`cusick_bench.runner.numerics`).
Numbers that have changed under unchanged versions are never written: raise the version of the part first.
Buckling amplifies rounding a thousandfold, so drapes are taken early, or of cloth too stiff to buckle far.
"""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parent))  # when run as a script

from toy_problem import toy_held_out, toy_image, toy_problem

from cusick_bench.benchmark.optimisers import functions
from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files import hanging_line
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.profile import profile_from_image
from cusick_bench.datasets.synthetic_set.recipe import VERSION as SYNTHETIC
from cusick_bench.diagnosis import NUMERICS_VERSION as DIAGNOSIS
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.diagnose import Options, diagnose
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.diagnosis.measure.statistics import specimen_statistics
from cusick_bench.metrics.prediction_score import score
from cusick_bench.photographs import NUMERICS_VERSION as PHOTOGRAPHS
from cusick_bench.photographs import accuracy
from cusick_bench.photographs.preparation.silhouette import silhouette
from cusick_bench.problem import LOSSES, SPACES, Budget, StiffnessPrior, laid_like
from cusick_bench.runner.numerics import (
    LAWS,
    SPRINGS,
    cell_numerics,
    diagnosis_numerics,
    drape_numerics,
    raised_versions,
)
from cusick_bench.sim.cloth import membrane
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import effect, registered
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.setup import Setup, drape_setups
from cusick_bench.solvers.base import Oracle, Prediction
from cusick_bench.solvers.registry import make_solver
from cusick_bench.solvers.registry import registered as solvers
from cusick_bench.withheld import NUMERICS_VERSION as WITHHELD
from cusick_bench.withheld.world.true_case import TrueCase

PATH = Path(__file__).resolve().parents[1] / "golden" / "numerics.json"
EXACT, SHORT, LIBRARY = 1e-9, 1e-6, 1e-4
"""Relative tolerances: of what nothing amplifies; of a short drop or a fit to one, where a change of gravity by 1e-13
moves no number by more than 1e-11; of what hangs on other packages' optimisers and decompositions."""
_HINGES = ("paper", "published")  # laws whose systems are `DrapeSystem`s
_BY_LIBRARY = ("vanilla-bo", "turbo", "baxus", "rembo", "hesbo", "equilibrium-gap", "nlopt")

Values = dict[str, list[float]]


@dataclass(frozen=True)
class Golden:
    """Numbers of one part.

    Attributes:
        versions: Versions of this part and of all that its numbers depend on.
        values: Makes the numbers, by name.
        tolerance: Relative to the largest number of a name.
    """

    versions: Mapping[str, int]
    values: Callable[[], Values]
    tolerance: float


def _plain(*values: Any) -> list[float]:
    return [float(number) for value in values for number in np.ravel(np.asarray(value, dtype=np.float64))]


def _summary(array: Any) -> list[float]:
    """Sum, norm, and three weighted sums that tell where the numbers stand."""
    flat = np.ravel(np.asarray(array, dtype=np.float64))
    places = np.arange(flat.size)
    return _plain(flat.sum(), np.linalg.norm(flat), *(flat @ np.cos(rate * places) for rate in (0.1, 0.7, 2.3)))


@cache
def _tables() -> Material:
    """Tables without any symmetry."""
    generator = np.random.default_rng(7)
    stretch = 100 * np.exp(generator.normal(0, 0.3, (6, 4))) * np.array([1, 0.05, 1, 0.4])
    bending = 1e-5 * np.exp(generator.normal(0, 0.5, (3, 5)))
    return Material(torch.from_numpy(stretch), torch.from_numpy(bending), torch.tensor(0.2, dtype=torch.float64))


def _bent(law: str) -> tuple[DrapeSimulator, np.ndarray]:
    """A small cloth and a shape that strains and bends all of it."""
    simulator = DrapeSimulator(disc_mesh(80), DrapeSettings(law=law, support="springs"))  # pyright: ignore
    x, y = simulator.mesh.material.T
    height = 0.02 * np.cos(25 * x + 0.3) * np.sin(30 * y)
    return simulator, np.column_stack([1.03 * x + 0.02 * y, 0.98 * y + 0.3 * x * y, height])


def _law(law: str) -> Values:
    simulator, shape = _bent(law)
    mesh, system, material = simulator.mesh, simulator.system, _tables()
    parameters = Parameters(
        material.stretch.numpy()[None], material.bending.numpy()[None],
        material.vertex_mass(mesh).numpy(), np.linspace(-0.1, 0.1, len(mesh.hinges)),
    )  # fmt: skip
    force, blocks, energy = system.forces(shape, mesh.flat, parameters, exact=law == "paper")
    found = {"forces [N]": _summary(force), "stiffness [N/m]": _summary(blocks)}
    return found | ({"energy [J]": [energy]} if law == "paper" else {})


def _membrane() -> Values:
    return {"factor": [float(membrane.softening(_tables(), ring_mesh(vertices))) for vertices in (97, 480)]}


def _plate() -> Values:
    """Law `plate` with its stencils and maps; meshes in rings are its own."""
    mesh, material = ring_mesh(97), _tables()
    found = {"ring mesh [m]": _summary(mesh.material)}
    simulator = DrapeSimulator(mesh, DrapeSettings(law="plate", membrane="given", steps=3))
    system, unknowns = simulator.system, simulator.unknowns
    x, y = mesh.material.T
    outside = np.maximum(np.hypot(x, y) - 0.09, 0.0)
    shape = np.column_stack([1.0 * x, 1.0 * y, 4.0 * outside**2 * np.cos(25 * x + 0.3)])[None]
    parameters = Parameters(
        material.stretch.numpy()[None, None], material.bending.numpy()[None, None],
        material.vertex_mass(mesh).numpy()[None], np.linspace(-0.1, 0.1, len(mesh.hinges))[None], np.array([0.2]),
    )  # fmt: skip
    start = unknowns.configuration(shape)
    for exact in (False, True):
        state = system.evaluate(start, start, unknowns.parameters(parameters), exact=exact)
        found[f"stiffness, exact {exact} [N/m]"] = _summary(state.matrix(diagonal=np.zeros((1, mesh.vertices))))
    table = material.bending.clone().requires_grad_(True)
    drape = simulator.drape(Material(material.stretch, table, material.density), initial=torch.from_numpy(shape[0]))
    drape.vertices[:, 2].mean().backward()
    return found | {
        "control points [m]": _summary(start),
        "forces [N]": _summary(state.force()),
        "energy [J]": state.energy().tolist(),
        "drop of 3 steps [m]": _summary(drape.vertices.detach()),
        "gradient of a drop": _summary(table.grad),
    }


def _engine() -> Values:
    soft, stiff = (uniform_material(density=0.2, bending=bending) for bending in (1e-5, 2e-4))
    mesh = disc_mesh(150)
    found = {"mesh [m]": _summary(mesh.material), "faces": _summary(mesh.faces), "areas [m2]": _summary(mesh.areas)}
    dropping = DrapeSimulator(mesh, DrapeSettings(steps=5, rest_amplitude=1e-3, clamp="whole"))
    found["drop of 5 steps [m]"] = _summary(dropping.drape(soft).vertices)
    rest = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", clamp="whole")).drape(stiff)
    table = torch.full((3, 5), 2e-4, dtype=torch.float64, requires_grad=True)
    settings = DrapeSettings(steps=5, clamp="whole")
    again = DrapeSimulator(mesh, settings).drape(Material(stiff.stretch, table, stiff.density))
    again.vertices[:, 2].mean().backward()
    return found | {"equilibrium [m]": _summary(rest.vertices), "gradient of a drop": _summary(table.grad)}


def _springs() -> Values:
    simulator = DrapeSimulator(disc_mesh(150), DrapeSettings(steps=5, support="springs", law="published"))
    return {"drop of 5 steps [m]": _summary(simulator.drape(uniform_material(density=0.2, bending=1e-5)).vertices)}


def _clamp() -> Values:
    """Half hinges on the plate's edge; other parts have whole ones, by which the versions of the parts began."""
    mesh, stiff = disc_mesh(150), uniform_material(density=0.2, bending=2e-4)
    table = torch.full((3, 5), 2e-4, dtype=torch.float64, requires_grad=True)
    dropping = DrapeSimulator(mesh, DrapeSettings(steps=5, rest_amplitude=1e-3, clamp="half"))
    drop = dropping.drape(Material(stiff.stretch, table, stiff.density))
    drop.vertices[:, 2].mean().backward()
    rest = DrapeSimulator(mesh, DrapeSettings(mode="equilibrium", clamp="half")).drape(stiff)
    return {
        "weights of hinges": _summary(dropping.system.elements.hinge_weight),
        "drop of 5 steps [m]": _summary(drop.vertices.detach()),
        "gradient of a drop": _summary(table.grad),
        "equilibrium [m]": _summary(rest.vertices),
    }


def _contact() -> Values:
    settings = DrapeSettings(mode="equilibrium", self_contact=2e-3, clamp="whole")
    drape = DrapeSimulator(disc_mesh(100), settings).drape(uniform_material(density=0.2, bending=2e-4))
    return {"equilibrium with contact [m]": _summary(drape.vertices)}


def _renderer() -> Values:
    simulator, shape = _bent("paper")
    vertices, faces = torch.from_numpy(shape + np.array([0, 0, 0.02])), simulator.mesh.faces
    return {
        f"{type(camera).__name__}, {how}": _summary(render(vertices, faces, camera, method=how))
        for camera in (ParallelCamera(), PinholeCamera())
        for how in ("coverage", "soft")
    }


def _effect(name: str) -> Values:
    mesh, settings = disc_mesh(100), DrapeSettings(steps=4, clamp="whole")
    one, material = effect(name), uniform_material(density=0.2, bending=1e-4)
    setup = Setup(
        mesh, settings, material, later=one.kind == "history", laying=lambda at: 1e-3 * torch.sin(40 * at[:, 0])
    )
    changed = one.apply(setup, {p.name: 0.3 * p.typical for p in one.parameters if p.role == "severity"})
    (seen,) = drape_setups([changed])
    assert seen is not None, f"{name}: the drape of the golden numbers diverges"
    return {"seen": _summary(seen.detach())}


@cache
def _synthetic() -> DrapeDataset:
    return load("synthetic")


def _datasets() -> Values:
    samples = [_synthetic().sample(row) for row in (0, 5)]
    return {
        "images": [number for sample in samples for number in _summary(sample.image)],
        "profiles [m]": [number for sample in samples for number in _summary(sample.profile.radii)],
        "meshes [m]": [number for sample in samples for number in _summary(sample.mesh.vertices)],
    }


def _problem() -> Values:
    mesh, prior = disc_mesh(100), StiffnessPrior("paper", 0.2)
    found: Values = {}
    for name, space in SPACES.items():
        made = space(mesh, prior)
        specimen = made.specimen(torch.from_numpy(0.5 * np.cos(np.arange(made.dimension))))
        tables = (specimen.material.stretch, specimen.material.bending, specimen.material.density)
        found[f"space {name}"] = [number for table in tables for number in _summary(table.detach())]
    first, second = (torch.from_numpy(_picture(phase)) for phase in (0.0, 0.4))
    found |= {f"loss {name}": [float(loss(first, second))] for name, loss in LOSSES.items()}
    laid = laid_like(profile_from_image(_picture(0.0)).radii, mesh)
    return found | {"laid like an image [m]": _summary(laid)}


def _field_space() -> Values:
    made = SPACES["field"](disc_mesh(100), StiffnessPrior("paper", 0.3))
    specimen = made.specimen(torch.from_numpy(0.5 * np.cos(np.arange(made.dimension))))
    return {
        "stretch [N/m]": _summary(specimen.material.stretch.detach()),
        "bending [N m]": _summary(specimen.material.bending.detach()),
        "laid [m]": _summary(specimen.initial.detach()),
        "rest angles [rad]": _summary(specimen.rest_angle.detach()),
    }


def _picture(phase: float, folds: int = 7) -> np.ndarray:
    """A silhouette whose rim is two waves."""
    row, column = np.mgrid[:256, :256]
    x, y = (column - 127.5) / 723, (127.5 - row) / 723
    angle = np.arctan2(y, x)
    rim = 0.125 + 0.012 * np.cos(folds * angle + phase) + 0.003 * np.sin(3 * angle)
    return np.clip((rim - np.hypot(x, y)) * 723 + 0.5, 0, 1)


def _metrics() -> Values:
    samples = [_synthetic().sample(row) for row in (0, 4, 8, 12)]
    draws = np.stack([_picture(phase, folds) for phase, folds in ((0.0, 7), (0.3, 8), (0.9, 7), (1.4, 6))])
    found = score(Prediction(_picture(0.1), draws), samples[0], samples[1:], repeat_pairs=[(draws[0], draws[2])])
    return {name: [value] for name, value in found.items()}


# By solver: options and budget that show it at work within a second; others get `_BUDGET` drapes and no options.
_SOLVERS = {
    "homo": ("homo,search=3,adam_steps=2,lbfgs_iterations=2", 14),
    "heter": ("heter", 10),
    "bdp": ("bdp,draws=2,steps=2,samples=2,search=2", 40),
    "bdp-field": ("bdp-field,draws=2", 30),
    "equilibrium-gap": ("equilibrium-gap", 10),
    **{name: (f"{name},initial=4", 8) for name in ("vanilla-bo", "turbo", "baxus")},
    **{name: (name, 8) for name in ("rembo", "cmaes", "sobol")},
    "hesbo": ("hesbo", 8),  # in its first design: where its process looks next hangs on the last digits
    **{f"nlopt:{name}": (f"nlopt:{name}", 8) for name in ("LN_BOBYQA", "LD_LBFGS", "GN_DIRECT_L", "GN_ESCH")},
    "null:disc": ("null:disc", 1),
    "null:copy": ("null:copy", 1),
    "null:rotation": ("null:rotation,draws=8", 1),
    "null:random-phase": ("null:random-phase,draws=3", 1),
    "oracle:mean": ("oracle:mean", 1),
    "oracle:best-other": ("oracle:best-other", 1),
    "oracle:repeat": ("oracle:repeat", 1),
}
_BUDGET = 8
_STIFF = 30.0  # times the prior's median bending: folds form late, so little is amplified


def _solver(text: str, budget: int) -> Values:
    solver = make_solver(text)
    space = solver.space or "homo"
    problem = toy_problem(budget=Budget(budget), bending=_STIFF, space=space, vertices=60, clamp="whole")
    if isinstance(solver, Oracle):
        images = np.stack([toy_image(sample, bending=_STIFF, clamp="whole") for sample in (1, 2)])
        repeats = [images[None, place] for place in (1, 0)]
        solver = solver.revealing(toy_held_out(problem.train_image, images, repeats))
    answer = solver.solve(problem, np.random.default_rng(3))
    found = {
        "train_mse": [float(np.square(answer.train_image - problem.train_image).mean())],
        "draws": _summary(answer.draws),
    }
    return found | ({} if answer.tau is None else {"tau": _summary(answer.tau)})


def _diagnosis() -> Values:
    captures = read_captures(_synthetic(), _synthetic().cloths[0])
    emulator, calibration = load_atlas(SHIPPED)
    found, measured = diagnose(captures, emulator, calibration, Options(samples=0)), specimen_statistics(captures)
    return {
        "statistics": _summary(measured.mean[measured.count > 0]),
        "p": [round(found.p, 1)],  # a share of draws: the last digits of sums, which threads decide, turn single ones
        "probability": [found.probability[name] for name in sorted(found.probability)],
    }


def _photographs() -> Values:
    (measured,) = accuracy.measure(1, 4)
    return {
        "errors of an outline [mm]": [measured.rms_mm, measured.bias_mm, measured.largest_mm],
        "confidence": [measured.confidence],
        "silhouette": _summary(silhouette(0.12 + 0.012 * np.cos(7 * np.linspace(0, 2 * np.pi, 720)), RELEASE)),
    }


def _withheld() -> Values:
    (picture, *_) = TrueCase((5, 1), {}, vertices=200, steps=4).pictures(1)
    return {"picture": _summary(picture.levels)}


def _functions() -> Values:
    point = np.cos(np.arange(100.0))
    return {name: [functions.hide(name, 100, np.random.default_rng(1))(point)] for name in functions.FUNCTIONS}


def _perspective() -> dict[str, list[float]]:
    seen = np.linspace(0.085, 0.155, 12)
    return {f"from {height} m": list(hanging_line.without_perspective(seen, RELEASE, height)) for height in (0.6, 1.5)}


def goldens() -> dict[str, Golden]:
    """What is checked, by the part's name."""
    drape = drape_numerics("paper", with_contact=True, with_effects=True)
    data = {name: number for name, number in diagnosis_numerics().items() if name in ("datasets", "metrics")}
    shipped = {"set synthetic": SYNTHETIC}
    both = drape | drape_numerics("published")
    engine = {name: drape[name] for name in ("engine", "law paper")}
    settings = DrapeSettings()
    problem = cell_numerics(make_solver("homo"), settings)["problem"]
    found = {f"law {law}": Golden({f"law {law}": LAWS[law]}, lambda law=law: _law(law), EXACT) for law in _HINGES}
    found["law plate"] = Golden({"law plate": LAWS["plate"]}, _plate, EXACT)
    found["membrane"] = Golden({"membrane": membrane.NUMERICS_VERSION}, _membrane, EXACT)
    found |= {
        "engine": Golden({name: both[name] for name in ("engine", *(f"law {law}" for law in _HINGES))}, _engine, SHORT),
        "springs": Golden(
            {"springs": SPRINGS, **{name: both[name] for name in ("engine", "law published")}}, _springs, SHORT
        ),
        "clamp": Golden(engine, _clamp, SHORT),
        "contact": Golden({"contact": drape["contact"], **engine}, _contact, SHORT),
        "renderer": Golden({"renderer": drape["renderer"]}, _renderer, EXACT),
        "datasets": Golden({"datasets": data["datasets"], **shipped}, _datasets, EXACT),
        "perspective": Golden({"perspective": hanging_line.NUMERICS_VERSION}, _perspective, EXACT),
        "problem": Golden({"problem": problem, "datasets": data["datasets"]}, _problem, EXACT),
        "space field": Golden({"problem": problem, **raised_versions("space", [SPACES["field"]])}, _field_space, EXACT),
        "metrics": Golden(data | shipped, _metrics, EXACT),
        "diagnosis": Golden(diagnosis_numerics(diagnosis=DIAGNOSIS) | shipped, _diagnosis, LIBRARY),
        "withheld": Golden(
            {"withheld": WITHHELD, **{name: drape[name] for name in ("engine", "law paper")}}, _withheld, SHORT
        ),
        "photographs": Golden({"photographs": PHOTOGRAPHS}, _photographs, LIBRARY),
        "test functions": Golden({"test functions": functions.NUMERICS_VERSION}, _functions, EXACT),
    }
    simulated = {name: drape[name] for name in drape if name != "renderer"}
    for name, one in registered().items():
        versions = simulated | raised_versions("effect", [one])
        found[f"effect {name}"] = Golden(versions, lambda name=name: _effect(name), SHORT)
    families = {name.partition(":")[0] for name in _SOLVERS if name.startswith("nlopt:")}
    checked = {*_SOLVERS, *families}  # of a family some members stand for all: they share one class
    others = {name: (name, _BUDGET) for name in solvers() if not {name, name.partition(":")[0]} & checked}
    for text, budget in (_SOLVERS | others).values():
        solver = make_solver(text)
        tolerance = LIBRARY if solver.name.startswith(_BY_LIBRARY) else SHORT
        found[f"solver {solver.name}"] = Golden(
            cell_numerics(solver, settings), lambda text=text, budget=budget: _solver(text, budget), tolerance
        )
    return found


def stored() -> dict[str, dict[str, Any]]:
    """The committed numbers: `versions` and `values` by part."""
    return json.loads(PATH.read_text(encoding="utf-8")) if PATH.exists() else {}


def changes(golden: Golden, kept: Mapping[str, Any]) -> list[str]:
    """Which numbers are no longer what they were, one a line.

    Args:
        golden: What is checked.
        kept: What is stored of it.
    """
    now, wrong = golden.values(), []
    for name in sorted(now.keys() | kept["values"].keys()):
        new, old = (np.array(values.get(name, ()), dtype=np.float64) for values in (now, kept["values"]))
        if new.shape != old.shape:
            wrong.append(f"{name}: {old.size} numbers before, {new.size} now")
        elif not np.allclose(new, old, rtol=0, atol=golden.tolerance * np.abs(old).max(initial=1e-300)):
            place = int(np.argmax(np.nan_to_num(np.abs(new - old), nan=np.inf)))
            wrong.append(f"{name}: {old[place]:.12g} before, {new[place]:.12g} now")
    return wrong


def write() -> int:
    """Keeps the numbers of new parts and of new versions.

    Returns:
        Exit status: 1 where numbers have changed under unchanged versions, which are not written.
    """
    known, kept, status = stored(), {}, 0
    for part, golden in goldens().items():
        old = known.get(part)
        if old is None or old["versions"] != dict(golden.versions):
            kept[part] = {"versions": dict(golden.versions), "values": golden.values()}
            print(f"{part}: written", flush=True)
            continue
        kept[part] = old
        if wrong := changes(golden, old):
            status = 1
            print(f"{part}: NOT written, its version is as before\n  " + "\n  ".join(wrong), flush=True)
    PATH.parent.mkdir(exist_ok=True)
    PATH.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return status


def show() -> int:
    """Prints what has changed; returns 1 if anything has."""
    known, status = stored(), 0
    for part, golden in goldens().items():
        old = known.get(part, {"versions": {}, "values": {}})
        text = "new version" if old["versions"] != dict(golden.versions) else "; ".join(changes(golden, old))
        status |= bool(text)
        print(f"{part}: {text or 'unchanged'}", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(write() if sys.argv[1:] == ["--write"] else show())
