"""Rows without physics, and those that have seen the answer."""

from dataclasses import replace

import numpy as np
import pytest
from solver_answers import answer_of
from toy_problem import toy_held_out, toy_problem

from cusick_bench.datasets import load
from cusick_bench.datasets.profile import amplitude_spectrum, profile_from_image
from cusick_bench.metrics import expected_best, mse_pairs
from cusick_bench.runner import plan
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.reference.silhouettes import silhouette

pytestmark = pytest.mark.usefixtures("one_thread")


class TestReferenceRows:
    def test_silhouette_inverts_its_profile(self):
        angle = np.arange(720) * (2 * np.pi / 720)
        radii = 0.12 + 0.01 * np.cos(7 * angle - 0.3)
        assert profile_from_image(silhouette(radii)).radii == pytest.approx(radii, abs=2e-4)

    def test_disc_has_the_area(self):
        problem = toy_problem()
        disc = answer_of("null:disc", problem).train_image
        assert disc.sum() == pytest.approx(problem.train_image.sum(), rel=1e-3)
        assert np.ptp(profile_from_image(disc).radii) < 3e-4

    def test_copy_is_the_image(self):
        problem = toy_problem()
        assert (answer_of("null:copy", problem).draws[0] == problem.train_image).all()

    def test_rotations_turn_counter_clockwise(self):
        problem = toy_problem()
        draws = answer_of("null:rotation,draws=4", problem).draws
        for quarter in range(4):
            turned = np.rot90(problem.train_image, quarter)
            errors = np.square(draws - turned).mean((1, 2))
            assert errors.argmin() == quarter
            assert errors.min() < 0.002

    def test_rotations_that_repeat_are_told_where_they_are_planned(self, caplog):
        for draws in (720, 721):  # what is told agrees with what is drawn
            turned = answer_of(f"null:rotation,draws={draws}", toy_problem()).draws
            assert len({draw.tobytes() for draw in turned}) == 720
        plan(load("synthetic"), solvers=["null:rotation,draws=720"])
        assert not caplog.messages
        plan(load("synthetic"), solvers=["null:rotation,draws=721"])
        (told,) = caplog.messages
        assert told.startswith("null:rotation,draws=721: a profile has 720 angles")
        assert told.endswith("give draws=720 or fewer")

    def test_random_phases_keep_amplitudes_only(self):
        problem = toy_problem()
        draws = answer_of("null:random-phase,draws=5", problem).draws
        expected = amplitude_spectrum(profile_from_image(problem.train_image))[:12]
        for draw in draws:
            assert amplitude_spectrum(profile_from_image(draw))[:12] == pytest.approx(expected, abs=5e-4)
        assert np.square(draws[0] - draws[1]).mean() > 1e-4
        other = answer_of("null:random-phase,draws=5", problem, seed=1).draws
        assert (other != draws).any()

    def test_draws_must_be_positive(self):
        with pytest.raises(SolverError, match="draws must be from 1"):
            answer_of("null:random-phase,draws=0", toy_problem())

    def test_oracle_mean_leaves_the_target_out(self, heldout):
        problem = toy_problem()
        answer = answer_of("oracle:mean", problem, heldout)
        expected = (problem.train_image + heldout.images[1] + heldout.images[2]) / 3
        assert answer.paired
        assert answer.draws[0] == pytest.approx(expected)

    def test_best_other_is_never_the_target(self, heldout):
        answer = answer_of("oracle:best-other", toy_problem(), heldout)
        for draw, image in zip(answer.draws, heldout.images, strict=True):
            assert np.square(draw - image).mean() > 0

    def test_repeat_offers_the_repeat(self, heldout):
        answer = answer_of("oracle:repeat", toy_problem(), heldout)
        assert answer.draws == pytest.approx(heldout.images * 0.99)
        bare = replace(heldout, repeats=tuple(image[None][:0] for image in heldout.images))
        with pytest.raises(SolverError, match="repeated capture"):
            answer_of("oracle:repeat", toy_problem(), bare)


# Mean over the five named cloths of the public release and the paper's split; measured apart from this code. The
# tolerance covers another drawing of edges (0.0005 in MSE) and other random draws (as much again).
MEASURED = {
    "null:disc": {"mean": 0.0428},
    "null:copy": {"mean": 0.0529},
    "null:rotation": {"best of all": 0.0362},
    "oracle:mean": {"paired": 0.0284},
    "oracle:best-other": {"paired": 0.0354},
    "null:random-phase,draws=200": {"mean": 0.0587, "best of 10": 0.0465, "best of 100": 0.0395},
    "null:random-phase": {"mean": 0.0587, "best of 10": 0.0465, "best of 100": 0.0395, "best of all": 0.0350},
}
SLOW = ("null:random-phase",)


@pytest.mark.parametrize("text", [pytest.param(text, marks=[pytest.mark.slow] * (text in SLOW)) for text in MEASURED])
def test_reference_rows_on_the_real_cloths(text, real_data):
    dataset, tables = load(real_data), []
    for split in dataset.split("paper"):
        train = np.asarray(dataset.image(split.train[0]))
        tests = np.stack([np.asarray(dataset.image(row)) for row in split.test])
        answer = answer_of(text, replace(toy_problem(), train_image=train), toy_held_out(train, tests))
        tables.append(mse_pairs(answer.draws, tests))
    assert len(tables) == 5
    found = {
        "mean": np.mean([table.mean() for table in tables]),
        "paired": np.mean([table.diagonal().mean() for table in tables]),
        "best of all": np.mean([table.min(0).mean() for table in tables]),
    }
    for count in (10, 100):
        if all(len(table) >= count for table in tables):
            found[f"best of {count}"] = np.mean([expected_best(table, count) for table in tables])
    for how, expected in MEASURED[text].items():
        assert found[how] == pytest.approx(expected, abs=0.001), how
