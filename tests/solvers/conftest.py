"""What several tests of solvers use."""

import numpy as np
import pytest
from toy_problem import toy_held_out, toy_image, toy_problem

from cusick_bench.solvers.base import HeldOut


@pytest.fixture(scope="module")
def heldout() -> HeldOut:
    images = np.stack([toy_image(sample) for sample in (1, 2, 3)])
    return toy_held_out(toy_problem().train_image, images, [image[None] * 0.99 for image in images])
