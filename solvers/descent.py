"""Descent by gradients within a problem's box: Adam across rough ground, L-BFGS to the bottom, in turn.

A few steps of Adam cross the rough ground of folds that slip in and out of phase, and L-BFGS goes down to the bottom of
the valley it is in. Where a round gains nothing, Adam's next steps are half as long; the descent ends when they have
become short. Few steps: Adam seldom gains after ten, and L-BFGS finishes faster.

References:
    Kingma, Ba, Adam: A Method for Stochastic Optimization, ICLR 2015.
    Liu, Nocedal, On the Limited Memory BFGS Method for Large Scale Optimization, Math. Programming 45, 1989.
"""

import numpy as np
from scipy.optimize import minimize

from cusick_bench.solvers.adam import Adam, cosine_rate
from cusick_bench.solvers.incumbent import PENALTY, Incumbent

SQUARE_DECAY = 0.99  # of Adam, instead of the usual 0.999: a round has only some ten steps


def adam(incumbent: Incumbent, *, steps: int, rate: float) -> None:
    """Adam within the problem's box, from the incumbent; after a failed drape it returns there at half the rate.

    Args:
        incumbent: Search to go on with.
        steps: Gradients to spend.
        rate: Step length [prior standard deviations], falling to a tenth along a cosine.
    """
    tau, (lower, upper) = incumbent.tau.copy(), incumbent.problem.bounds
    optimiser = Adam({"tau": tau}, square_decay=SQUARE_DECAY)
    for index in range(steps):
        loss, gradient = incumbent.value_and_gradient(tau)
        if loss >= PENALTY:
            tau[:], rate = incumbent.tau, rate / 2
            optimiser = Adam({"tau": tau}, square_decay=SQUARE_DECAY)
            continue
        optimiser.step({"tau": gradient}, cosine_rate(rate, index, steps))
        np.clip(tau, lower, upper, out=tau)


def lbfgs(incumbent: Incumbent, *, iterations: int) -> bool:
    """L-BFGS within the problem's box from the incumbent.

    Args:
        incumbent: Search to go on with.
        iterations: Most iterations.

    Returns:
        Whether it converged.
    """
    lower, upper = incumbent.problem.bounds
    result = minimize(
        incumbent.value_and_gradient,
        np.clip(incumbent.tau, lower, upper),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(lower, upper, strict=True)),
        options={"maxiter": iterations, "maxls": 10, "ftol": 1e-7, "gtol": 1e-8},
    )
    return bool(result.success)


SHORTEST = 1 / 30  # of the first step length: where Adam's rounds end
GAIN = 0.02  # relative decrease of the loss below which a round gained nothing


def rounds(incumbent: Incumbent, *, steps: int, rate: float, iterations: int) -> None:
    """Adam and L-BFGS in turn, until neither gets lower.

    Args:
        incumbent: Search to go on with.
        steps: Gradients for Adam in a round.
        rate: Its first step length [prior standard deviations].
        iterations: Most iterations of L-BFGS in a round.
    """
    length = rate
    while length > SHORTEST * rate and incumbent.loss > 0:
        before = incumbent.loss
        adam(incumbent, steps=steps, rate=length)
        lbfgs(incumbent, iterations=iterations)
        if not incumbent.loss < (1 - GAIN) * before:  # nor where every drape failed
            length /= 2
