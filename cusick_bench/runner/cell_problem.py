"""The problem of a cell: simulator, prior, parameter space and training images, as its data and settings say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from cusick_bench.datasets import DrapeDataset, DrapeSample
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.datasets.synthetic_set import recipe as synthetic_recipe
from cusick_bench.problem import (
    SPACES,
    Checkpoint,
    DrapeProblem,
    Journal,
    Meter,
    Scene,
    StiffnessPrior,
    TrainMesh,
    laid_like,
    parse_causes,
    profile_in_cloth_frame,
)
from cusick_bench.problem.train_mesh import with_reference
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.samples import place_in_order, read_image, read_sample, training_rows
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.render.camera import Camera, PinholeCamera
from cusick_bench.sim.setup import Simulators
from cusick_bench.solvers.registry import make_solver


def _scene(dataset: DrapeDataset, cell: Cell, simulator: DrapeSimulator) -> Scene | None:
    """Scene with the effects that act in the picture that is fitted."""
    if not cell.settings.causes:
        return None
    row = cell.train[0]
    capture, later = place_in_order(dataset, row)
    return Scene(
        parse_causes(cell.settings.causes),
        simulator.mesh,
        simulator.settings,
        side="down" if dataset.index.at[row, "side"] == "down" else "up",
        capture=capture,
        later=later,
        seed=cell.seed,
    )


def _camera(name: str, protocol: Protocol) -> Camera:
    """The camera of the data, or one of the other projection: the published scripts', at the data's scale."""
    if name in ("protocol", protocol.projection):
        return camera_of(protocol)
    if name == "parallel":
        return camera_of(replace(protocol, projection="parallel"))
    image_y: Any = protocol.image_y
    size = RELEASE.image_size_px * protocol.px_per_m / RELEASE.px_per_m  # whose field of view is the scripts'
    return PinholeCamera(size_px=size, centre_px=protocol.centre_px, image_y=image_y)


def _train_mesh(sample: DrapeSample, model: Mesh, protocol: Protocol) -> TrainMesh | None:
    """The training sample's mesh; its flat shape is known where it is a mesh of the synthetic set or the model's."""
    if sample.mesh is None:
        return None
    synthetic = synthetic_recipe.true_mesh(protocol.cloth_radius_m, protocol.plate_radius_m)
    return with_reference(sample.mesh.vertices, sample.mesh.faces, (synthetic, model))


def build_problem(
    dataset: DrapeDataset, cell: Cell, folder: Path | None = None, simulators: Simulators | None = None
) -> DrapeProblem:
    """Poses a cell's problem.

    Args:
        dataset: The data set.
        cell: What to pose.
        folder: Where the problem keeps what a resumed solver needs; nowhere by default.
        simulators: Simulators that are reused from cell to cell; by default new ones.

    Returns:
        The problem, its budget not touched.
    """
    kept = Simulators() if simulators is None else simulators
    settings, protocol, sample = cell.settings, dataset.protocol, read_sample(dataset, cell.train[0])
    known: dict[str, Any] = sample.row.to_dict()
    drape = replace(settings.drape, seed=cell.seed, plate_radius=protocol.plate_radius_m, gravity=protocol.gravity_m_s2)
    mesh = cloth_mesh(drape.law, settings.vertices, radius=protocol.cloth_radius_m, plate_radius=drape.plate_radius)
    simulator = kept.get(mesh, drape)
    scene = _scene(dataset, cell, simulator)
    if scene is not None:
        simulator = kept.get(scene.warped, scene.simulated)
    prior, plate_radius = StiffnessPrior(drape.law, float(known["areal_density"])), simulator.settings.plate_radius
    radii = profile_in_cloth_frame(sample.profile.radii, scene)
    laid = laid_like(radii, simulator.mesh, plate_radius=plate_radius)
    own, other = training_rows(dataset, cell.train)
    return DrapeProblem(
        train_image=read_image(dataset, cell.train[0]),
        further_images=tuple(read_image(dataset, row) for row in own[1:]),
        other_face_images=tuple(read_image(dataset, row) for row in other),
        simulator=simulator,
        space=SPACES[settings.space](simulator.mesh, prior, plate_radius, protocol.cloth_radius_m),
        thickness=float(known["thickness"]),
        protocol=protocol,
        camera=_camera(settings.camera, protocol),
        renderer=settings.renderer,  # pyright: ignore[reportArgumentType]
        loss=settings.loss,
        initial=laid if settings.laying == "image" else None,
        meter=Meter(settings.budget),
        journal=Journal(folder, cell.key),
        checkpoint=Checkpoint(folder, cell.key),
        train_mesh=_train_mesh(sample, simulator.mesh, protocol) if make_solver(cell.solver).needs_mesh else None,
        scene=scene,
    )
