"""Observed orders, the exact annulus, reference drapes, and changes from mesh to mesh and with the time step."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark.convergence.linear_plate import exact_rim_deflection, linear_plate
from cusick_bench.benchmark.convergence.mesh_dependence import (
    NAMES,
    draw_statistics,
    largest_change,
    mesh_changes,
    mesh_row,
    mesh_spread,
    statistic_changes,
)
from cusick_bench.benchmark.convergence.order import extrapolated_limit, mesh_spacing, observed_order
from cusick_bench.benchmark.convergence.plate_cloth import plate_cloth
from cusick_bench.benchmark.convergence.reference import compare_with_reference, raised, reference_orders
from cusick_bench.benchmark.convergence.time_step import FOLD_STATISTICS, drapes_of_time_step, time_step
from cusick_bench.cli import app
from cusick_bench.datasets.files.plate_drapes import PlateDrape
from cusick_bench.report.figures.convergence import (
    Panel,
    Series,
    convergence_figure,
    reference_panels,
    save_convergence,
)
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError

SIZES = [300, 600, 1200, 2400]
CLOTH = uniform_material(density=0.192, bending=1.4e-5)
STIFF = PlateDrape(0, -2.0, -0.333333, 0.99627, 149.823, 149.823, -4.4465, 1e-4)
FOLDED = PlateDrape(6, -5.0, 0.0, 0.8585, 138.46, 148.12, -34.26, 5e-4)
HEADER = "folds,ln_bending,poisson,drape_coefficient,rim_min_mm,rim_max_mm,rim_lowest_mm,accuracy\n"


@pytest.fixture(scope="module")
def compared():
    return compare_with_reference([STIFF, FOLDED], [97, 297], "paper", meshes=2)


@pytest.fixture(scope="module")
def by_size():
    return {size: draw_statistics(size, 4, CLOTH, DrapeSettings()) for size in (97, 200)}


@pytest.fixture(scope="module")
def timed():
    done = []
    found = time_step(97, 3, CLOTH, DrapeSettings(), steps=[25, 400], halvings=1, done=done.append)
    return found, sum(done)


class TestOrder:
    @pytest.mark.parametrize("order", [1.0, 2.0, 3.5])
    def test_powers_of_the_spacing_have_their_order(self, order):
        found = observed_order(SIZES, -7 * mesh_spacing(np.array(SIZES)) ** order)
        assert found.order == pytest.approx(order, abs=1e-9)
        assert found.standard_error == pytest.approx(0, abs=1e-6)
        assert found.errors == 4

    def test_scatter_shows_in_the_standard_error(self):
        scatter = np.exp([0.3, -0.3, 0.3, -0.3])
        found = observed_order(SIZES, mesh_spacing(np.array(SIZES)) ** 2 * scatter)
        assert abs(found.order - 2) < 2 * found.standard_error < 2

    def test_errors_below_the_exact_values_own_do_not_count(self):
        errors = [8.0, 4.0, 0.001, np.nan]
        found = observed_order(SIZES, errors, least=0.01)
        assert (found.order, found.standard_error, found.errors) == (pytest.approx(2), None, 2)

    def test_meshes_of_one_size_have_no_order(self):
        assert observed_order([300, 300, 300], [1.0, 2.0, 3.0]) is None

    def test_a_limit_is_found_from_values_alone(self):
        drapes = 0.65 - 40 * mesh_spacing(np.array(SIZES)) ** 1.5 + np.linspace(-0.02, 0.02, 9)[:, None]
        found = extrapolated_limit(SIZES, drapes)
        assert found.value == pytest.approx(0.65, abs=1e-4)
        assert found.order == pytest.approx(1.5, abs=1e-2)
        assert found.value_90[0] < 0.65 < found.value_90[1]
        assert found.value_90[1] - found.value_90[0] < 0.02

    @pytest.mark.parametrize("values", [[0.5, 0.6, 0.5, 0.6], [0.1, 0.2, 0.4, 0.8]])
    def test_values_without_a_limit_have_none(self, values):
        assert extrapolated_limit(SIZES, np.tile(values, (5, 1))) is None


class TestLinearPlate:
    def test_the_exact_deflection_is_that_of_the_reference(self):
        assert 1e3 * exact_rim_deflection(0.0) == pytest.approx(0.5750, abs=5e-5)

    def test_a_narrow_annulus_is_a_cantilever(self):
        width = 1e-3
        exact = exact_rim_deflection(0.0, cloth_radius=1.0, plate_radius=1 - width)
        assert exact == pytest.approx(width**4 / 8, rel=5e-3)

    def test_finer_meshes_are_nearer_to_it(self):
        found = linear_plate([97, 297], "paper", meshes=2)
        errors = [abs(row.ratio - 1) for row in found.rows]
        assert max(errors[2:]) < min(errors[:2])
        slope = 2 * np.log(np.mean(errors[:2]) / np.mean(errors[2:])) / np.log(297 / 97)
        assert found.order.order == pytest.approx(slope, abs=0.1)
        assert found.poisson == pytest.approx(-1 / 3)

    def test_a_whole_clamp_lets_it_hang_lower(self):
        half, whole = (linear_plate([97], "paper", clamp=clamp).rows[0].ratio for clamp in ("half", "whole"))
        assert whole > 1.3 * half


class TestReference:
    def test_there_is_an_entry_for_every_row_and_size(self, compared):
        assert [(one.vertices, one.folds) for one in compared] == [(97, 0), (97, 6), (297, 0), (297, 6)]
        assert all(one.meshes == 2 and one.seconds > 0 and not one.failures for one in compared)

    def test_errors_are_differences_to_the_row(self, compared):
        for one, row in zip(compared, [STIFF, FOLDED] * 2, strict=True):
            assert one.error_points == pytest.approx(100 * (one.drape_coefficient - row.drape_coefficient))
            assert one.rim_min_error_mm == pytest.approx(one.rim_min_mm - row.rim_min_mm)
            assert one.rim_max_error_mm == pytest.approx(one.rim_max_mm - row.rim_max_mm)
            assert one.rim_lowest_error_mm == pytest.approx(one.rim_lowest_mm - row.rim_lowest_mm)
            assert one.rim_min_mm <= one.rim_max_mm < 151
        assert {one.drape_coefficient_sd_points > 0 for one in compared} == {True}

    def test_folds_stay_and_the_flat_cloth_sinks_evenly(self, compared):
        assert {one.folds_found for one in compared if one.folds == 6} == {(6, 6)}
        for one in compared:
            if one.folds == 0:
                assert one.deflection_ratio == pytest.approx(one.rim_lowest_mm / STIFF.rim_lowest_mm, rel=0.15)
                assert 1.05 < one.deflection_ratio < one.rim_lowest_mm / STIFF.rim_lowest_mm
            else:
                assert one.deflection_ratio is None

    def test_a_finer_mesh_is_nearer_to_the_reference(self, compared):
        size = {one.vertices: abs(one.error_points) for one in compared if one.folds == 6}
        assert size[297] < 0.6 * size[97]
        orders = {one.folds: one for one in reference_orders(compared)}
        assert orders[6].drape_coefficient.order == pytest.approx(2 * np.log(size[97] / size[297]) / np.log(297 / 97))
        assert orders[6].deflection is None
        assert orders[0].deflection.order > 0

    def test_the_cloth_is_laid_down_as_the_reference_says(self):
        mesh = disc_mesh(297)
        shape = raised(mesh, 6)
        radius = np.hypot(*mesh.material.T)
        assert np.abs(shape[radius <= 0.09 + 1e-9, 2]).max() < 1e-30
        rim = np.isclose(radius, 0.15)
        angle = np.arctan2(mesh.material[rim, 1], mesh.material[rim, 0])
        assert shape[rim, 2] == pytest.approx(6e-3 * np.cos(6 * angle))
        assert (raised(mesh, 0) == mesh.flat).all()

    def test_the_cloth_is_that_of_the_reference(self):
        cloth = plate_cloth(-5.0, 0.0, "paper")
        tables = 150 * np.array([1, 0, 1, 1])  # the law doubles them: 300 N/m, and half of that against shear
        assert (cloth.stretch.numpy() == tables).all()
        assert cloth.bending.numpy() == pytest.approx(np.exp(-5) * 0.2 * 9.8 * 0.15**3)
        assert float(cloth.density) == 0.2

    def test_the_cloth_is_the_same_plate_under_every_law(self):
        """The published program bends a plate as if it had a quarter of its table."""
        sunk = {}
        for law in ("published", "paper"):
            settings = DrapeSettings(law=law, clamp="whole", laying_amplitude=0.0)
            drape = DrapeSimulator(disc_mesh(150), settings).drape(plate_cloth(-3.0, 0.0, law))
            sunk[law] = float(drape.vertices[:, 2].min())
        assert sunk["published"] == pytest.approx(sunk["paper"], rel=0.02)

    def test_a_law_without_rests_is_refused(self):
        with pytest.raises(SimulationError, match="published"):
            compare_with_reference([STIFF], [97], "published")


class TestMeshDependence:
    def test_changes_are_paired_and_in_units_of_the_spread(self, by_size):
        (change,) = mesh_changes(by_size)
        one, other = by_size[97], by_size[200]
        place = NAMES.index("area_dc")
        found = change.statistics[place]
        expected = (one - other)[:, place].mean()
        assert (change.vertices, change.against, change.draws) == (97, 200, 4)
        assert found.change == pytest.approx(expected)
        assert found.change_sd == pytest.approx(expected / other[:, place].std(ddof=1))
        assert found.error_sd == pytest.approx((one - other)[:, place].std(ddof=1) / 2 / other[:, place].std(ddof=1))
        assert largest_change(change.statistics, ["area_dc"]) == found

    def test_the_same_drapes_do_not_change(self, by_size):
        draws, changes = statistic_changes(by_size[97], by_size[97])
        assert draws == 4
        assert {one.change for one in changes} == {0.0}

    def test_drapes_that_diverged_are_left_out(self, by_size):
        broken = by_size[97].copy()
        broken[1] = np.nan
        draws, _ = statistic_changes(broken, by_size[200])
        assert draws == mesh_row(97, broken).drapes == 3

    def test_a_row_says_means_and_errors(self, by_size):
        row, coefficients = mesh_row(97, by_size[97]), by_size[97][:, NAMES.index("area_dc")]
        assert row.drape_coefficient == pytest.approx(coefficients.mean())
        assert row.drape_coefficient_se == pytest.approx(coefficients.std(ddof=1) / 2)
        assert row.fold_depth_mm == pytest.approx(1e3 * by_size[97][:, NAMES.index("fold_depth")].mean())

    def test_another_mesh_gives_another_drape(self):
        assert 0 < mesh_spread(97, 3, CLOTH, DrapeSettings()) < 20

    def test_meshes_show_the_first_laying_of_the_study(self, monkeypatch):
        seeds: list[int] = []

        def one(size, number, material, settings, jitter):
            seeds.append(settings.seed)
            return np.zeros(len(NAMES))

        monkeypatch.setattr("cusick_bench.benchmark.convergence.mesh_dependence._one", one)
        draw_statistics(97, 1, CLOTH, DrapeSettings(), seed=7)
        mesh_spread(97, 2, CLOTH, DrapeSettings(), seed=7)
        assert seeds == [7, 7, 7]


class TestTimeStep:
    def test_a_longer_drop_is_nearer_to_its_rest(self, timed):
        short, long = timed[0].rests
        assert (short.steps, long.steps) == (25, 400)
        assert long.same_branch == long.at_rest == 1
        assert long.distance_mm < 0.01 < short.distance_mm
        assert long.drape_coefficient_points < 0.01

    def test_a_halved_step_falls_for_the_same_time(self, timed):
        (change,) = timed[0].halvings
        assert (change.step_seconds, change.halved_seconds, change.draws) == (0.05, 0.025, 3)
        assert [one.name for one in change.statistics] == [name for name in NAMES if name in FOLD_STATISTICS]
        assert any(one.change != 0 for one in change.statistics)

    def test_a_change_is_that_of_twice_as_many_half_steps(self):
        (change,) = time_step(97, 2, CLOTH, DrapeSettings(), steps=[20], halvings=1).halvings
        whole, halved = (
            draw_statistics(97, 2, CLOTH, DrapeSettings(steps=steps, step_seconds=seconds))
            for steps, seconds in ((20, 0.05), (40, 0.025))
        )
        place = NAMES.index("area_dc")
        assert change.statistics[0].name == "area_dc"
        assert change.statistics[0].change == pytest.approx((halved - whole)[:, place].mean())

    def test_progress_counts_every_drape(self, timed):
        assert timed[1] == drapes_of_time_step(3, [25, 400], 1) == 3 * 6


class TestCommand:
    def test_reference_drapes_on_two_sizes(self, tmp_path):
        table, picture = tmp_path / "drapes.csv", tmp_path / "made" / "here.png"
        table.write_text(HEADER + "0,-2,0,0.99699,149.857,149.857,-4.0192,1e-4\n")
        command = f"convergence --reference {table} --vertices 97 --vertices 120 --picture {picture} --json"
        done = CliRunner().invoke(app, command.split())
        assert done.exit_code == 0, done.stderr
        document = json.loads(done.stdout)
        assert document["clamp"] == "half"
        assert [row["vertices"] for row in document["reference"]] == [97, 120]
        first = document["reference"][0]
        assert (first["folds"], first["ln_bending"], first["poisson"]) == (0, -2, 0)
        assert first["poisson_simulated"] == pytest.approx(-1 / 3)
        assert document["orders"][0]["deflection"]["errors"] == 2
        assert picture.read_bytes().startswith(b"\x89PNG")

    def test_the_table_says_errors_and_the_fixed_poisson_ratio(self, tmp_path):
        table = tmp_path / "drapes.csv"
        table.write_text(HEADER + "0,-2,0,0.99699,149.857,149.857,-4.0192,1e-4\n")
        command = f"convergence --reference {table} --vertices 97 --meshes 2 --jitter 0.2 --clamp whole"
        done = CliRunner().invoke(app, command.split(), env={"COLUMNS": "300"})
        assert done.exit_code == 0, done.stderr
        for words in ("error points", "rim min error mm", "deflection ratio", "sd points", "ratio of -0.333"):
            assert words in done.stdout

    @pytest.mark.parametrize(
        "option", ["--density 0.192", "--bending 1.4e-5", "--draws 8", "--steps 200", "--halvings 0"]
    )
    def test_options_of_one_cloth_are_refused_beside_reference_drapes(self, tmp_path, option):
        table = tmp_path / "drapes.csv"
        table.write_text(HEADER + "0,-2,0,0.99699,149.857,149.857,-4.0192,1e-4\n")
        done = CliRunner().invoke(app, f"convergence --reference {table} --vertices 97 {option}".split())
        assert done.exit_code == 2
        assert f"{option.split()[0]} is about the study of one cloth" in " ".join(done.stderr.split())

    def test_one_cloth_on_three_sizes(self):
        command = "convergence --vertices 97 --vertices 120 --vertices 150 --draws 3 --steps 40 --halvings 1 --meshes 2"
        done = CliRunner().invoke(app, [*command.split(), "--json"])
        assert done.exit_code == 0, done.stderr
        document = json.loads(done.stdout)
        assert [row["vertices"] for row in document["meshes"]] == [97, 120, 150]
        assert all(row["mesh_sd_points"] > 0 for row in document["meshes"])
        assert len(document["linear_plate"]["rows"]) == 6
        assert [change["vertices"] for change in document["statistics"]] == [97, 120]
        assert len(document["statistics"][0]["statistics"]) == len(NAMES)
        assert [row["steps"] for row in document["time_step"]["rests"]] == [10, 20, 40]
        assert document["time_step"]["vertices"] == 150

    def test_tables_of_one_cloth(self):
        command = "convergence --vertices 97 --vertices 120 --draws 2 --steps 30 --halvings 1"
        done = CliRunner().invoke(app, command.split(), env={"COLUMNS": "300"})
        assert done.exit_code == 0, done.stderr
        for words in ("fold depth mm", "observed order of the deflection", "in sd between drapes", "step halved from"):
            assert words in done.stdout


def test_a_picture_has_a_line_a_reference_drape(compared):
    figure = convergence_figure("law paper", reference_panels(compared))
    coefficient, depth, error = figure.axes
    assert len(coefficient.containers) == 2
    assert len(depth.containers) == 1
    assert (coefficient.get_yscale(), error.get_yscale()) == ("linear", "log")
    drawn = coefficient.containers[1].lines[0].get_ydata()
    assert drawn == pytest.approx([one.drape_coefficient for one in compared if one.folds == 6])


def test_a_lone_line_of_errors_is_named(tmp_path):
    """Without a limit the linear plate's errors stood alone on an axis called "error", without name or unit."""
    error = Panel("error", [Series("linear plate, deflection [%]", [297, 1205], [1.2, 0.4])], logarithmic=True)
    legend = convergence_figure("law paper", [error]).axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["linear plate, deflection [%]"]
    save_convergence(tmp_path / "picture.png", "law paper against a$b_$c.csv", [error])
