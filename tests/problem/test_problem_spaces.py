"""What a problem is made of: priors, parameter spaces, losses, and the laying of the cloth."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.profile import profile_from_image
from cusick_bench.problem import (
    LOSSES,
    SPACES,
    HeterogeneousSpace,
    HomogeneousSpace,
    ProblemError,
    StiffnessPrior,
)
from cusick_bench.problem.laying import laid_like
from cusick_bench.problem.losses import radius_profile
from cusick_bench.problem.priors import (
    BENDING_INTERCEPT,
    BENDING_RESIDUAL_COVARIANCE,
    BENDING_SLOPE,
    DENSITY_REFERENCE,
)
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.solvers.reference.silhouettes import silhouette

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(7)


def _flowery(phase: float) -> np.ndarray:
    angle = np.arange(720) * (2 * np.pi / 720)
    return silhouette(0.12 + 0.01 * np.cos(8 * angle + phase))


class TestPrior:
    def test_median_is_the_regression_on_density(self):
        table = StiffnessPrior("paper", 0.15).bending(torch.zeros(15, dtype=torch.float64))
        assert table.numpy() == pytest.approx(np.exp(np.repeat(BENDING_INTERCEPT[:, None], 5, 1)))
        heavier = StiffnessPrior("paper", 0.30).bending(torch.zeros(15, dtype=torch.float64))
        assert (heavier / table).numpy()[:, 0] == pytest.approx(2**BENDING_SLOPE)

    def test_published_law_gets_four_times_the_table(self):
        zero = torch.zeros(15, dtype=torch.float64)
        ratio = StiffnessPrior("published", 0.2).bending(zero) / StiffnessPrior("paper", 0.2).bending(zero)
        assert ratio.numpy() == pytest.approx(4.0)

    def test_draws_have_the_fabrics_covariance(self, generator):
        prior = StiffnessPrior("paper", 0.2)
        draws = prior.bending(torch.as_tensor(generator.standard_normal((20_000, 15)))).log().numpy()
        rows = draws.mean(-1)
        expected = BENDING_RESIDUAL_COVARIANCE + np.eye(3) * 0.2**2 / 5
        assert np.cov(rows.T) == pytest.approx(expected, abs=0.03)

    def test_every_table_is_admissible(self, generator):
        prior = StiffnessPrior("paper", 0.2)
        c11, c12, c22, c33 = prior.stretch(torch.as_tensor(4 * generator.standard_normal((500, 24)))).unbind(-1)
        for diagonal in (c11, c22, c33):
            assert (diagonal > 0).all()
        assert (c12.abs() < (c11 * c22).sqrt() * (1 + 1e-12)).all()
        assert (prior.bending(torch.as_tensor(4 * generator.standard_normal((500, 15)))) > 0).all()

    def test_tau_of_a_table_inverts_the_table_of_tau(self, generator):
        prior, tau = StiffnessPrior("paper", 0.1), generator.standard_normal(15)
        assert prior.bending_tau(prior.bending(torch.as_tensor(tau)).numpy()) == pytest.approx(tau)

    def test_level_scales_every_stiffness(self):
        prior = StiffnessPrior("paper", 0.1)
        zero = torch.zeros(15, dtype=torch.float64)
        ratio = prior.bending(torch.as_tensor(prior.bending_level(2.5))) / prior.bending(zero)
        assert ratio.numpy() == pytest.approx(2.5)

    @pytest.mark.parametrize("density", [0.0, -0.1, math.nan])
    def test_density_must_be_positive(self, density):
        with pytest.raises(ProblemError, match=r"must be > 0 kg/m2.*fabrics\.csv"):
            _ = StiffnessPrior("paper", density).bending_median

    def test_unknown_law(self):
        with pytest.raises(ProblemError, match="unknown material law 'hooke'"):
            StiffnessPrior("hooke", 0.1)

    def test_constants_follow_from_the_fabric_table(self, real_data: Path):
        table = real_data.parent / "priors" / "fabrics618.csv"
        if not table.exists():
            pytest.skip(f"no fabric table at {table}")
        columns = np.loadtxt(table, delimiter=",", skiprows=1)  # kg/m2; B of warp, weft, bias [1e-9 N m]
        log_bending = np.log(columns[:, [2, 3, 1]] * 1e-9)  # weft, bias, warp
        design = np.stack([np.ones(len(columns)), np.log(columns[:, 0] / DENSITY_REFERENCE)], 1)
        (intercept, slope), *_ = np.linalg.lstsq(design, log_bending, rcond=None)
        residuals = log_bending - design @ [intercept, slope]
        assert intercept == pytest.approx(BENDING_INTERCEPT, abs=1e-4)
        assert slope == pytest.approx(BENDING_SLOPE, abs=1e-4)
        assert np.cov(residuals.T) == pytest.approx(BENDING_RESIDUAL_COVARIANCE, abs=1e-4)


class TestSpaces:
    @pytest.mark.parametrize("name", SPACES)
    def test_contract(self, name, generator):
        mesh = disc_mesh(80)
        space = SPACES[name](mesh, StiffnessPrior("paper", 0.2))
        lower, upper = space.bounds
        tau = space.sample_prior(generator)
        assert tau.shape == lower.shape == upper.shape == (space.dimension,)
        assert (lower < upper).all()
        parameters = torch.as_tensor(tau).requires_grad_()
        cloth = space.specimen(parameters)
        cloth.material.check_fits(mesh)
        total = (
            cloth.material.stretch.sum() + cloth.material.bending.sum() + torch.as_tensor(cloth.material.poisson).sum()
        )
        for shape in (cloth.initial, cloth.rest_angle):
            total = total if shape is None else total + shape.square().sum()
        total.backward()
        assert parameters.grad is not None
        assert (parameters.grad != 0).all(), "a parameter without any effect"
        level = space.specimen(torch.as_tensor(space.bending_level(2.0))).material.bending
        median = space.specimen(torch.zeros(space.dimension, dtype=torch.float64)).material.bending
        assert (level / median).numpy() == pytest.approx(2.0)

    def test_sizes_at_paper_size(self):
        mesh = disc_mesh(2699)
        prior = StiffnessPrior("paper", 0.2)
        assert HomogeneousSpace(mesh, prior).dimension == 39
        assert HeterogeneousSpace(mesh, prior).dimension == 24 * len(mesh.faces) + 15 * len(mesh.hinges)

    def test_equal_elements_drape_like_a_homogeneous_cloth(self, generator):
        homo, heter = toy_problem(), toy_problem(space="heter")
        tau, mesh = 0.3 * homo.sample_prior(generator), homo.simulator.mesh
        parts = np.tile(tau[:24], len(mesh.faces)), np.tile(tau[24:], len(mesh.hinges))
        assert heter.evaluate(np.concatenate(parts)) == pytest.approx(homo.evaluate(tau), rel=1e-9)


class TestLosses:
    @pytest.mark.parametrize("name", LOSSES)
    def test_zero_only_at_the_target(self, name):
        image, other = torch.as_tensor(_flowery(0.0)), torch.as_tensor(_flowery(0.4))
        assert LOSSES[name](image, image).item() == 0
        assert LOSSES[name](other, image).item() > 1e-3

    def test_mse_is_the_pixels(self):
        ones = torch.ones(256, 256, dtype=torch.float64)
        assert LOSSES["mse"](0.5 * ones, ones).item() == pytest.approx(0.25)

    def test_profile_reads_radii(self):
        image = torch.as_tensor(silhouette(np.full(720, 0.11)))
        assert radius_profile(image).numpy() == pytest.approx(0.11, abs=2e-4)
        wider = torch.as_tensor(silhouette(np.full(720, 0.116)))
        assert LOSSES["profile"](wider, image).item() == pytest.approx(0.01, rel=0.02)

    @pytest.mark.parametrize("image_y", ["up", "down"])
    @pytest.mark.parametrize("projection", ["parallel", "pinhole"])
    def test_radii_are_those_that_the_data_are_measured_by(self, image_y, projection):
        """Counter-clockwise from +x about the plate's axis, wherever it lies and whichever way y points."""
        protocol = Protocol(px_per_m=700.0, centre_px=(120.0, 131.5), image_y=image_y, projection=projection)
        angle = np.arange(720) * (np.pi / 360)
        image = silhouette(0.115 + 0.008 * np.cos(5 * angle - 1.0) + 0.004 * np.sin(2 * angle), protocol)
        radii = radius_profile(torch.as_tensor(image), protocol).numpy()
        assert radii == pytest.approx(profile_of(image, protocol).radii[::2], abs=5e-4)


class TestLaying:
    def test_follows_the_silhouette_without_stretching_generators(self):
        mesh = disc_mesh(600)
        laid = laid_like(profile_from_image(_flowery(0.0)).radii, mesh).numpy()
        rest, radius = np.hypot(*mesh.material.T), np.hypot(*laid[:, :2].T)
        on_plate = rest <= 0.09
        assert laid[on_plate, 2] == pytest.approx(0, abs=1e-12)
        slant = np.hypot(radius - 0.09, laid[:, 2])[~on_plate]
        assert slant == pytest.approx(rest[~on_plate] - 0.09, abs=1e-9)
        rim = mesh.boundary
        angle = np.arctan2(mesh.material[rim, 1], mesh.material[rim, 0])
        assert np.corrcoef(np.cos(8 * angle), laid[rim, 2])[0, 1] > 0.99, "rim must be high where it stands out"
