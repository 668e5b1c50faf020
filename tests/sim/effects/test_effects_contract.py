"""What every registered effect promises, whoever wrote it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.constants import Law
from cusick_bench.sim.effects import Effect, Parameter, apply_all, effect, parse, registered
from cusick_bench.sim.effects.registry import Cause
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.setup import Setup, Side, Simulators, drape_setups

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(150)
SIMULATORS = Simulators(most=64)
HEIGHT = smooth_field(1e-3, 0.03, np.random.default_rng(3))
EFFECTS = list(registered().values())
OF_THE_CLOTH = ("material", "history", "contact")  # classes whose directions turn over with the cloth

each_effect = pytest.mark.parametrize("one", EFFECTS, ids=lambda one: one.name)
each_law = pytest.mark.parametrize("law", ["paper", "plate"])


@pytest.fixture(autouse=True)
def _contact_is_installed(request: pytest.FixtureRequest):
    one = request.node.callspec.params.get("one") if hasattr(request.node, "callspec") else None
    if isinstance(one, Effect) and one.kind == "contact":
        pytest.importorskip("ipctk", reason="self-contact needs ipctk; pip install 'cusick-bench[contact]'")


def _height(points: Tensor) -> Tensor:
    return torch.from_numpy(HEIGHT(points.numpy()))


def _setup(one: Effect | None = None, law: Law = "paper", *, steps: int = 8, side: Side = "up") -> Setup:
    """A later picture of a cloth; contact is a matter of rests, on whatever else the cloth is dropped."""
    resting = one is not None and one.kind == "contact"
    settings = DrapeSettings(mode="equilibrium" if resting else "drop", steps=steps, law=law)
    cloth = uniform_material(density=0.192, bending=4e-5)
    return Setup(MESH, settings, cloth, side=side, capture=2, later=True, laying=_height)


def _draped(*setups: Setup) -> list[Tensor]:
    found = drape_setups(setups, SIMULATORS)
    assert all(positions is not None for positions in found)
    return [positions for positions in found if positions is not None]


def _typical(one: Effect, share: float = 1.0) -> dict[str, float]:
    """Parameters away from their defaults, so that none can be ignored."""
    value = {p.name: share * p.typical if p.role == "severity" else p.default for p in one.parameters}
    return value | {p.name: 37.0 for p in one.parameters if p.role == "direction"}


# --- what is written about it -----------------------------------------------------------------------------------------


@each_effect
def test_it_says_what_it_is(one: Effect):
    assert one.name == one.name.lower().replace("_", "-")
    for text in (one.summary, one.physics, one.reference):
        assert len(text) > 10
    assert sum(p.role == "severity" for p in one.parameters) == 1
    assert len({p.name for p in one.parameters}) == len(one.parameters)
    assert one.signed == (one.severity.low < 0)
    for p in one.parameters:
        assert p.low <= min(p.typical, p.default)
        assert max(p.typical, p.default) <= p.high
        assert p.source.strip()
        assert p.summary.strip()
    assert one.severity.low <= 0 < abs(one.severity.typical)


def test_each_class_has_its_effects():
    names = {kind: [one.name for one in EFFECTS if one.kind == kind] for kind in {one.kind for one in EFFECTS}}
    assert len(EFFECTS) >= 22
    assert set(names["history"]) >= {"creep", "bending-friction", "shear-friction"}
    assert len(names["material"]) >= 8
    assert "self-contact" in names["contact"]


def test_the_json_document_states_the_values_that_are_used_where_none_is_given():
    document = json.loads(CliRunner().invoke(app, ["effects", "--json"]).stdout)
    for stated in document["effects"]:
        defaults = {parameter["name"]: parameter["default"] for parameter in stated["parameters"]}
        assert defaults == effect(stated["name"]).complete({})


# --- what it refuses --------------------------------------------------------------------------------------------------


@each_effect
def test_it_refuses_what_it_does_not_know(one: Effect):
    with pytest.raises(SimulationError, match=f"effect {one.name} has no parameter 'sevrity'; use {one.severity.name}"):
        one.apply(_setup(), {"sevrity": 1.0})


@pytest.mark.parametrize(
    ("one", "p"), [(one, p) for one in EFFECTS for p in one.parameters], ids=lambda item: item.name
)
def test_it_refuses_values_out_of_bounds(one: Effect, p: Parameter):
    for value in (p.high + 1e-6 * max(1.0, abs(p.high)), p.low - 1e-6 * max(1.0, abs(p.low)), math.nan):
        with pytest.raises(SimulationError, match=rf"effect {one.name}: {p.name} must lie within .* to .*, got "):
            one.apply(_setup(), {p.name: value})
    for value in (p.low, p.high):
        one.complete({p.name: value})


def test_an_effect_that_makes_no_setup_is_named(monkeypatch):
    one = EFFECTS[0]
    monkeypatch.setattr(type(one), "_apply", lambda self, setup, value: None)
    with pytest.raises(SimulationError, match=f"effect {one.name}: _apply must return a Setup, got None; return one"):
        one.apply(_setup(), {one.severity.name: one.severity.high})


@each_effect
def test_every_parameter_states_its_unit(one: Effect):
    """Documents say "" only of an effect that is not known."""
    assert {p.unit for p in one.parameters} <= {"m", "1/m", "deg", "1"}


def test_a_pure_number_has_no_unit_in_messages():
    pure = Parameter("share", "1", 0, 0.5, 0.1, "none")
    assert pure.unit_text == ""
    one = next(one for one in EFFECTS if one.severity.unit == "1")
    with pytest.raises(SimulationError, match=f"must lie within .* to {one.severity.high:g}, got"):
        one.complete({one.severity.name: one.severity.high + 1})


# --- what it does -----------------------------------------------------------------------------------------------------


@each_law
@each_effect
def test_severity_zero_is_no_change(one: Effect, law: Law):
    base = _setup(None, law)
    absent = one.apply(base, {one.severity.name: 0.0})
    plain, same = _draped(base, absent)
    assert torch.equal(plain, same)


@each_law
@each_effect
def test_it_acts_and_alike_each_time(one: Effect, law: Law):
    base, changed = _setup(one, law), one.apply(_setup(one, law), _typical(one))
    plain, first = _draped(base, changed)
    again = drape_setups([one.apply(_setup(one, law), _typical(one))])[0]
    assert torch.isfinite(first).all()
    assert again is not None
    assert torch.equal(first, again)
    if one.kind != "contact":  # this stiff cloth does not touch itself
        assert (first - plain).abs().max() > 1e-6


@each_law
@each_effect
def test_a_tiny_severity_is_a_tiny_change(one: Effect, law: Law):
    """A few steps in: later, folds amplify any change. With contact a rest is another one than without, if any thin."""
    base = _setup(one, law, steps=4)
    none = one.apply(base, _typical(one, 1e-6)) if one.kind == "contact" else base
    plain, less, more = _draped(none, *(one.apply(base, _typical(one, share)) for share in (1e-5, 1e-4)))
    small, large = float((less - plain).abs().max()), float((more - plain).abs().max())
    assert large < 2e-4
    assert small < 0.2 * large or large < 1e-8


@each_law
@each_effect
def test_it_works_beside_others(one: Effect, law: Law):
    base = _setup(one, law)
    neighbours = [base, parse("density-bias:bias=0.1").apply(base), parse("stiffness-field").apply(base)]
    mine = one.apply(base, _typical(one))
    together = _draped(neighbours[0], mine, *neighbours[1:])
    for setup, found in zip((neighbours[0], mine, *neighbours[1:]), together, strict=True):
        (alone,) = _draped(setup)
        assert torch.equal(found, alone)


@each_law
@each_effect
def test_it_mixes_with_a_patch_in_any_order(one: Effect, law: Law):
    causes = [Cause(one, _typical(one)), parse("local-stiff-patch:direction=70")]
    forward, backward = _draped(*(apply_all(order, _setup(one, law)) for order in (causes, causes[::-1])))
    torch.testing.assert_close(forward, backward, rtol=0, atol=1e-9)


@each_law
@each_effect
def test_face_down_it_is_the_mirror_image(one: Effect, law: Law):
    """The same experiment in a mirror: directions of the laboratory mirrored, effects of the face with another sign."""
    if one.name == "plate-slip":
        pytest.skip("slides in random directions, which are not mirrored; tests/test_effects_boundary.py has it")
    value = _typical(one)
    mirrored = value | ({one.severity.name: -value[one.severity.name]} if one.face_odd else {})
    if one.kind not in OF_THE_CLOTH:
        mirrored |= {p.name: 180.0 - value[p.name] for p in one.parameters if p.role == "direction"}
    up, down = _draped(one.apply(_setup(one, law), mirrored), one.apply(_setup(one, law, side="down"), value))
    torch.testing.assert_close(down, up * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64), rtol=0, atol=1e-9)


# --- gradients --------------------------------------------------------------------------------------------------------

ADJOINT = [(one, p) for one in EFFECTS if one.gradient == "adjoint" for p in one.parameters]


@each_law
@pytest.mark.parametrize(("one", "p"), ADJOINT, ids=lambda item: item.name)
def test_adjoint_is_the_slope_of_central_differences(one: Effect, p: Parameter, law: Law):
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(MESH.vertices, 3)))
    value, base = _typical(one), _setup(None, law, steps=5)

    def weighted(number: float | Tensor) -> Tensor:
        return (_draped(one.apply(base, value | {p.name: number}))[0] * weights).sum()

    at = torch.tensor(value[p.name], dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(weighted(at), at)
    step = 1e-5 * max(abs(value[p.name]), abs(p.typical))
    difference = float(weighted(value[p.name] + step) - weighted(value[p.name] - step)) / (2 * step)
    assert float(slope) == pytest.approx(difference, rel=1e-4, abs=1e-9)
    assert difference != 0


@each_law
@each_effect
def test_effects_without_adjoint_leave_gradients_of_the_cloth_alone(one: Effect, law: Law):
    """A drape beside such an effect keeps its gradients; with internal variables it has none, and says so by it."""
    cloth = uniform_material(density=0.192, bending=4e-5)
    bending = cloth.bending.clone().requires_grad_()
    base = replace(_setup(one, law, steps=6), material=replace(cloth, bending=bending))
    changed = one.apply(base, _typical(one))
    (found,) = _draped(changed)
    assert found.requires_grad == (not changed.states)
    if found.requires_grad:
        (slope,) = torch.autograd.grad(found[:, 2].sum(), bending)
        assert torch.isfinite(slope).all()
        assert slope.abs().max() > 0


def test_unknown_names_are_met_with_the_nearest():
    with pytest.raises(SimulationError, match="unknown effect 'bending-frction'; did you mean 'bending-friction'"):
        effect("bending-frction")
