"""Which controls a fabric allows, and what is right for each."""

from dataclasses import replace

import pytest
from made_up_controls import CLOTH

from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.controls.known_answers import (
    SHIFT_DIRECTION,
    Amount,
    Control,
    FabricUnderControl,
    alike,
    controls_of,
    turning_over,
)
from cusick_bench.diagnosis.controls.run import controlled, fabric_under_control, fabrics_to_control
from cusick_bench.diagnosis.measure.captures import read_captures


class TestCatalogue:
    def test_every_control_has_its_right_answer(self, under_control):
        controls, references = controls_of(under_control)
        levels = {(one.name, one.strength): one for one in controls}
        for name in ("shift", "scale", "turn", "blur-cut", "pinhole", "mirror", "shuffle"):
            small, large = levels[name, "smaller"], levels[name, "larger"]
            assert small.reference in references
            if small.amount and large.amount:
                assert large.amount.severity == pytest.approx(2 * small.amount.severity)
                assert large.amount.effect in large.effects
        assert levels["shift", "larger"].effects == {"camera-offset"}
        assert levels["scale", "larger"].effects == {"camera-scale", "cut-size", "plate-radius", "threshold"}
        assert levels["shift", "larger"].amount == Amount("camera-offset", 3 / 723, SHIFT_DIRECTION)
        assert sum(one.kind == "null" for one in controls) == 2
        assert not [one for one in controls if one.name in ("slip", "observations")]

    def test_amounts_are_in_the_lengths_of_the_atlas_cloth(self, under_control):
        """The same pictures of a cloth of 120 mm; the eye is as high, and so farther off in units of the cloth."""
        protocol = replace(RELEASE, cloth_radius_m=0.12, plate_radius_m=0.072, px_per_m=RELEASE.px_per_m / 0.8)
        small = replace(under_control, data=replace(under_control.data, protocol=protocol))
        names = ["shift", "blur-cut", "pinhole", "scale", "turn"]
        nominal, ours = (controls_of(one, names)[0] for one in (under_control, small))
        for first, second in zip(nominal, ours, strict=True):
            assert first.amount
            assert second.amount
            factor = 0.8 if first.name == "pinhole" else 1.0
            assert second.amount.severity == pytest.approx(factor * first.amount.severity)

    def test_only_those_that_are_asked_for(self, under_control):
        controls, references = controls_of(under_control, ["halves"])
        assert {one.name for one in controls} == {"halves"}
        assert sorted(references) == ["face down alone", "face up alone"]

    def test_a_fabric_of_one_face_without_meshes_and_repeats(self, fabric):
        one = fabric.select(capture=1)
        bare = replace(one, table=one.table.assign(mesh=""))
        controls, _ = controls_of(FabricUnderControl(bare, read_captures(bare, CLOTH)))
        assert {control.name for control in controls} == {"shift", "scale", "turn", "blur-cut", "halves"}

    def test_effects_that_turn_over(self):
        assert turning_over() == {"face-asymmetry", "rest-curvature"}
        assert alike("grain-skew") == {"grain-skew"}

    def test_named_sets_of_other_fabrics_pictures_are_left_out(self, fabric):
        data = load("synthetic")
        copies = fabric.table.assign(cloth="named", same_as=fabric.table["image"])
        few = fabric.table.assign(cloth="few").query("sample < 6")
        import pandas as pd

        more = replace(data, table=pd.concat([data.table, copies, few], ignore_index=True))
        assert fabrics_to_control(more) == data.cloths


class TestRealData:
    def test_known_answers_of_the_release(self, release):
        def known(fabric: str) -> dict[str, Control]:
            names = ["faces", "drift", "observations", "slip"]
            made, _ = controls_of(fabric_under_control(release, fabric), names)
            return {f"{one.name} {one.strength}".strip(): one for one in made}

        two, five, series = known("fabric_2"), known("fabric_5"), known("fabric_1_observations")
        assert two["faces"].level == "down minus up +12.0 points"
        assert (two["faces"].kind, five["faces"].kind) == ("real", "absent")
        assert two["drift"].level.startswith("last minus first +")  # it rises
        assert series["drift"].level.startswith("last minus first -6.")
        assert (series["observations smaller"].level, series["observations larger"].level) == (
            "1 against 2",
            "1 against 5",
        )
        assert series["slip"].note == ("left out", "Sample_4_Observation_5.jpg", "shrunken-image")

    def test_fabrics_under_control(self, release):
        ten = [f"fabric_{number}" for number in (1, 2, 3, 4, 5, 9)]
        assert set(fabrics_to_control(release)) >= {*ten, "fabric_1_observations"}
        assert not {"cotton_blue", "viscose_white", "fabric_12"} & set(fabrics_to_control(release))

    @pytest.mark.slow
    def test_a_shift_of_a_real_fabric_is_measured(self, release):
        """Whatever else it shows: its offset is estimated as larger by what was planted."""
        under = fabric_under_control(release, "fabric_4")
        small, large = controlled(under, *load_atlas(), names=["shift"])
        assert large.largest_shift == pytest.approx(2 * small.largest_shift, rel=0.05)
        assert large.largest_shift > 5
        assert large.estimate_right == "yes"
