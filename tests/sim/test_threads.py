"""One simulator in several threads of a program: the same drapes and gradients as one after the other."""

import os
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import parse
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.setup import Setup, Simulators, drape_setups
from cusick_bench.sim.threads import alone

pytestmark = pytest.mark.threads

STIFFNESSES = tuple(np.geomspace(5e-6, 5e-5, 6).tolist())  # [N m]


@pytest.fixture(autouse=True)
def _threads_take_turns_often():
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(interval)


@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
@pytest.mark.parametrize("law", ["plate", "paper"])
def test_drapes_and_gradients_do_not_depend_on_other_threads(law, mode):
    simulator = DrapeSimulator(cloth_mesh(law, 97), DrapeSettings(law=law, mode=mode, steps=25))

    def drape(bending: float) -> tuple[torch.Tensor, torch.Tensor]:
        cloth = uniform_material(density=0.2, bending=bending)
        density = cloth.density.clone().requires_grad_()
        vertices = simulator.drape(Material(cloth.stretch, cloth.bending, density)).vertices
        vertices.square().sum().backward()
        assert density.grad is not None
        return vertices.detach(), density.grad

    alone_ones = [drape(bending) for bending in STIFFNESSES]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(drape, STIFFNESSES * 2))
    for ours, theirs in zip(together, alone_ones * 2, strict=True):
        assert torch.equal(ours[0], theirs[0])
        assert torch.equal(ours[1], theirs[1])


def test_drops_with_internal_variables_do_not_depend_on_other_threads():
    mesh, settings, simulators = cloth_mesh("plate", 97), DrapeSettings(law="plate", steps=25), Simulators()
    friction = parse("bending-friction")

    def drape(bending: float) -> torch.Tensor:
        setup = friction.apply(Setup(mesh, settings, uniform_material(density=0.2, bending=bending)))
        (positions,) = drape_setups([setup], simulators)
        assert positions is not None
        return positions

    alone_ones = [drape(bending) for bending in STIFFNESSES]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(drape, STIFFNESSES * 2))
    assert all(torch.equal(ours, theirs) for ours, theirs in zip(together, alone_ones * 2, strict=True))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_fork_while_another_thread_simulates_waits_for_nobody():
    begun, over = threading.Event(), threading.Event()

    def hold() -> None:
        with alone():
            begun.set()
            over.wait(30)

    holder = threading.Thread(target=hold)
    holder.start()
    begun.wait(30)
    child = os.fork()
    if child == 0:
        signal.alarm(20)  # ends a child that waits for ever
        with alone():
            os._exit(7)
    over.set()
    holder.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
