"""The Gaussian process behind the Bayesian solvers, on BoTorch: fit, expected improvement, Thompson sampling.

Inputs lie in the unit cube, outcomes are negated losses of zero mean and unit variance. Two covariances:

    "scaled"   squared exponential, one length scale per coordinate with a lognormal prior whose mode grows as
               sqrt(d), so that the process stays as smooth in 100 coordinates as it is in 2 (BoTorch's default);
    "local"    Matern 5/2 with an amplitude, length scales in [0.005, 2], for models within a trust region.

From `SHARED_FROM` coordinates on there is one length scale for all. Then distances are all that the process sees, so
its hyperparameters are fitted in the span of the n points, which has n coordinates however many the points have.

A fit goes on from the hyperparameters of the last one, and every `AFRESH_EVERY` points it starts afresh. Processor time
on one core, with 500 points in 39 coordinates: a fit 0.2 s, or 2.5 s afresh; maximising the improvement 1.3 s; a
Thompson sample of 2000 candidates 0.5 s. With 8 points in 240,000 coordinates each takes 3 to 4 s, and 2 GB.

BoTorch is imported when the first point is modelled. Torch's global generator and thread count are left as they were:
one thread, so that sums do not depend on how busy the machine is, and a resumed run asks for the same points.

References:
    Balandat et al., BoTorch: A Framework for Efficient Monte-Carlo Bayesian Optimization, NeurIPS 2020. Ament et al.,
    Unexpected Improvements to Expected Improvement for Bayesian Optimization, NeurIPS 2023. Hvarfner, Hellsten, Nardi,
    Vanilla Bayesian Optimization Performs Great in High Dimensions, ICML 2024. Eriksson et al., Scalable Global
    Optimization via Local Bayesian Optimization, NeurIPS 2019.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import Bounds, minimize
from torch import Tensor

from cusick_bench.files.silence import without_warnings
from cusick_bench.solvers.black_box.box import digestible

Covariance = Literal["scaled", "local"]
Hyperparameters = dict[str, Tensor]

SHARED_FROM = 1000
AFRESH_EVERY = 8  # points
FIT_ITERATIONS = 100
FIT_TOLERANCE = 1e-8  # relative; at 1e-6 length scales of irrelevant coordinates end at a tenth of their final values
MAXIMISE_ITERATIONS = 50
RESTARTS = 4
MOST_NUMBERS = 2e7  # coordinates of all points that are evaluated together: 160 MB


@dataclass(frozen=True)
class Surrogate:
    """A fitted process.

    Attributes:
        model: BoTorch's SingleTaskGP in the unit cube.
        outcomes: Negated, standardised losses that it was fitted to.
    """

    model: Any
    outcomes: Float[Tensor, "points 1"]

    @property
    def hyperparameters(self) -> Hyperparameters:
        """Hyperparameters from which the next fit starts."""
        return {name: value.detach().clone() for name, value in self.model.state_dict().items()}

    @property
    def lengthscale(self) -> Float[np.ndarray, " scales"]:
        """Length scales: one per coordinate, or the one that all share."""
        kernel = getattr(self.model.covar_module, "base_kernel", self.model.covar_module)
        return kernel.lengthscale.detach().reshape(-1).numpy()


@contextmanager
def local_torch(seed: int) -> Iterator[None]:
    """Torch with its own seed, on one thread, exact linear algebra, and without BoTorch's warnings; all put back.

    Threads wait for each other.

    Args:
        seed: Seed of torch's generator within.

    Yields:
        Nothing; the settings hold within the `with` block.
    """
    from gpytorch.settings import fast_computations, max_cholesky_size

    with (
        without_warnings(),  # one thread at a time, for all of this is the process's
        torch.random.fork_rng(devices=[]),
        max_cholesky_size(10**6),
        fast_computations(False, False, False),
    ):
        threads = torch.get_num_threads()
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def same_distances(inputs: Float[Tensor, "points dimension"]) -> Float[Tensor, "points points"]:
    """Points with the same mutual distances in as many coordinates as there are points.

    A process whose coordinates share their length scale depends on distances only, so it can be fitted to these points.

    Args:
        inputs: Points in many coordinates.

    Returns:
        Points in fewer.
    """
    products = inputs @ inputs.T
    products = products - products.mean(0) - products.mean(1, keepdim=True) + products.mean()  # about the mean point
    values, vectors = torch.linalg.eigh(products)
    return vectors * values.clamp_min(0).sqrt()


def fit(
    points: Float[np.ndarray, "points dimension"],
    losses: Sequence[float],
    *,
    covariance: Covariance = "scaled",
    last: Hyperparameters | None = None,
) -> Surrogate:
    """Fits the process by maximum a posteriori; to be called within `local_torch`.

    Args:
        points: Points in the unit cube.
        losses: inf where a point failed.
        covariance: "scaled" or "local" (see the module).
        last: Hyperparameters of the previous fit.

    Returns:
        The fitted process.
    """
    inputs = torch.as_tensor(points, dtype=torch.float64)
    outcomes = _standardised(losses)
    dimension = inputs.shape[1]
    shared = dimension >= SHARED_FROM
    fitted = _model(same_distances(inputs) if shared else inputs, outcomes, covariance, dimension)
    if last is not None and len(inputs) % AFRESH_EVERY:
        fitted.load_state_dict(last)
    _maximise_posterior(fitted)
    if not shared:
        return Surrogate(fitted, outcomes)
    model = _model(inputs, outcomes, covariance, dimension)
    model.load_state_dict(fitted.state_dict())
    return Surrogate(model.eval(), outcomes)


def most_promising(surrogate: Surrogate) -> Float[np.ndarray, " dimension"]:
    """The point of the unit cube with the largest log expected improvement; within `local_torch`.

    Args:
        surrogate: The fitted process.

    Returns:
        The point, in the unit cube.
    """
    from botorch.acquisition import LogExpectedImprovement
    from botorch.optim import optimize_acqf

    inputs = surrogate.model.train_inputs[0]
    dimension = inputs.shape[-1]
    improvement = LogExpectedImprovement(surrogate.model, best_f=surrogate.outcomes.max())
    if dimension >= SHARED_FROM:
        return _ascend(improvement, inputs[int(surrogate.outcomes.argmax())])
    point, _ = optimize_acqf(
        improvement,
        bounds=torch.stack([torch.zeros(dimension), torch.ones(dimension)]).double(),
        q=1,
        num_restarts=RESTARTS,
        raw_samples=256,
        options={"maxiter": MAXIMISE_ITERATIONS, "sample_around_best": True},
        retry_on_optimization_warning=False,
    )
    return point[0].detach().numpy()


def _ascend(improvement: Any, best: Float[Tensor, " dimension"]) -> Float[np.ndarray, " dimension"]:
    """L-BFGS from the most promising of some points anywhere and some near the best one.

    `optimize_acqf` takes the columns of its points apart: the time of its steps grows with the square of their number.
    """
    count = int(min(64, max(MOST_NUMBERS / 8 / len(best), RESTARTS)))
    near = best + 0.1 * torch.randn(count, len(best), dtype=best.dtype)
    starts = torch.cat([torch.rand(count, len(best), dtype=best.dtype), near.clamp(0, 1)])
    with torch.no_grad():
        start = starts[int(improvement(starts[:, None]).argmax())]

    def negative(point: np.ndarray) -> tuple[float, np.ndarray]:
        place = torch.as_tensor(point).requires_grad_()
        value = -improvement(place[None]).sum()
        return value.item(), torch.autograd.grad(value, place)[0].numpy()

    options = {"maxiter": MAXIMISE_ITERATIONS}
    return minimize(negative, start.numpy(), jac=True, method="L-BFGS-B", bounds=Bounds(0, 1), options=options).x


def thompson(
    surrogate: Surrogate, candidates: Float[np.ndarray, "candidates dimension"]
) -> Float[np.ndarray, " dimension"]:
    """The best of some candidates under one draw of the process; within `local_torch`.

    Args:
        surrogate: The fitted process.
        candidates: Points of the unit cube to choose from.

    Returns:
        One of the candidates.
    """
    with torch.no_grad():
        posterior = surrogate.model.posterior(torch.as_tensor(candidates))
        draw = posterior.rsample(torch.Size([1])).reshape(-1)
    return candidates[int(draw.argmax())]


def _standardised(losses: Sequence[float]) -> Float[Tensor, "points 1"]:
    values = -torch.as_tensor(digestible(losses))[:, None]
    spread = values.std() if len(values) > 1 else torch.tensor(0.0)
    return (values - values.mean()) / (spread if spread > 0 else 1.0)


def _model(inputs: Tensor, outcomes: Tensor, covariance: Covariance, dimension: int) -> Any:
    from botorch.models import SingleTaskGP

    kernel, likelihood = _scaled(dimension) if covariance == "scaled" else _local(dimension)
    return SingleTaskGP(
        inputs, outcomes, covar_module=kernel, likelihood=likelihood, outcome_transform=None
    ).double()  # fmt: skip


def _scaled(dimension: int) -> tuple[Any, None]:
    """BoTorch's default, with the option of a shared length scale."""
    from botorch.models.utils.gpytorch_modules import get_covar_module_with_dim_scaled_prior
    from gpytorch.constraints import GreaterThan
    from gpytorch.kernels import RBFKernel
    from gpytorch.priors import LogNormalPrior

    if dimension < SHARED_FROM:
        return get_covar_module_with_dim_scaled_prior(dimension), None
    prior = LogNormalPrior(math.sqrt(2) + math.log(dimension) / 2, math.sqrt(3))
    positive = GreaterThan(0.025, transform=None, initial_value=prior.mode)  # pyright: ignore[reportArgumentType]
    return RBFKernel(lengthscale_prior=prior, lengthscale_constraint=positive), None


def _local(dimension: int) -> tuple[Any, Any]:
    """The covariance and the bounds of Eriksson et al. 2019."""
    from gpytorch.constraints import Interval
    from gpytorch.kernels import MaternKernel, ScaleKernel
    from gpytorch.likelihoods import GaussianLikelihood

    shared = dimension >= SHARED_FROM
    longest = 2 * math.sqrt(dimension) if shared else 2.0
    matern = MaternKernel(
        nu=2.5,
        ard_num_dims=None if shared else dimension,
        lengthscale_constraint=Interval(0.005, longest, initial_value=longest / 4),
    )
    kernel = ScaleKernel(matern, outputscale_constraint=Interval(0.05, 20.0, initial_value=1.0))
    return kernel, GaussianLikelihood(noise_constraint=Interval(5e-4, 0.1, initial_value=5e-3))


def _maximise_posterior(model: Any) -> None:
    """L-BFGS on the hyperparameters; where it breaks down, those it started from are kept."""
    from botorch.exceptions import BotorchError
    from botorch.optim.fit import fit_gpytorch_mll_scipy
    from gpytorch.mlls import ExactMarginalLogLikelihood
    from linear_operator.utils.errors import NotPSDError

    start = {name: value.clone() for name, value in model.state_dict().items()}
    likelihood = ExactMarginalLogLikelihood(model.likelihood, model)
    likelihood.train()
    try:
        fit_gpytorch_mll_scipy(likelihood, options={"maxiter": FIT_ITERATIONS, "ftol": FIT_TOLERANCE})
    except (BotorchError, NotPSDError, RuntimeError):
        model.load_state_dict(start)
    likelihood.eval()
