"""What a garment is made of: draws about a median, and cloths of fits."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from worn_skirts import SIZE, learned_posterior, skirt_cell, skirt_cloth

from cusick_bench.garment import GarmentError, circular_skirt, cloth_of_cell
from cusick_bench.problem import FieldSpace, StiffnessPrior
from cusick_bench.problem.cloth_prior import CLOTH, TRAITS, trait_entry
from cusick_bench.problem.cloth_tables import cloth_tables
from cusick_bench.sim.cloth.mesh import disc_mesh


def test_draws_scatter_every_entry_of_every_element_about_the_median():
    mesh = circular_skirt(SIZE, 400).mesh
    p = skirt_cloth(spread=0.3).draw(mesh, 3, np.random.default_rng(1))
    logs = np.log(p.bending / 1e-5)
    assert logs.shape == (3, len(mesh.hinges), 3, 5)
    assert logs.mean() == pytest.approx(0, abs=0.01)
    assert logs.std() == pytest.approx(0.3, rel=0.03)
    assert np.corrcoef(logs[0, :, 0, 0], logs[0, :, 0, 1])[0, 1] == pytest.approx(0, abs=0.12)
    assert p.mass.sum(1) == pytest.approx(0.2 * mesh.areas.sum())


def test_drawn_stretch_tables_are_positive_definite():
    cloth = replace(skirt_cloth(), stretch=np.tile([10.0, 9.0, 10.0, 5.0], (1, 6, 1)), stretch_sd=np.full((6, 4), 1.0))
    c = cloth.draw(circular_skirt(SIZE, 200).mesh, 2, np.random.default_rng(0)).stretch
    assert (c[..., 0] * c[..., 2] > c[..., 1] ** 2).all()


def test_a_fit_of_shared_tables_is_scattered_by_the_given_spread(tmp_path: Path):
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a"), spread=0.2)
    assert (cloth.name, cloth.source, cloth.density) == ("wool_red", "spread", 0.27)
    assert (cloth.bending_sd == 0.2).all()
    np.testing.assert_array_equal(cloth.bending, np.full((1, 3, 5), 2e-5))


@pytest.mark.parametrize(("found_by", "hangs_by"), [("plate", "paper"), ("paper", "paper"), ("published", "published")])
def test_tables_of_law_plate_hang_by_law_paper(found_by: str, hangs_by: str, tmp_path: Path):
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a", law=found_by))
    assert cloth.law == hangs_by
    np.testing.assert_array_equal(cloth.bending, np.full((1, 3, 5), 2e-5))


def test_a_cloth_that_was_draped_heavier_than_stated_is_worn_as_heavy(tmp_path: Path):
    folder = skirt_cell(tmp_path / "cell", **learned_posterior())
    plain = cloth_of_cell(folder)
    record = json.loads((folder / "cell.json").read_text())
    record["settings"]["causes"] = ["camera-scale:scale=0.01", "density-bias:bias=0.5"]
    (folder / "cell.json").write_text(json.dumps(record))
    heavier = cloth_of_cell(folder)
    assert heavier.density == pytest.approx(1.5 * plain.density)
    np.testing.assert_array_equal(heavier.bending, plain.bending)


def test_a_result_of_an_unknown_law_is_refused(tmp_path: Path):
    with pytest.raises(GarmentError, match="law must be plate, paper or published, got 'silk'"):
        cloth_of_cell(skirt_cell(tmp_path / "a", law="silk"))


def test_a_posterior_brings_its_own_median_and_spread(tmp_path: Path):
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a", **learned_posterior()), spread=0.2)
    assert cloth.source == "posterior"
    prior = StiffnessPrior("paper", 0.27)
    logs = np.log(cloth.draw(circular_skirt(SIZE, 600).mesh, 2, np.random.default_rng(0)).bending).reshape(-1, 15)
    assert logs.mean(0) == pytest.approx(prior.bending_median.ravel(), abs=0.05)
    expected = 0.4 * np.sqrt((prior.bending_root**2).sum(1))
    assert logs.std(0) == pytest.approx(expected, rel=0.1)


def test_a_gaussian_over_whole_cloths_is_not_taken_for_one_over_elements(tmp_path: Path):
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a", tau=np.zeros(39), **learned_posterior()), spread=0.0)
    drawn = cloth.draw(circular_skirt(SIZE, 200).mesh, 200, np.random.default_rng(0)).bending
    assert cloth.source == "cloths"
    assert (drawn == drawn[:, :1]).all()  # the same all over a garment
    expected = 0.4 * np.sqrt((StiffnessPrior("paper", 0.27).bending_root ** 2).sum(1))
    assert np.log(drawn[:, 0]).reshape(-1, 15).std(0) == pytest.approx(expected, rel=0.2)


def test_every_garment_is_of_one_cloth_of_a_posterior_over_cloths(tmp_path: Path):
    cloths = np.zeros((3, CLOTH))
    cloths[:, trait_entry("bending")] = [-1.0, 0.0, 1.0]
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a", law="plate", posterior_cloths=cloths), spread=0.0)
    assert cloth.source == "cloths"
    drawn = cloth.draw(circular_skirt(SIZE, 200).mesh, 40, np.random.default_rng(0))
    assert (drawn.bending == drawn.bending[:, :1]).all()  # the same all over a garment
    levels, counts = np.unique(np.log(drawn.bending[:, 0, 0, 0]).round(9), return_counts=True)
    assert np.diff(levels) == pytest.approx([TRAITS["bending"].sd] * 2)
    assert counts.min() > 4
    stiff = drawn.bending[:, 0, 0, 0].argmax()
    assert drawn.bending[stiff, 0] == pytest.approx(cloth.bending[2])
    scattered = cloth.spread_by(0.3).draw(circular_skirt(SIZE, 400).mesh, 2, np.random.default_rng(0))
    assert np.log(scattered.bending).std(1) == pytest.approx(0.3, rel=0.15)


def test_tables_of_cloths_are_those_of_specimens_without_fields():
    space = FieldSpace(disc_mesh(100), StiffnessPrior("paper", 0.2))
    tau = torch.zeros(space.dimension, dtype=torch.float64)
    tau[: len(tau) // 10] = torch.linspace(-1, 1, len(tau) // 10)
    tau[space.specimen_level.start :] = 0
    material = space.specimen(tau).material
    stretch, bending = cloth_tables(space.prior, tau[None, :CLOTH])
    np.testing.assert_allclose(material.stretch, stretch.expand_as(material.stretch), rtol=1e-12)
    np.testing.assert_allclose(material.bending, bending.expand_as(material.bending), rtol=1e-12)


def test_tables_per_element_are_dealt_out_at_random(tmp_path: Path):
    levels = np.array([1e-5, 2e-5, 4e-5, 8e-5])
    cloth = cloth_of_cell(skirt_cell(tmp_path / "a", bending=levels[:, None, None] * np.ones((4, 3, 5))))
    assert cloth.source == "elements"
    drawn = cloth.draw(circular_skirt(SIZE, 300).mesh, 1, np.random.default_rng(0)).bending[0]
    assert (drawn == drawn[:, :1, :1]).all()
    share = (drawn[:, 0, 0] == levels[:, None]).mean(1)
    assert share.sum() == 1
    assert (np.abs(share - 0.25) < 0.06).all()


def test_a_strained_garment_has_the_stretch_stiffness_that_the_fit_has_at_rest(tmp_path: Path):
    fits = {"one": {"stretch": np.arange(1.0, 25.0).reshape(6, 4)}, "posterior": learned_posterior()}
    fits["cloths"] = {"posterior_cloths": np.random.default_rng(0).normal(size=(3, CLOTH))}
    for name, arrays in fits.items():
        stretch = cloth_of_cell(skirt_cell(tmp_path / name, **arrays)).stretch
        np.testing.assert_array_equal(stretch, np.broadcast_to(stretch[:, :1], stretch.shape))
        assert name != "one" or stretch[0, 0].tolist() == [1, 2, 3, 4]


BAD_CELLS = {
    "no stretch, bending": {"stretch": None, "bending": None},
    "posterior is of another problem": learned_posterior(posterior_scale=np.ones(15)),
    "posterior_scale must be finite and >= 0": learned_posterior(posterior_scale=np.full(39, -1.0)),
    "belongs to another problem": {"bending": np.ones((5, 3))},
    "belong to another problem": {"stretch": np.ones((7, 6, 4)), "faces": np.zeros((9, 3), int)},
    "posterior_cloths must be finite": {"posterior_cloths": np.zeros((4, 7))},
    "positive stiffness": {"bending": np.full((3, 5), np.nan)},
    "areal density must be": {"density": np.array(0.0)},
}


@pytest.mark.parametrize("message", BAD_CELLS)
def test_a_result_that_is_no_cloth_is_refused(message: str, tmp_path: Path):
    folder = skirt_cell(
        tmp_path / "a", **{key: value for key, value in BAD_CELLS[message].items() if value is not None}
    )
    if message.startswith("no stretch"):
        np.savez_compressed(folder / "prediction.npz", train_image=np.zeros((4, 4)), density=np.array(0.2))
    with pytest.raises(GarmentError, match=message):
        cloth_of_cell(folder)


def test_a_damaged_or_hostile_prediction_is_refused(tmp_path: Path):
    folder = skirt_cell(tmp_path / "a")
    whole = (folder / "prediction.npz").read_bytes()
    (folder / "prediction.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GarmentError, match="cannot read"):
        cloth_of_cell(folder)
    np.savez(folder / "prediction.npz", stretch=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(GarmentError, match="cannot read"):
        cloth_of_cell(folder)
    (folder / "prediction.npz").unlink()
    with pytest.raises(GarmentError, match="no prediction"):
        cloth_of_cell(folder)
