"""Random fields: covariance, modes, and what they do to drapes."""

import math

import numpy as np
import pytest
import torch
from toy_problem import AREAL_DENSITY, toy_problem

from cusick_bench.problem import FieldSpace, StiffnessPrior
from cusick_bench.problem.cloth_prior import FIELDS, MODES, MOST_POISSON, TRAITS, length_entry, trait_entry
from cusick_bench.problem.cloth_tables import mean_bending, trait
from cusick_bench.problem.leading import LEADING
from cusick_bench.problem.priors import BENDING_SLOPE, DENSITY_REFERENCE, STRETCH_REFERENCE
from cusick_bench.sim.cloth.heterogeneity import hinge_centres
from cusick_bench.sim.cloth.matern import disc_modes, matern_root
from cusick_bench.sim.cloth.mesh import disc_mesh

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def space() -> FieldSpace:
    return FieldSpace(disc_mesh(200), StiffnessPrior("paper", AREAL_DENSITY))


def table_median(space: FieldSpace) -> np.ndarray:
    return np.exp(space.prior.bending_median)


def _circumcentre(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Of triangles, whose corners are one a row."""
    first, second = b - a, c - a
    twice = 2 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    by_first, by_second = (first**2).sum(1), (second**2).sum(1)
    x = (second[:, 1] * by_first - first[:, 1] * by_second) / twice
    y = (first[:, 0] * by_second - second[:, 0] * by_first) / twice
    return a + np.stack([x, y], 1)


def _disc_points(radius: float, count: int) -> np.ndarray:
    """Evenly spread points of a disc (a sunflower), of equal area each."""
    index = np.arange(count) + 0.5
    angle = index * math.pi * (3 - math.sqrt(5))
    return (radius * np.sqrt(index / count) * np.stack([np.cos(angle), np.sin(angle)])).T


class TestModes:
    def test_are_orthonormal(self):
        modes = disc_modes(60)
        values = modes(_disc_points(modes.radius, 20_000))
        gram = values.T @ values * (math.pi * modes.radius**2 / 20_000)
        assert np.abs(gram - np.eye(60)).max() < 0.02

    def test_are_eigenfunctions(self):
        modes, step = disc_modes(40), 1e-4
        points = _disc_points(0.9 * modes.radius, 50)
        shifts = step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        around = sum(modes(points + shift) for shift in shifts)
        laplacian = (around - 4 * modes(points)) / step**2
        expected = -(modes.wave_number**2) * modes(points)
        assert laplacian == pytest.approx(expected, abs=2e-4 * np.abs(expected).max())

    def test_none_of_the_lowest_is_missing(self):
        """Weyl's law with its edge term: N(k) = (k R)^2 / 4 + k R / 2 for a free edge."""
        modes = disc_modes(400)
        reach = modes.wave_number[-1] * modes.radius
        assert reach**2 / 4 + reach / 2 == pytest.approx(400, rel=0.03)

    def test_covariance_is_matern(self):
        """Smoothness 2: C(d) = (k d)^2 K_2(k d) / 2, k = 2 / length."""
        from scipy.special import kv

        modes, length = disc_modes(800), 0.04
        root = matern_root(modes, torch.tensor(1.5), torch.tensor(length)).numpy()
        distance = np.array([0.01, 0.02, 0.04, 0.06])
        origin, points = np.array([[0.03, 0.01]]), np.array([0.03, 0.01]) + distance[:, None] * np.array([[0.6, 0.8]])
        weighted = modes(origin) * root**2
        correlation = (modes(points) @ weighted.T)[:, 0] / (modes(origin) @ weighted.T)[0, 0]
        scaled = 2 * distance / length
        assert correlation == pytest.approx(scaled**2 * kv(2, scaled) / 2, abs=0.03)

    def test_amplitude_is_the_mean_variance(self):
        modes = disc_modes(MODES)
        root = matern_root(modes, torch.tensor(2.0), torch.tensor(0.03)).numpy()
        variance = ((modes(_disc_points(modes.radius, 2_000)) * root) ** 2).sum(1)
        assert variance.mean() == pytest.approx(4.0, rel=0.01)


class TestSpace:
    def test_median_is_a_cloth_of_median_traits_laid_flat(self, space):
        cloth = space.specimen(torch.zeros(space.dimension, dtype=torch.float64))
        stretch = STRETCH_REFERENCE * math.exp(TRAITS["stretch"].mean)
        assert cloth.material.stretch.numpy() == pytest.approx(np.broadcast_to(stretch, (len(space.mesh.faces), 6, 4)))
        assert cloth.initial.numpy() == pytest.approx(space.mesh.flat)
        assert cloth.rest_angle.numpy() == pytest.approx(0.0, abs=1e-12)
        factors = cloth.material.bending[0].log().numpy() - space.prior.bending_median
        assert np.diff(factors, axis=1) == pytest.approx(TRAITS["hardening"].mean)
        grain = TRAITS["grain"].mean / 2
        rows = [-grain, TRAITS["bias"].mean, grain]
        assert factors[:, 2] - TRAITS["bending"].mean == pytest.approx(rows, abs=1e-12)
        assert cloth.material.poisson.item() == pytest.approx(MOST_POISSON / 2)

    def test_a_cloth_that_curls_rises_towards_its_face_alike_all_over(self, space):
        """A cap of curvature k: hinges turn by k times the distance of the triangles' circumcentres (of a sphere)."""
        tau = torch.zeros(space.dimension, dtype=torch.float64)
        tau[trait_entry("curl")] = 2.0
        curvature = TRAITS["curl"].mean + 2.0 * TRAITS["curl"].sd
        start, end, left, right = space.mesh.material[space.mesh.hinges].transpose(1, 0, 2)
        apart = np.linalg.norm(_circumcentre(start, end, left) - _circumcentre(start, end, right), axis=1)
        concave = -curvature * apart  # seen from the face
        assert space.specimen(tau).rest_angle.numpy() == pytest.approx(concave, rel=1e-3, abs=1e-6)

    def test_a_rest_shape_has_no_crease_along_the_edge_of_the_plate(self, space):
        taus = torch.from_numpy(np.random.default_rng(11).standard_normal((100, space.dimension)))
        angles = np.stack([space.specimen(tau).rest_angle.numpy() for tau in taus]).std(0)
        from_edge = np.abs(np.hypot(*hinge_centres(space.mesh).T) - space.plate_radius)
        assert angles[from_edge < 0.012].mean() == pytest.approx(angles[from_edge > 0.02].mean(), rel=0.4)

    def test_leading_directions_are_what_their_names_say(self, space):
        """Of a random cloth's own tables, and those of a heavier one that is stiffer by as much."""
        tau = torch.from_numpy(np.random.default_rng(7).standard_normal(space.dimension))
        tau[space.specimen_level] = 0
        cloth = space.specimen(tau).material
        weft, bias, warp = (cloth.bending[0].log().numpy() - np.log(table_median(space))).mean(1)
        c11, _, c22, c33 = (cloth.stretch[0] / torch.from_numpy(STRETCH_REFERENCE)).log()[0].tolist()
        size = space.specimen_level.start
        found = dict(zip(LEADING, space.leading(tau[None, :size].numpy())[0], strict=True))
        heavier = FieldSpace(space.mesh, StiffnessPrior("paper", 2 * AREAL_DENSITY)).leading(tau[None, :size].numpy())[
            0
        ]
        weight = math.log(space.prior.density / DENSITY_REFERENCE)
        slope = BENDING_SLOPE[[0, 2]].mean()
        assert found["bending"] == pytest.approx((warp + weft) / 2 + (slope - 1) * weight)
        assert found["bias"] == pytest.approx(bias - (warp + weft) / 2 + (BENDING_SLOPE[1] - slope) * weight)
        assert found["grain"] == pytest.approx(warp - weft + (BENDING_SLOPE[2] - BENDING_SLOPE[0]) * weight)
        assert found["stretch"] == pytest.approx((c11 + c22) / 2 - weight)
        assert found["shear"] == pytest.approx(c33 - (c11 + c22) / 2)
        assert heavier[0] - found["bending"] == pytest.approx((slope - 1) * math.log(2))
        assert space.leading.rest(tau[None, :size].numpy()) @ space.leading.rows.T == pytest.approx(0, abs=1e-9)

    def test_a_cloth_that_drapes_alike_at_half_the_size_has_the_same_leading_directions(self, space):
        """B / (weight R^3), C / (weight R), curl times R and the laid shape's length over R are the same."""
        half = FieldSpace(space.mesh, space.prior, space.plate_radius / 2, space.cloth_radius / 2)
        cloth = np.random.default_rng(8).standard_normal((1, space.specimen_level.start))
        alike, own = cloth.copy(), {name: TRAITS[name] for name in ("bending", "stretch", "curl")}
        alike[0, trait_entry("bending")] -= 3 * math.log(2) / own["bending"].sd
        alike[0, trait_entry("stretch")] -= math.log(2) / own["stretch"].sd
        alike[0, trait_entry("curl")] *= 2  # of which the mean is 0
        alike[0, length_entry("laying")] -= math.log(2) / FIELDS["laying"].length_sd
        assert own["curl"].mean == 0
        assert half.leading(alike) == pytest.approx(space.leading(cloth))

    def test_turned_over_a_cloth_has_the_other_rest_shape_and_nothing_else(self, space):
        tau = np.random.default_rng(9).standard_normal(space.dimension)
        one, other = (space.specimen(torch.from_numpy(each)) for each in (tau, space.turned(tau)))
        assert one.rest_angle.abs().max() > 0.01
        assert other.rest_angle.numpy() == pytest.approx(-one.rest_angle.numpy(), abs=1e-12)
        assert (other.initial == one.initial).all()
        assert (other.material.bending == one.material.bending).all()
        assert (space.turned(space.turned(tau)) == tau).all()
        size = space.specimen_level.start
        assert (space.turned(tau[:size]) == space.turned(tau)[:size]).all(), "a cloth by itself, without weights"

    def test_stiffness_of_cloths_is_that_of_a_plate_whatever_the_law(self, space):
        """The published law's tables are four times what they act as."""
        cloths = np.random.default_rng(10).standard_normal((3, space.specimen_level.start))
        found = {law: mean_bending(StiffnessPrior(law, AREAL_DENSITY), cloths) for law in ("paper", "published")}
        assert found["published"] == pytest.approx(found["paper"])
        cloth = space.specimen(torch.from_numpy(np.concatenate([cloths[0], np.zeros(3 * MODES)])))
        assert found["paper"][0] == pytest.approx(cloth.material.bending[0].log().mean().exp().item())

    def test_traits_are_a_standard_deviation_of_theirs_away(self, space):
        tau = torch.zeros(space.dimension, dtype=torch.float64)
        tau[39:46] = torch.tensor([3.0, 1.0, -1.0, 2.0, 0.0, -2.0, 1.5])
        found = {name: trait(tau, name).item() for name in TRAITS}
        sign = dict(zip(TRAITS, (3, 1, -1, 2, 0, -2, 1.5), strict=True))
        assert found == pytest.approx({name: prior.mean + sign[name] * prior.sd for name, prior in TRAITS.items()})

    def test_level_is_the_most_probable_cloth_of_that_stiffness(self, space):
        """All bending stiffnesses rise alike, by trait and table together: any other share is less probable."""
        zero, level = (torch.as_tensor(tau) for tau in (np.zeros(space.dimension), space.bending_level(3.0)))
        ratio = space.specimen(level).material.bending / space.specimen(zero).material.bending
        assert ratio.numpy() == pytest.approx(3.0)
        own, trait = space.prior.bending_level(3.0), math.log(3.0) / TRAITS["bending"].sd
        for share in np.linspace(0, 1, 11):
            assert share**2 * own @ own + (1 - share) ** 2 * trait**2 >= float(level @ level) - 1e-12
        assert float(space.bending_level(1.0) @ space.bending_level(1.0)) == 0

    def test_specimens_of_a_cloth_differ_in_level(self, space):
        """The mean over the cloth of log stiffness, beside what the field itself has of it."""
        draws = torch.from_numpy(np.random.default_rng(5).standard_normal((400, space.dimension)))
        draws[:, : space.specimen_level.start] = 0
        means = torch.stack([space.field(tau, "stiffness").mean() for tau in draws])
        assert FIELDS["stiffness"].level == pytest.approx(means.std().item(), rel=0.25)

    def test_level_of_a_specimen_is_its_mean_stiffness_outside_of_the_plate(self, space):
        draws = np.random.default_rng(6).standard_normal((300, space.dimension))
        outside = np.hypot(*hinge_centres(space.mesh).T) > space.plate_radius
        found = space.levels(draws)
        means = [space.field(torch.from_numpy(tau), "stiffness")[outside].mean().item() for tau in draws[:5]]
        assert found[:5] == pytest.approx(means)
        draws[:, : space.specimen_level.start] = draws[0, : space.specimen_level.start]
        cloth = draws[0, : space.specimen_level.start]
        assert space.levels(draws).std() == pytest.approx(space.level_sd(cloth), rel=0.15)

    def test_a_stiffer_specimen_has_the_leading_directions_of_a_stiffer_cloth(self, space):
        cloth, level = np.zeros((1, space.specimen_level.start)), np.array([0.4])
        stiffer = cloth.copy()
        stiffer[0, trait_entry("bending")] = 0.4 / TRAITS["bending"].sd
        stiffer[0, trait_entry("stretch")] = 0.4 / TRAITS["stretch"].sd
        assert space.leading(cloth, level) == pytest.approx(space.leading(stiffer))
        assert space.leading.scaled(cloth, level) == pytest.approx(space.leading.scaled(stiffer))
        assert space.leading.scaled_level * level == pytest.approx(space.leading.scaled(stiffer)[0])

    def test_fields_have_their_prior_amplitudes(self, space):
        generator = np.random.default_rng(0)
        draws = torch.from_numpy(generator.standard_normal((200, space.dimension)))
        draws[:, : space.specimen_level.start] = 0
        for name, prior in FIELDS.items():
            values = torch.stack([space.field(tau, name) for tau in draws])
            expected = math.hypot(prior.amplitude, prior.level)
            assert values.square().mean().sqrt().item() == pytest.approx(expected, rel=0.15)

    def test_the_same_weights_are_the_same_field_on_every_mesh(self, space):
        other = FieldSpace(disc_mesh(400), space.prior)
        tau = torch.from_numpy(np.random.default_rng(1).standard_normal(space.dimension))
        laying = FIELDS["laying"]
        tau[length_entry("laying")] = math.log(0.04 / laying.length) / laying.length_sd  # longer than edges
        nearest = np.linalg.norm(space.mesh.material[:, None] - other.mesh.material, axis=-1).argmin(0)
        coarse, fine = space.field(tau, "laying")[nearest], other.field(tau, "laying")
        assert np.corrcoef(coarse, fine)[0, 1] > 0.9

    def test_the_plate_is_flat(self, space):
        tau = torch.from_numpy(np.random.default_rng(2).standard_normal(space.dimension))
        held = np.hypot(*space.mesh.material.T) <= space.plate_radius
        laid = space.specimen(tau).initial
        assert (laid[held, 2] == 0).all()
        assert laid[~held, 2].abs().max() > 1e-4

    def test_laid_like_undulates_as_asked(self, space):
        angle = np.arctan2(space.mesh.material[:, 1], space.mesh.material[:, 0])
        wanted = FIELDS["laying"].amplitude * np.cos(7 * angle)
        tau = torch.zeros(space.dimension, dtype=torch.float64)
        tau[space.weights("laying")] = torch.from_numpy(space.laid_like(wanted))
        outside = np.hypot(*space.mesh.material.T) > space.plate_radius + 0.01
        assert np.corrcoef(space.field(tau, "laying")[outside], wanted[outside])[0, 1] > 0.97

    def test_gradient_equals_central_differences(self):
        problem = toy_problem(space="field", vertices=80)
        generator = np.random.default_rng(3)
        tau, direction = (generator.standard_normal(problem.dimension) for _ in range(2))
        tau = 0.5 * tau + problem.space.bending_level(3.0)  # a limp cloth's folds would run away on so coarse a mesh
        _, gradient = problem.evaluate_and_gradient(tau)
        step = 1e-8  # the loss is steep here: a tenfold step is off by 1e-4
        rise = problem.evaluate(tau + step * direction) - problem.evaluate(tau - step * direction)
        assert gradient @ direction == pytest.approx(rise / (2 * step), rel=1e-4)


def test_fields_move_folds_and_stiffness_of_single_elements_does_not():
    """Mean squared difference between draws of one cloth: several times larger with fields."""
    from cusick_bench.metrics import mse_pairs

    spread = {}
    for name in ("field", "heter"):
        problem = toy_problem(space=name, vertices=297)
        start = problem.space.bending_level(3.0)
        noise = 0.2 * np.random.default_rng(4).standard_normal((8, problem.dimension))
        if name == "field":  # the specimen alone differs
            noise /= 0.2
            noise[:, : problem.space.specimen_level.start] = 0
        images = np.stack([seen.image for seen in problem.draw_batch(start + noise) if seen is not None])
        pairs = mse_pairs(images, images)
        spread[name] = pairs[~np.eye(len(images), dtype=bool)].mean()
    assert spread["field"] > 5 * spread["heter"]
