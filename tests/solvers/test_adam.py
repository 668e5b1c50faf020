"""Adam: its first steps by hand, its rate, its memory, and what descent within a box does with it."""

import numpy as np
import pytest
from toy_problem import toy_problem

from cusick_bench.problem import Budget
from cusick_bench.solvers.adam import EPSILON, Adam, cosine_rate
from cusick_bench.solvers.descent import adam
from cusick_bench.solvers.incumbent import Incumbent

pytestmark = pytest.mark.usefixtures("one_thread")


def _gradients(count, size=5):
    return np.random.default_rng(0).normal(size=(count, size))


def test_steps_are_those_of_algorithm_1():
    """Kingma and Ba, Algorithm 1, written out."""
    array, expected, mean, square = np.ones(5), np.ones(5), np.zeros(5), np.zeros(5)
    optimiser = Adam({"x": array}, square_decay=0.99)
    for age, gradient in enumerate(_gradients(20), start=1):
        optimiser.step({"x": gradient}, 0.1 / age)
        mean, square = 0.9 * mean + 0.1 * gradient, 0.99 * square + 0.01 * gradient**2
        direction = (mean / (1 - 0.9**age)) / (np.sqrt(square / (1 - 0.99**age)) + EPSILON)
        expected = expected - 0.1 / age * direction
        assert array == pytest.approx(expected, rel=1e-12)
    assert optimiser.steps == 20


def test_rate_falls_to_a_tenth():
    rates = [cosine_rate(2.0, step, 10) for step in range(15)]
    assert rates[0] == 2.0
    assert rates[5] == pytest.approx(1.1)
    assert rates[10:] == pytest.approx([0.2] * 5)
    assert (np.diff(rates[:11]) < 0).all()


@pytest.mark.parametrize("stopped", [0, 7])
def test_goes_on_from_its_memory(stopped):
    whole, part = np.ones(5), np.ones(5)
    first, second = (Adam({"x": array}, square_decay=0.95) for array in (whole, part))
    for number, gradient in enumerate(_gradients(12)):
        if number == stopped:
            part = part.copy()
            second = Adam({"x": part}, square_decay=0.95, memory=second.memory())
        first.step({"x": gradient}, 0.1)
        second.step({"x": gradient}, 0.1)
    assert (whole == part).all()
    assert second.steps == 12


class TestWithinABox:
    def test_a_failed_drape_sends_it_back_at_half_the_rate(self, fail_drapes):
        problem = toy_problem(budget=Budget())
        asked = []
        fail_drapes(lambda count: count == 3)
        incumbent = Incumbent(problem)
        value_and_gradient = incumbent.value_and_gradient
        incumbent.value_and_gradient = lambda tau: (asked.append(tau.copy()), value_and_gradient(tau))[1]
        adam(incumbent, steps=5, rate=0.2)
        best = asked[int(np.argmin([entry.loss for entry in problem.meter.trace][:2]))]
        assert (asked[3] == best).all()
        lengths = [np.abs(np.diff(pair, axis=0)).max() for pair in (asked[0:2], asked[3:5])]
        # the first step of Adam is as long as its rate in every coordinate
        assert lengths[0] == pytest.approx(cosine_rate(0.2, 0, 5))
        assert lengths[1] == pytest.approx(cosine_rate(0.1, 3, 5))

    def test_stays_in_the_box(self):
        problem = toy_problem(budget=Budget())
        lower, upper = problem.bounds
        incumbent = Incumbent(problem)
        incumbent.tau = upper - 1e-3
        adam(incumbent, steps=3, rate=1.0)
        assert (incumbent.tau <= upper).all()
        assert (incumbent.tau >= lower).all()
        assert problem.meter.gradient == 3
