"""The stiffness that is shown: units against published ones, tables against the law's energy, intervals, documents."""

import json
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import torch
from toy_problem import AREAL_DENSITY, toy_problem

from cusick_bench.metrics.found_stiffness import DRAWS, find_stiffness, read_stiffness, stiffness_document
from cusick_bench.metrics.stiffness import (
    BENDING,
    BENDING_ROWS,
    GF_CM2_PER_CM,
    MG_CM,
    STRETCH,
    cloth_stiffness,
    element_weights,
)
from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.engine.triangles.elements import elements_of
from cusick_bench.sim.laws.paper import paper_stress
from cusick_bench.sim.laws.plate import plate_stiffness
from cusick_bench.solvers.base import Prediction, Solver, SolverError

CLOTH = uniform_material(density=0.2, bending=(1e-6, 2e-6, 4e-6), stretch=300.0, shear=60.0)
IMAGE = np.zeros((256, 256))


def of(material, law="paper", weights=None):
    return cloth_stiffness(material.stretch, material.bending, law, weights)


# -- law plate


@pytest.mark.parametrize("bias", [2e-6, 1.1e-6, 3e-7], ids=["of a plate", "near the softest", "too soft for a plate"])
@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_the_stiffness_of_law_plate_is_that_of_its_kernel(bias, poisson):
    rows = (1e-6, bias, 4e-6)
    material = uniform_material(density=0.2, bending=rows, poisson=poisson)
    shares, d = np.zeros((3, 5)), np.zeros((3, 4))
    shares[0, 0] = 1.0
    plate_stiffness(material.bending.numpy(), poisson, shares, d)
    d11, d22, d12, d33 = d[0]
    found = cloth_stiffness(material.stretch, material.bending, "plate", poisson=poisson)
    expected = {"warp": d11, "weft": d22, "bias": 0.25 * (d11 + d22) + 0.5 * d12 + d33}
    assert dict(zip(BENDING, found.bending, strict=True)) == pytest.approx(expected)
    assert (found.bending[BENDING.index("bias")] == pytest.approx(bias)) == (bias == 2e-6)


# -- units


def test_units_agree_with_two_published_formulas_of_one_cantilever():
    """SiroFAST: B [uN m] = 9.81e-6 W C^3, C in mm; Peirce, BS 3356: G [mg cm] = 0.10 M C^3, C in cm; both W in g/m2."""
    weight, length_mm = 150.0, 20.0
    fast = 9.81e-6 * weight * length_mm**3 * 1e-6
    peirce = 0.10 * weight * (length_mm / 10) ** 3
    assert peirce * MG_CM == pytest.approx(fast, rel=1e-3)
    assert peirce / 1000 * GF_CM2_PER_CM == pytest.approx(fast, rel=1e-3)  # 120 mg cm, 0.12 gf cm2/cm, 11.8 uN m


# -- tables


def test_a_direction_is_that_of_the_curvature():
    """Bent over a hinge along the weft, the warp bends: rows 0, 45, 90 degrees are weft, bias, warp."""
    assert dict(zip(BENDING, of(CLOTH).bending, strict=True)) == pytest.approx(
        {"weft": 1e-6, "bias": 2e-6, "warp": 4e-6}
    )
    elements = elements_of(disc_mesh(100))
    along = elements.direction_low + elements.direction_fraction  # 0 along the warp ... 2 along the weft
    corners = disc_mesh(100).material[elements.hinges[:, :2]]
    edge = np.abs(corners[:, 1] - corners[:, 0])
    assert along[edge[:, 1] > 10 * edge[:, 0]].min() > 1.8  # edges along y, over which x, the warp, bends
    assert BENDING_ROWS["warp"] == 2


def test_membrane_stiffness_is_that_of_the_laws_energy():
    found, strain = dict(zip(STRETCH, of(CLOTH).stretch, strict=True)), 1e-6
    table = CLOTH.stretch.numpy()
    assert found == pytest.approx({"warp": 300, "weft": 300, "shear": 60})
    stretched, sheared = (paper_stress(*given, table)[0] for given in ((strain, 0.0, 0.0), (0.0, 0.0, strain / 2)))
    assert 2 * stretched / strain**2 == pytest.approx(found["warp"], rel=1e-6)
    assert 2 * sheared / strain**2 == pytest.approx(found["shear"], rel=1e-6)  # Green shear is half the angle


def test_one_number_is_the_geometric_mean_over_curvatures_and_law_published_bends_as_a_quarter():
    rising = replace(CLOTH, bending=CLOTH.bending * torch.tensor([1.0, 2.0, 4.0, 8.0, 16.0]))
    assert of(rising).bending / of(CLOTH).bending == pytest.approx(4.0)
    assert of(rising).curve[:, -1] / of(rising).curve[:, 0] == pytest.approx(16.0)
    assert of(rising).bending / of(rising, "published").bending == pytest.approx(4.0)


def test_mean_over_elements_is_that_of_the_overhang_and_of_the_rows_in_use():
    mesh = disc_mesh(200)
    weights = element_weights(mesh, PLATE_RADIUS)
    elements = elements_of(mesh)
    bending, stretch = CLOTH.bending.repeat(len(mesh.hinges), 1, 1), CLOTH.stretch.repeat(len(mesh.faces), 1, 1)
    assert of(replace(CLOTH, stretch=stretch, bending=bending), weights=weights).bending == pytest.approx(
        of(CLOTH).bending
    )
    with pytest.raises(ValueError, match="weights"):
        of(replace(CLOTH, bending=bending))
    unseen = bending.clone()
    unseen[torch.from_numpy(np.hypot(*hinge_centres(mesh).T) <= PLATE_RADIUS)] *= 100  # on the plate
    use = elements.direction_low + elements.direction_fraction
    unseen[torch.from_numpy(use <= 1), 2] *= 100  # hinges that do not read row 2
    stretch[torch.from_numpy(np.hypot(*face_centres(mesh).T) <= PLATE_RADIUS)] *= 100
    found = of(replace(CLOTH, stretch=stretch, bending=unseen), weights=weights)
    assert found.bending == pytest.approx(of(CLOTH).bending)
    assert found.stretch == pytest.approx(of(CLOTH).stretch)
    assert found.bending_spread == pytest.approx(0, abs=1e-6)


def test_elements_weigh_as_their_areas():
    mesh = disc_mesh(200)
    weights, elements = element_weights(mesh, PLATE_RADIUS), elements_of(mesh)
    corners = mesh.hinge_corners  # of (v0, v1, opposite) in either face
    along, beside = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    area = 0.5 * np.abs(along[..., 0] * beside[..., 1] - along[..., 1] * beside[..., 0]).sum(1)
    position = elements.direction_low + elements.direction_fraction
    outside = np.hypot(*hinge_centres(mesh).T) > PLATE_RADIUS
    for place, name in enumerate(BENDING):
        expected = area * outside * np.maximum(1 - np.abs(position - BENDING_ROWS[name]), 0)
        np.testing.assert_allclose(weights.hinges[place], expected / expected.sum(), rtol=1e-9, atol=1e-15)
    overhang = mesh.areas * (np.hypot(*face_centres(mesh).T) > PLATE_RADIUS)
    np.testing.assert_allclose(weights.faces, overhang / overhang.sum(), rtol=1e-12)


def test_spread_is_that_of_the_logarithm_between_elements():
    mesh = disc_mesh(600)
    noise = torch.from_numpy(np.random.default_rng(0).normal(0, 0.3, len(mesh.hinges)))
    uneven = replace(CLOTH, bending=CLOTH.bending * noise.exp()[:, None, None])
    found = of(uneven, weights=element_weights(mesh, PLATE_RADIUS))
    assert found.bending_spread == pytest.approx(0.3, abs=0.04)
    assert found.bending / of(CLOTH).bending == pytest.approx(1.0, abs=0.05)


# -- what was found


@dataclass(frozen=True)
class _Posterior(Solver):
    """Draws tau ~ N(mean, 0.2^2)."""

    name: ClassVar[str] = "posterior"

    def redraw(self, problem, posterior, index):
        return posterior["mean"] + 0.2 * np.random.default_rng(index).standard_normal(problem.dimension)

    def _solve(self, problem, generator, progress):
        raise NotImplementedError


def _prediction(tau, posterior=None) -> Prediction:
    return Prediction(IMAGE, IMAGE[None], tau=tau, posterior=posterior)


@dataclass(frozen=True)
class _Forgetful(_Posterior):
    """Keeps a posterior, and forgets to say how cloths are drawn from it."""

    name: ClassVar[str] = "forgetful"

    redraw = Solver.redraw


def test_a_posterior_without_redraw_is_told_what_to_define():
    problem = toy_problem()
    mean = problem.space.bending_level(2.0)
    with pytest.raises(
        SolverError, match="forgetful defines no `redraw`, which draws cloths from its posterior; define"
    ):
        find_stiffness(_Forgetful(), problem, _prediction(mean, {"mean": mean}))


def test_interval_holds_the_middle_of_the_draws():
    problem = toy_problem()
    mean = problem.space.bending_level(2.0)
    found, draws = find_stiffness(_Posterior(), problem, _prediction(mean, {"mean": mean}))
    assert found is not None
    solver, bending, shear = _Posterior(), [], []
    for index in range(DRAWS):
        material = problem.space.specimen(torch.from_numpy(solver.redraw(problem, {"mean": mean}, index))).material
        bending.append(np.exp(np.log(material.bending.numpy()[2]).mean()))
        shear.append(float(material.stretch[0, 3]))
    assert found.bending["warp"].value == pytest.approx(np.median(bending))
    assert found.bending["warp"].ci90 == pytest.approx(np.quantile(bending, [0.05, 0.95]))
    assert found.stretch["shear"].ci90 == pytest.approx(np.quantile(shear, [0.05, 0.95]))
    assert draws is not None
    assert draws[:, 0] == pytest.approx(bending)


def test_a_field_of_one_specimen_is_not_the_cloths():
    """Draws of the space `field` differ in their specimens; the interval is of the cloth they are cut from."""
    problem = toy_problem(space="field")

    @dataclass(frozen=True)
    class Specimens(_Posterior):
        def redraw(self, problem, posterior, index):
            tau = np.random.default_rng(index).standard_normal(problem.dimension)
            tau[: problem.space.specimen_level.start] = 0
            return tau

    found, _ = find_stiffness(Specimens(), problem, _prediction(np.zeros(problem.dimension), {}))
    assert found is not None
    low, high = found.bending["warp"].ci90 or (0, 0)
    assert low == pytest.approx(high)
    assert found.spread["warp"] > 0.05  # between elements of a specimen


def test_truth_is_found_with_a_ratio_of_one_and_an_answer_without_parameters_has_none():
    problem = toy_problem()
    tau = problem.space.bending_level(3.0)
    tables = problem.space.specimen(torch.from_numpy(tau)).material
    found, draws = find_stiffness(_Posterior(), problem, _prediction(tau), of(tables))
    assert found is not None
    assert draws is None
    assert {name: one.value for name, one in found.bending_ratio.items()} == pytest.approx(dict.fromkeys(BENDING, 1))
    assert all(one.ci90 is None for one in (*found.bending.values(), *found.stretch.values()))
    limper, _ = find_stiffness(_Posterior(), problem, _prediction(problem.space.bending_level(1.0)), of(tables))
    assert limper is not None
    assert limper.bending_ratio["bias"].value == pytest.approx(1 / 3)
    assert float(tables.density) == AREAL_DENSITY
    assert find_stiffness(_Posterior(), problem, _prediction(None)) == (None, None)


# -- documents


@pytest.fixture(scope="module")
def document() -> dict:
    problem = toy_problem()
    mean = problem.space.bending_level(2.0)
    tables = problem.space.specimen(torch.from_numpy(mean)).material
    found, _ = find_stiffness(_Posterior(), problem, _prediction(mean, {"mean": mean}), of(tables))
    return json.loads(json.dumps(stiffness_document(found)))


def test_document_has_each_direction_in_both_units(document):
    assert list(document["stiffness"]) == ["warp", "weft", "bias"]
    for name, one in document["stiffness"].items():
        assert set(one) == {"value", "ci90"}
        assert one["ci90"][0] < one["value"] < one["ci90"][1]
        kawabata = document["stiffness_gf_cm2_cm"][name]
        assert np.array([one["value"], *one["ci90"]]) == pytest.approx(
            9.80665e-5 * np.array([kawabata["value"], *kawabata["ci90"]])
        )
        assert len(document["stiffness_curve"][name]) == 5
    assert list(document["stretch"]) == ["warp", "weft", "shear"]
    assert document["truth_ratio"]["stiffness"]["warp"]["value"] == pytest.approx(1, abs=0.1)
    assert document["units"]["stiffness"] == "N m"
    assert document["units"]["stretch"] == "N/m"


def test_a_document_is_read_as_it_was_written(document):
    again = read_stiffness(document)
    assert again is not None
    written = again.document()
    for name in ("stiffness", "stiffness_curve", "stiffness_spread", "stretch", "units"):
        assert json.loads(json.dumps(written[name])) == document[name]
    for name, one in document["truth_ratio"]["stiffness"].items():
        assert written["truth_ratio"]["stiffness"][name]["ci90"] == pytest.approx(one["ci90"])
    assert again.true_bending is not None
    assert again.bending["warp"].holds(again.true_bending["warp"])


def test_results_without_stiffness_read_as_none():
    assert read_stiffness({"metrics": {}}) is None  # of before it was recorded
    nothing = stiffness_document(None)
    assert {value for name, value in nothing.items() if name != "units"} == {None}
    assert read_stiffness(nothing) is None


@pytest.mark.parametrize(
    "change",
    [
        {"stiffness": [1, 2]},
        {"stiffness": {"warp": {"value": 1.0}}},
        {"stiffness": {name: {"value": "much"} for name in BENDING}},
        {"stiffness": {name: {"value": -1.0} for name in BENDING}},
        {"stiffness": {name: {"value": 1.0, "ci90": [1.0]} for name in BENDING}},
        {"stretch": None},
        {"truth_ratio": {"stiffness": {}}},
        {"truth_ratio": 3},
        {"stiffness_curve": {"warp": 1}},
        {"stiffness_spread": {"weft": 1.0}},
    ],
)
def test_a_malformed_document_is_refused(document, change):
    with pytest.raises(ValueError, match=r"stiffness|stretch|truth_ratio"):
        read_stiffness(document | change)


def test_an_unknown_law_and_a_plate_as_wide_as_the_cloth_are_refused():
    """`Published` gave four times the stiffness of `published`, and a plate in millimetres stiffness that is NaN."""
    cloth = uniform_material(density=0.2, bending=1e-5)
    with pytest.raises(ValueError, match="law must be one of plate, paper, published, got 'Published'"):
        cloth_stiffness(cloth.stretch, cloth.bending, "Published")
    with pytest.raises(ValueError, match="beyond a plate of 90 m; give the radius of the plate in metres"):
        element_weights(disc_mesh(100), 90.0)
