"""What fabrics of a laboratory share that were draped by a simulator which shares no bending code with the atlas."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.laboratory.laboratory import laboratory_of
from cusick_bench.diagnosis.inference.laboratory.shared_effects import Laboratory
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.withheld.suite.design import Plan
from cusick_bench.withheld.suite.generate import Suite, write_case

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_thread")]

_FABRICS = 4


def laboratory_with(causes: Mapping[str, Mapping[str, float]], first: int, folder: Path) -> Laboratory:
    """What is found of four fabrics of world `paper` under the same effects, from a number on."""
    counts = {"null": 0, "single": _FABRICS, "pair": 0, "unknown": 0}
    suite = Suite(seed=20261128, counts=counts, vertices=450, world="paper")
    captures = []
    for number in range(first, first + _FABRICS):
        plan = Plan(f"case_{number:04d}", number, "single", causes, 2.0, "typical")
        dataset = load(folder / write_case(suite, plan, folder))
        captures.append(read_captures(dataset, dataset.cloths[0]))
    found = laboratory_of(captures, *load_atlas(SHIPPED), np.random.default_rng(0))
    assert found is not None
    return found


def test_what_acts_is_among_the_look_alikes(tmp_path: Path) -> None:
    found = laboratory_with({"plate-tilt": {"angle": 3.0, "direction": 60.0}}, 1, tmp_path)
    ((first, group),) = found.acting.items()
    assert "plate-tilt" in (first, *group)
    assert sum(group.values()) > 0.9


def test_nothing_is_named_beside_what_acts(tmp_path: Path) -> None:
    """A leaning plate and a leaning camera were, with probabilities of 76 and 62 %."""
    found = laboratory_with({"off-centre": {"shift": 0.005, "direction": 300.0}}, 13, tmp_path)
    (named,) = found.named
    assert named.hypothesis.name == "off-centre"
    assert named.value["shift"] == pytest.approx(5e-3, rel=0.2)
    assert named.value["direction"] == pytest.approx(300, abs=10)
    assert found.acting["off-centre"]["off-centre"] > 0.9


def test_fabrics_without_effects_share_none(tmp_path: Path) -> None:
    assert laboratory_with({}, 21, tmp_path).named == ()
