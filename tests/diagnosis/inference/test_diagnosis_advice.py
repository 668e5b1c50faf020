"""Which measurement would tell the effects in doubt apart."""

import re

import pytest

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE
from cusick_bench.diagnosis.inference.single_effects.next_measurement import TURN_OVER, advise


def test_advice_is_the_entropy_of_its_partition() -> None:
    found = advise({"density-bias": 0.5, NONE: 0.5})
    assert found[0].bits == pytest.approx(1.0)
    assert any(one.measurement.name == "weigh" for one in found)
    assert advise({"creep": 1.0}) == []
    shared = {"plate-tilt": {"plate-tilt": 0.75, "off-centre": 0.25}}
    in_doubt = advise({"plate-tilt": 1.0, NONE: 0.0}, shared=shared)
    assert {one.measurement.name for one in in_doubt} == {"measure the plate", "side view"}
    assert [one.bits for one in in_doubt] == pytest.approx([0.811] * 2, abs=1e-3)
    assert advise({"plate-tilt": 1.0}, shared={"plate-tilt": {"plate-tilt": 1.0}}) == []


def test_what_has_been_measured_already_is_not_advised() -> None:
    either = {"rest-curvature": 0.5, NONE: 0.5}
    assert TURN_OVER in [one.measurement.name for one in advise(either, most=9)]
    assert TURN_OVER not in [one.measurement.name for one in advise(either, made=(TURN_OVER,), most=9)]


def test_a_diagnosis_takes_the_smaller_sample_that_it_advises() -> None:
    found = {one.measurement.name: one.measurement for one in advise({"rim-stiffening": 0.5, NONE: 0.5}, most=9)}
    sizes = [float(size) for size in re.findall(r"([\d.]+) cm", found["smaller sample"].what)]
    for cloth, plate in (sizes[:2], sizes[2:]):
        assert Protocol(cloth_radius_m=cloth / 200, plate_radius_m=plate / 200).has_standard_ratio
    assert sizes[0] < sizes[2]
