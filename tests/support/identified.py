"""A laboratory's answer with its page, of which nothing was simulated: toy silhouettes, and a fit that was made up."""

import json
from pathlib import Path

import numpy as np
from shown_cells import write_cell

from cusick_bench.datasets import DrapeDataset
from cusick_bench.identify.comparison import compare
from cusick_bench.identify.document import (
    Drapes,
    FabricIdentity,
    Fit,
    IdentifyDocument,
    Made,
    Preparation,
    Refused,
    Spread,
    Stiffness,
)
from cusick_bench.identify.fabric_table import fabric_table
from cusick_bench.identify.page import write_page
from cusick_bench.identify.workspace import Workspace
from cusick_bench.metrics.stiffness import BENDING, STRETCH

DENSITY = 0.18
WARP = (14e-6, (6e-6, 31e-6))


def made_up_fit(path: str = "run/cells/fit") -> Fit:
    """A fit whose warp, weft and bias have 1, 1/2 and 2/3 of the warp's stiffness."""
    value, (low, high) = WARP
    return Fit(
        image="data/Fabric 1/silhouettes/Fabric_1_Sample_1_Capture_1.png",
        sample=1,
        drape_coefficient=0.631,
        simulated_drape_coefficient=0.642,
        mse=0.012,
        stiffness={
            name: Stiffness(value=share * value, ci90=(share * low, share * high))
            for name, share in zip(BENDING, (1, 1 / 2, 2 / 3), strict=True)
        },
        stretch={name: Stiffness(value=300.0, ci90=(150.0, 600.0)) for name in STRETCH},
        solver="bdp-field,draws=8",
        drapes=400.0,
        path=path,
    )


def write_identification(dataset: DrapeDataset, out: Path) -> IdentifyDocument:
    """Writes document, table and page: the first cloth has a stiffness, the second has no weight.

    Args:
        dataset: Data, of two cloths at least.
        out: Workspace.

    Returns:
        The document.
    """
    workspace = Workspace(out)
    workspace.prepare()
    first, second = dataset.cloths[:2]
    cell = write_cell(workspace.run, "bdp-field", first)
    fit = made_up_fit(cell.relative_to(out).as_posix())
    result = json.loads((cell / "result.json").read_text())
    result |= {
        "stiffness": {name: one.model_dump() for name, one in fit.stiffness.items()},
        "stretch": {name: one.model_dump() for name, one in fit.stretch.items()},
        "stiffness_curve": {name: [one.value] * 5 for name, one in fit.stiffness.items()},
        "stiffness_spread": dict.fromkeys(BENDING, 0.0),
    }
    (cell / "result.json").write_text(json.dumps(result))
    draws = np.exp(np.random.default_rng(0).normal(np.log(WARP[0]), 0.5, (200, 3)))
    with np.load(cell / "prediction.npz") as archive:
        arrays = dict(archive)
    np.savez_compressed(cell / "prediction.npz", **arrays, bending_draws=draws)
    coefficient, folds = Spread(value=0.63, sd=0.02), Spread(value=7.2, sd=0.4)
    drapes = Drapes(samples=5, silhouettes=5, units=5, drape_coefficient=coefficient, folds=folds)
    refused = Refused(path="photos/Fabric_1_Sample_2_Capture_1.jpg", fabric=1, confidence=0.31, why=("blurred",))
    document = IdentifyDocument(
        folder="my-lab",
        data=str(dataset.root),
        dataset_hash=dataset.content_hash,
        preparation=Preparation(photographs=11, refused=(refused,), calibration="the printed board", scale_sd=0.002),
        cloth_radius_m=0.15,
        plate_radius_m=0.09,
        fabrics=(
            FabricIdentity(
                fabric=first,
                areal_density=DENSITY,
                drapes=drapes,
                fit=fit,
                comparison=compare(DENSITY, fit, None),
                diagnosis_missing="the atlas was not asked",
                notes=("Stiffness is that of one drape.",),
                next=("Picture each sample with the other face up as well.",),
            ),
            FabricIdentity(
                fabric=second,
                drapes=drapes,
                fit_missing="its weight is not known, and a drape shows stiffness over weight only",
                diagnosis_missing="the atlas was not asked",
            ),
        ),
        next=("Measure the camera's height.",),
        made=Made(command="cusick-bench identify my-lab", version="0.1.0"),
    )
    document.write(workspace.document)
    workspace.table.write_text(fabric_table(document))
    write_page(document, dataset, {}, workspace)
    return document
