"""Pictures and numbers of a run follow the protocol of its data."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from finished_cell import write_cell
from matplotlib.figure import Figure
from other_laboratory import LARGE_IMAGES, SMALL_CLOTH, write_laboratory
from scipy.ndimage import map_coordinates
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import outline_pixels, profile_of
from cusick_bench.report.cell_view import CellView, load_cell_view, shown_surface
from cusick_bench.report.drawing.pictures import silhouette_picture
from cusick_bench.report.drawing.radius_over_angle import draw_levels, radius_limits
from cusick_bench.report.run.content import embedded_picture, real_drape, with_plate

CLOTH = "fabric_3"
PROTOCOLS = {"release": RELEASE, "large images": LARGE_IMAGES, "small cloth": SMALL_CLOTH}


@pytest.fixture(scope="module")
def laboratories(tmp_path_factory) -> dict[str, DrapeDataset]:
    return {
        name: load(write_laboratory(tmp_path_factory.mktemp("lab"), protocol, samples=2, captures=(1,)))
        for name, protocol in PROTOCOLS.items()
    }


def view(dataset: DrapeDataset, run: Path) -> CellView:
    """A cell whose fit is its training silhouette."""
    draws = np.stack([dataset.image(1).numpy()])
    return load_cell_view(write_cell(run, dataset, "null:copy", CLOTH, draws), dataset.protocol)


@pytest.mark.parametrize("name", ["large images", "small cloth"])
def test_a_cell_is_shown_as_under_the_releases_protocol(laboratories, tmp_path, name):
    ours = view(laboratories[name], tmp_path / "ours")
    nominal = view(laboratories["release"], tmp_path / "nominal")
    scale = ours.protocol.cloth_scale
    assert ours.target_profile.radii / scale == pytest.approx(nominal.target_profile.radii, abs=6e-4)
    heights = [shown_surface(one.target_profile, one.protocol).vertices[:, 2].min() for one in (ours, nominal)]
    assert heights[0] / scale == pytest.approx(heights[1], abs=3e-4)
    (text, picture), (expected, drawn) = (real_drape(CLOTH, one) for one in (ours, nominal))
    share, expected_share = (float(words.split("coefficient ")[1].split(" %")[0]) for words in (text, expected))
    assert share == pytest.approx(expected_share, abs=0.2)
    assert (picture.width, picture.height) == (drawn.width, drawn.height)


def test_sizes_stay_those_of_the_laboratory_after_its_data_have_changed(laboratories, tmp_path):
    """`identify` keeps the fit of a fabric where others are added: its cell is of the data as they were."""
    dataset, run = laboratories["small cloth"], tmp_path / "run"
    root = Path(shutil.copytree(dataset.root, tmp_path / dataset.root.name))
    cell = write_cell(run, dataset, "null:copy", CLOTH, np.stack([dataset.image(1).numpy()]))
    result = json.loads((cell / "result.json").read_text()) | {"nominal": dataset.protocol.unlike_release()}
    (cell / "result.json").write_text(json.dumps(result))
    (run / "run.json").write_text(json.dumps({"source": {"data": {"path": str(root)}}}))
    (root / dataset.index["image"].iloc[1]).unlink()
    shown = CliRunner().invoke(app, ["report", str(run)])
    assert "has changed since the run" in shown.stderr
    assert "taken as the public release's" not in shown.stderr
    (root / "protocol.json").unlink()
    assert "taken as the public release's" in CliRunner().invoke(app, ["report", str(run)]).stderr


def test_a_page_is_of_one_data_set(laboratories, tmp_path):
    """Cloths of one name in two data sets are two cloths, and pictures of each have the sizes of their own."""
    run, names = tmp_path / "run", ("release", "large images")
    for number, name in enumerate(names):
        dataset = laboratories[name]
        write_cell(run, dataset, "null:copy", CLOTH, np.stack([dataset.image(1).numpy()]), seed=number)
    last = laboratories[names[-1]]
    (run / "run.json").write_text(json.dumps({"dataset": last.name, "source": {"data": {"path": str(last.root)}}}))
    for name, words in zip(reversed(names), ([], ["--data", str(laboratories[names[0]].root)]), strict=True):
        dataset = laboratories[name]
        shown = CliRunner().invoke(app, ["report", str(run), *words])
        assert f"the page is of {dataset.name}" in shown.stderr
        page = (run / "report.html").read_text()
        assert page.count("<h3>null:copy</h3>") == 1
        radius = profile_of(dataset.image(0).numpy(), dataset.protocol).radii.mean()
        assert f"a mean radius of {1e3 * radius:.0f} mm" in page


@pytest.mark.parametrize("name", PROTOCOLS)
def test_an_outline_lies_on_the_edge_of_its_silhouette(laboratories, name):
    dataset = laboratories[name]
    image = dataset.image(0).numpy()
    columns, rows = outline_pixels(image, dataset.protocol)
    assert map_coordinates(image, [rows, columns], order=1) == pytest.approx(0.5, abs=0.1)
    assert (columns[0], rows[0]) == pytest.approx((columns[-1], rows[-1]))


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)
def test_levels_are_those_of_the_laboratorys_plate_and_cloth(protocol: Protocol):
    axes = Figure().subplots()
    axes.set_ylim(radius_limits(np.full(4, 0.1), protocol=protocol))
    draw_levels(axes, protocol=protocol)
    levels = [float(line.get_ydata()[0]) for line in axes.lines]
    assert levels == pytest.approx([1e3 * protocol.plate_radius_m, 1e3 * protocol.cloth_radius_m])


@pytest.mark.parametrize("name", PROTOCOLS)
def test_the_circle_of_the_plate_lies_where_the_plate_is(laboratories, name):
    dataset = laboratories[name]
    image, protocol = dataset.image(0).numpy(), dataset.protocol
    plate = with_plate(embedded_picture(silhouette_picture(image), "", ""), protocol).plate
    assert plate is not None
    left, top, diameter = (len(image) * one for one in plate)
    assert diameter == pytest.approx(2 * protocol.plate_radius_m * protocol.px_per_m)
    turns = np.linspace(0, 2 * np.pi, 64)
    half = diameter / 2
    inside = [top + half - 0.5 + 0.97 * half * np.sin(turns), left + half - 0.5 + 0.97 * half * np.cos(turns)]
    assert map_coordinates(image, inside, order=1).min() > 0.9
