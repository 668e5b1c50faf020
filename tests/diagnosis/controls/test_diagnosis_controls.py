"""Controls of the diagnosis: what planting does to pictures, what is judged right, and one fabric from end to end."""

import csv
import json
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from other_laboratory import write_laboratory, write_protocol
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.controls import run
from cusick_bench.diagnosis.controls.figures import figures
from cusick_bench.diagnosis.controls.judgement import Judgement, judge, largest_shift
from cusick_bench.diagnosis.controls.known_answers import (
    CONTROLS,
    SHIFT_DIRECTION,
    Amount,
    Control,
    FabricUnderControl,
    alike,
    controls_of,
    turning_over,
)
from cusick_bench.diagnosis.controls.pictures import (
    GrainTurn,
    Magnification,
    MirroredFace,
    OtherCut,
    PictureChange,
    Shift,
    View,
)
from cusick_bench.diagnosis.controls.planted_data import (
    captures_shuffled,
    halves_as_faces,
    planted,
    rendered,
    two_observations,
)
from cusick_bench.diagnosis.controls.reading import REFUSED, Estimate, Reading, refused
from cusick_bench.diagnosis.controls.run import controlled, fabric_under_control, fabrics_to_control
from cusick_bench.diagnosis.controls.table import (
    control_lines,
    document,
    markdown,
    read_judgements,
    rows,
    share_lines,
)
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.files.csv_text import csv_text

CLOTH = "fabric_2"


@pytest.fixture(scope="module")
def fabric() -> DrapeDataset:
    return load("synthetic").select(cloth=CLOTH)


@pytest.fixture(scope="module")
def release(real_data) -> DrapeDataset:
    return replace(load(real_data), name="cusick")


@pytest.fixture(scope="module")
def under_control(fabric) -> FabricUnderControl:
    return FabricUnderControl(fabric, read_captures(fabric, CLOTH), halves=1)


def radii(data: DrapeDataset, row: int) -> np.ndarray:
    return profile_of(data.image(row).numpy(), data.protocol).radii


def harmonic(profile: np.ndarray, order: int) -> complex:
    """c_m of r = Re sum c_m exp(-i m theta)."""
    return complex(2 * np.conj(np.fft.rfft(profile)[order]) / len(profile))


def row_of(data: DrapeDataset, side: str) -> int:
    return int(np.flatnonzero(data.table["side"] == side)[0])


def seen(data: DrapeDataset, change: PictureChange, row: int) -> np.ndarray:
    return radii(planted(data, change), row)


class TestPictures:
    def test_a_shift_moves_the_middle_of_the_cloth(self, fabric):
        size = np.arange(fabric.protocol.image_size_px)
        moved = planted(fabric, Shift(3.0, SHIFT_DIRECTION))
        for row in (0, 3):
            middles = []
            for data in (fabric, moved):
                image = data.image(row).numpy()
                middles.append(np.array([image.sum(0) @ size, -image.sum(1) @ size]) / image.sum())
            angle = np.deg2rad(SHIFT_DIRECTION)
            assert middles[1] - middles[0] == pytest.approx([3 * np.cos(angle), 3 * np.sin(angle)], abs=0.02)

    @pytest.mark.parametrize("error", [0.03, -0.02])
    def test_a_scale_multiplies_the_radii(self, fabric, error):
        ratio = seen(fabric, Magnification(error), 0) / radii(fabric, 0)
        assert ratio == pytest.approx(1 + error, abs=0.004)
        assert ratio.mean() == pytest.approx(1 + error, abs=3e-4)

    @pytest.mark.parametrize(("side", "sign"), [("up", 1), ("down", -1)])
    def test_a_turn_goes_with_the_cloth(self, fabric, side, sign):
        """Counter-clockwise face up, clockwise face down: the phases of all harmonics turn, their sizes stay."""
        row = row_of(fabric, side)
        before, after = radii(fabric, row), seen(fabric, GrainTurn(5.0), row)
        for order in range(4, 10):
            turned = harmonic(before, order) * np.exp(1j * order * sign * np.deg2rad(5.0))
            assert harmonic(after, order) == pytest.approx(turned, abs=3e-5)

    def test_a_turn_is_the_same_on_both_faces_in_the_cloths_frame(self, fabric):
        plain, turned = read_captures(fabric, CLOTH), read_captures(planted(fabric, GrainTurn(5.0)), CLOTH)
        expected = np.roll(plain.cloth_frame(), 5, axis=1)
        assert np.abs(turned.cloth_frame() - expected).mean() < 1e-4  # a fourteenth of a pixel

    @pytest.mark.parametrize("outwards", [1.0, 2.0, -1.0])
    def test_another_cut_moves_the_edge_of_a_disc(self, fabric, outwards):
        protocol, radius = fabric.protocol, 90.0
        at = np.hypot(*np.meshgrid(*[np.arange(protocol.image_size_px) - protocol.centre_px[0]] * 2))
        disc = np.clip(0.5 + radius - at, 0, 1)
        cut = profile_of(OtherCut(outwards)(disc, View(1, "up", protocol)), protocol).radii * protocol.px_per_m
        assert cut == pytest.approx(radius + outwards, abs=0.15)  # rays cross an edge of pixels
        assert cut.mean() == pytest.approx(radius + outwards - 2**2 / (2 * radius), abs=0.03)  # blur moves a bent edge

    def test_mirroring_one_face_leaves_the_other(self, fabric):
        up, down = row_of(fabric, "up"), row_of(fabric, "down")
        mirrored = planted(fabric, MirroredFace())
        assert (mirrored.image(up) == fabric.image(up)).all()
        assert mirrored.image(down).numpy() == pytest.approx(fabric.image(down).numpy()[:, ::-1], abs=1e-6)
        twice = planted(mirrored, MirroredFace()).image(down)  # a planted set keeps its own change only
        assert twice.numpy() == pytest.approx(mirrored.image(down).numpy())

    @pytest.mark.parametrize(("step", "offset"), [(1, 0), (2, -1), (2, 0)])
    def test_half_of_the_samples_are_mirrored_however_they_are_numbered(self, under_control, step, offset):
        """Of samples 1, 3, 5, ... no number is even, of 2, 4, 6, ... every one."""
        table = under_control.data.table.assign(sample=step * under_control.data.table["sample"] + offset)
        data = replace(under_control.data, table=table)
        controls, _ = controls_of(replace(under_control, data=data), ["mirror"])
        half = next(one for one in controls if one.level == "every second sample")
        changed = {
            int(table["sample"].iloc[row])
            for row in np.flatnonzero(table["side"] == "down")
            if not (half.data.image(row) == data.image(row)).all()
        }
        numbers = sorted(set(table["sample"]))
        assert changed == set(numbers[1::2])

    def test_every_second_sample_is_mirrored(self, fabric):
        halved = planted(fabric, MirroredFace(2))
        changed = {
            int(halved.table["sample"].iloc[row])
            for row in np.flatnonzero(fabric.table["side"] == "down").tolist()
            if not np.allclose(halved.image(row), fabric.image(row))
        }
        assert changed == {2, 4, 6, 8, 10, 12}

    def test_a_picture_whose_y_points_down_is_turned_the_same_way_about_the_cloth(self, fabric):
        flipped = replace(fabric.protocol, image_y="down", centre_px=(127.5, 127.5))
        image = fabric.image(0).numpy()
        for change in (GrainTurn(5.0), Shift(3.0, 70.0)):
            up = change(image, View(1, "up", fabric.protocol))
            down = change(image[::-1], View(1, "up", flipped))
            assert down[::-1] == pytest.approx(up, abs=1e-6)


class TestLabels:
    def test_shuffling_keeps_every_picture_with_its_sample(self, fabric):
        for across in (False, True):
            dealt = captures_shuffled(fabric, np.random.default_rng(0), across_faces=across)
            labels = ["sample", "side", "capture"]
            before, after = (data.table[labels].apply(tuple, axis=1).tolist() for data in (fabric, dealt))
            assert sorted(before) == sorted(after)
            assert before != after
            assert (dealt.table["image"] == fabric.table["image"]).all()
            assert (dealt.table["sample"] == fabric.table["sample"]).all()
            assert bool((dealt.table["side"] == fabric.table["side"]).all()) is not across
        assert np.sort(radii(dealt, 0)) == pytest.approx(np.sort(radii(fabric, 0)))

    def test_halves_are_samples_of_one_face(self, fabric):
        dealt = halves_as_faces(fabric, "down", np.random.default_rng(1)).table
        originals = fabric.table[fabric.table["side"] == "down"]
        assert sorted(dealt["image"]) == sorted(originals["image"])
        faces = dealt.groupby("sample")["side"].nunique()
        assert set(faces) == {1}
        assert dealt.groupby("side")["sample"].nunique().to_dict() == {"up": 6, "down": 6}

    def test_two_observations_of_a_series(self, fabric):
        numbers = np.tile([1, 2, 3, 5], len(fabric) // 4)
        series = replace(fabric, table=fabric.table.assign(observation=numbers))
        assert set(two_observations(series, 1, 5).table["observation"]) == {1, 5}

    def test_meshes_look_as_their_pictures_and_smaller_from_near(self, fabric):
        apparent = [radii(rendered(fabric, inverse), 0) for inverse in (0.0, 1 / 0.7)]
        assert np.abs(apparent[0] - radii(fabric, 0)).mean() < 5e-4
        ratio = apparent[1] / apparent[0]
        assert ratio.max() < 1.0
        assert ratio.min() > 0.7 / (0.7 + 0.06) - 0.01  # the overhang is 6 cm


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


def control(kind: str, effects: set[str], **given) -> Control:
    return Control("fabric_1", "trial", "level", kind, frozenset(effects), None, "as it is", **given)  # pyright: ignore[reportArgumentType]


def says(*named: str, verdict: str = "effect", offset: tuple[float, float] | None = None, **probability: float):
    posterior = {frozenset({name.replace("_", "-")}): share for name, share in probability.items()}
    posterior[frozenset()] = 1 - sum(posterior.values())
    estimates = {} if offset is None else {"camera-offset": Estimate(*offset)}
    return Reading(verdict, 0.01, frozenset(named), posterior, estimates)


NOTHING = says(verdict="none")
OFFSET = Amount("camera-offset", 4e-3, 30.0)


def judged(kind: str, effects: set[str], before: Reading, after: Reading, **given) -> tuple[str, bool]:
    one = judge(control(kind, effects, **given), before, after, 5.0)
    return one.hit, one.false_alarm


class TestRules:
    def planted(self, before: Reading, after: Reading) -> tuple[str, bool]:
        return judged("planted", {"camera-offset"}, before, after, amount=OFFSET)

    def test_a_planted_effect_is_found_by_name_or_by_probability(self):
        assert self.planted(NOTHING, says("camera-offset")) == ("yes", False)
        assert self.planted(NOTHING, says(verdict="unknown", camera_offset=0.61)) == ("yes", False)
        assert self.planted(NOTHING, says(verdict="unknown", camera_offset=0.59)) == ("no", False)
        assert self.planted(NOTHING, says("creep")) == ("no", True)
        assert self.planted(says("creep"), says("creep", "camera-offset")) == ("yes", False)
        assert self.planted(NOTHING, refused("too few samples")) == ("no", False)

    def test_an_effect_that_was_there_before_must_change_by_what_was_planted(self):
        """2.7 mm towards 120 deg and 4 mm towards 30 deg are 4.83 mm towards 64 deg."""
        before = says("camera-offset", offset=(2.7e-3, 120.0))
        assert self.planted(before, says("camera-offset", offset=(4.83e-3, 64.0))) == ("yes", False)
        assert self.planted(before, says("camera-offset", offset=(2.7e-3, 120.0))) == ("no", False)
        assert self.planted(before, says("camera-offset", offset=(6.7e-3, 120.0))) == ("no", False)
        opposite = says("camera-offset", offset=(4e-3, 210.0))
        assert self.planted(opposite, says(verdict="none", offset=(1e-4, 0.0))) == ("yes", False)

    def test_a_strength_may_be_estimated_rightly_though_nothing_is_named(self):
        before = says(verdict="unknown", offset=(2.7e-3, 120.0))
        for after, right in ((says(verdict="unknown", offset=(4.83e-3, 64.0)), "yes"), (before, "no"), (NOTHING, "")):
            one = judge(control("planted", {"camera-offset"}, amount=OFFSET), before, after, 5.0)
            assert (one.hit, one.estimate_right) == ("no", right)

    def test_what_silhouettes_cannot_tell_apart_is_right_and_no_false_alarm(self):
        size = alike("camera-scale")
        assert judged("planted", set(size), NOTHING, says("cut-size")) == ("yes", False)
        after = says("camera-offset", "plate-radius")
        assert judged("planted", {"camera-offset"}, says("cut-size"), after) == ("yes", False)

    def test_known_effects_of_the_data(self):
        assert judged("real", {"creep", "bending-friction"}, NOTHING, says("creep")) == ("yes", False)
        assert judged("real", {"creep"}, NOTHING, says("camera-tilt")) == ("no", False)

    def test_what_cannot_be_there(self):
        assert judged("absent", {"creep"}, says("creep"), says("camera-tilt")) == ("yes", False)
        assert judged("absent", {"creep"}, NOTHING, says("creep")) == ("no", True)
        assert judged("absent", {"creep"}, NOTHING, refused("no face")) == ("", False)

    def test_a_mirrored_face_is_no_listed_effect(self):
        assert judged("outside", set(), says("creep"), says("creep", verdict="unknown")) == ("yes", False)
        assert judged("outside", set(), says("creep"), says("grain-skew")) == ("no", True)

    def test_halves_are_rejected_by_what_turns_over_alone(self):
        odd = set(turning_over())
        assert judged("null", odd, NOTHING, says("camera-tilt")) == ("yes", False)
        assert judged("null", odd, NOTHING, says("face-asymmetry")) == ("no", True)
        assert judged("null", odd, says("rest-curvature"), says("rest-curvature")) == ("yes", False)

    def test_a_slip_must_be_left_out_for_the_right_reason(self):
        note = ("left out", "Sample_4.jpg", "shrunken-image")
        for text, hit in (
            ("left out: data/Sample_4.jpg: shrunken-image", "yes"),
            ("left out: data/Sample_4.jpg: off-centre", "no"),
            ("forced: data/Sample_4.jpg: shrunken-image", "no"),
        ):
            after = replace(NOTHING, notes=(text,))
            assert judged("slip", set(), after, after, note=note) == (hit, False)

    def test_the_largest_shift_is_in_standard_errors(self):
        generator = np.random.default_rng(2)
        before = generator.normal(0, 1, (400, 3, len(NAMES)))
        before[:, 2] = nan
        after = before.copy()
        after[:, 1, 5] += 0.5
        spread = before[:, 1, 5].std(ddof=1)
        assert largest_shift(before, after) == pytest.approx(0.5 * 20 / spread)
        assert np.isnan(largest_shift(before[:1], after))


def some_judgements() -> list[Judgement]:
    kinds = [("planted", "larger", 7, 10), ("planted", "smaller", 2, 10), ("null", "", 19, 20)]
    made = []
    for kind, strength, right, count in kinds:
        for number in range(count):
            named = ("camera-offset",) if (number < right) == (kind == "planted") else ()
            one = control(kind, {"camera-offset"}, strength=strength, amount=OFFSET if kind == "planted" else None)
            before, after = says(offset=(0.0, 0.0)), says(*named, offset=(4e-3, 30.0))
            made.append(judge(one, before, after, 1.0 if number % 2 else 9.0))
    return made


class TestTables:
    def test_shares_have_wilsons_interval_and_goals(self):
        """Newcombe, Statistics in Medicine 17 (1998), Table I, for 1 of 29; here 1 of 20 and 7 of 10."""
        shares = {(one.name, one.level): one for one in figures(some_judgements())}
        large = shares["planted effects found", "larger"]
        assert (large.count, large.cases, large.reached) == (7, 10, "no")
        assert (large.low, large.high) == pytest.approx((0.3968, 0.8922), abs=1e-4)
        small = shares["planted effects found", "smaller"]
        assert (small.count, small.goal) == (2, "")
        visible = shares["planted effects found, where silhouettes show them", "larger"]
        assert (visible.count, visible.cases) == (4, 5)
        null = shares["halves of one face rejected", ""]
        assert (null.count, null.cases, null.reached) == (1, 20, "yes")
        assert (null.low, null.high) == pytest.approx((0.0089, 0.2361), abs=1e-4)
        assert shares["strength of planted effects estimated, named or not", "larger"].cases == 10
        assert "known effects of the data found" not in {name for name, _ in shares}

    def test_a_refusal_is_a_miss_where_the_silhouettes_show_it_and_no_proof_against_false_alarms(self):
        planted = control("planted", {"camera-offset"}, strength="larger", amount=OFFSET)
        more = judge(planted, NOTHING, refused("too few samples"), 9.0)
        before, after = (
            {(one.name, one.level): one for one in figures(made)}
            for made in (some_judgements(), [*some_judgements(), more])
        )
        visible = "planted effects found, where silhouettes show them", "larger"
        assert (after[visible].count, after[visible].cases) == (before[visible].count, before[visible].cases + 1)
        beside = "another effect named beside what was planted", ""
        assert after[beside].cases == before[beside].cases == 20

    def test_tables_hold_every_control_and_share(self):
        made = some_judgements()
        shares, facts = figures(made), {"command": "cusick-bench diagnose-controls DATA", "code": "1"}
        table = rows(made, shares, facts)
        assert table["row"].tolist().count("control") == len(made)
        assert table["row"].tolist().count("share") == len(shares)
        assert set(table["command"]) == {facts["command"]}
        page = markdown(made, shares, facts)
        assert "| planted effects found | larger | 7 of 10 | 70 % [40, 89] | >= 80 % | no |" in page
        assert page.count("| fabric_1 | trial |") == len(made)
        written = document(made, shares, facts)
        assert written["missed"] == ["planted effects found (>= 80 %)"]
        assert len(written["controls"]) == len(made)
        assert all(len(line) == len(lines[0]) for lines in (share_lines(shares), control_lines(made)) for line in lines)

    def test_a_table_is_read_as_it_was_written(self, tmp_path):
        made, facts, path = some_judgements(), {"command": "a", "code": "1"}, tmp_path / "controls.csv"
        path.write_text(csv_text(rows(made, figures(made), facts)))
        assert list(map(repr, read_judgements(path, facts))) == list(map(repr, made))
        assert read_judgements(path, {**facts, "code": "2"}) == []
        assert read_judgements(path, {**facts, "data_sha256": "a table of before knows nothing of it"}) == []
        assert read_judgements(tmp_path / "none.csv", facts) == []
        path.write_text("row,command,code\ncontrol,a,1\n")
        with pytest.raises(DiagnosisError, match="no table of controls"):
            read_judgements(path, facts)


class TestCommand:
    def test_fabrics_that_a_table_has_are_not_done_again(self, tmp_path, monkeypatch):
        """Stopped at the second fabric, and begun again."""
        done, out = [], tmp_path / "controls.csv"

        def controlled(under, *args, **options):
            if under.name == "fabric_2" and not done.count("fabric_2"):
                done.append("fabric_2")
                raise KeyboardInterrupt
            done.append(under.name)
            return [replace(one, fabric=under.name) for one in some_judgements()]

        monkeypatch.setattr(run, "controlled", controlled)
        asked = ["diagnose-controls", "synthetic", "--fabric", "fabric_1", "--fabric", "fabric_2", "--out", str(out)]
        assert CliRunner().invoke(app, asked).exit_code != 0
        again = CliRunner().invoke(app, [*asked, "--json"])
        assert again.exit_code == 0, again.output
        assert done == ["fabric_1", "fabric_2", "fabric_2"]
        fabrics = [one["fabric"] for one in json.loads(again.stdout)["controls"]]
        assert fabrics == ["fabric_1"] * len(some_judgements()) + ["fabric_2"] * len(some_judgements())

    def test_other_data_of_the_same_name_are_controlled_anew(self, tmp_path, monkeypatch):
        done, data = [], write_laboratory(tmp_path / "lab", RELEASE, samples=6)

        def controlled(under, *args, **options):
            done.append(under.name)
            return [replace(one, fabric=under.name) for one in some_judgements()]

        monkeypatch.setattr(run, "controlled", controlled)
        asked = ["diagnose-controls", str(data), "--out", str(tmp_path / "controls.csv")]
        for protocol, times in ((RELEASE, 1), (RELEASE, 1), (replace(RELEASE, px_per_m=720.0), 2)):
            write_protocol(data, protocol)
            again = CliRunner().invoke(app, asked)
            assert again.exit_code == 0, again.output
            assert done == ["fabric_3"] * times

    @pytest.mark.slow
    def test_a_shift_of_one_fabric_from_end_to_end(self, tmp_path):
        out = tmp_path / "controls.csv"
        chosen = ["--fabric", CLOTH, "--control", "shift", "--workers", "1", "--out", str(out), "--json"]
        done = CliRunner().invoke(app, ["diagnose-controls", "synthetic", *chosen])
        assert done.exit_code == 0, done.output
        written = json.loads(done.stdout)
        small, large = written["controls"]
        assert (small["strength"], large["strength"]) == ("smaller", "larger")
        assert large["largest_shift"] == pytest.approx(2 * small["largest_shift"], rel=0.05)
        assert large["largest_shift"] > 5
        assert large["probability"] > large["probability_before"]
        assert large["planted"] == pytest.approx(3 / 723)
        assert large["estimated"] == pytest.approx(3 / 723, rel=0.5)
        with out.open() as file:
            lines = list(csv.DictReader(file))
        assert [line["control"] for line in lines if line["row"] == "control"] == ["shift", "shift"]
        assert "diagnose-controls synthetic --fabric fabric_2" in out.with_suffix(".md").read_text()

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["--control", "shfit"], "no control is called 'shfit'; use shift, scale"),
            (["--out", "table.txt"], "must end in .csv"),
            (["--fabric", "fabric_99"], "fabric_99"),
        ],
    )
    def test_bad_input_is_refused(self, arguments, message):
        done = CliRunner().invoke(app, ["diagnose-controls", "synthetic", *arguments])
        assert done.exit_code == 2
        assert message in done.stderr

    def test_too_few_samples_are_told_with_their_number(self, make_lab, tmp_path):
        lab, out = make_lab([1e-5], samples=3), tmp_path / "controls.csv"
        asked = ["diagnose-controls", str(lab), "--out", str(out)]
        assert "has 6 samples, from which on" in CliRunner().invoke(app, asked).stderr
        done = CliRunner().invoke(app, [*asked, "--fabric", "fabric_1", "--control", "halves"])
        assert done.exit_code == 2
        assert "none of halves can be tried on fabric_1" in done.stderr
        assert "(halves) 6 samples that are not there" in done.stderr

    def test_controls_that_no_fabric_allows_are_no_empty_table(self, tmp_path):
        out = tmp_path / "controls.csv"
        asked = ["diagnose-controls", "synthetic", "--fabric", CLOTH, "--control", "slip", "--out", str(out)]
        for _ in range(2):
            done = CliRunner().invoke(app, asked)
            assert done.exit_code == 2
            assert f"none of slip can be tried on {CLOTH}" in done.stderr
            assert not out.exists()

    def test_every_control_has_a_line_in_the_docs(self):
        from cusick_bench.diagnosis.controls import known_answers

        assert all(f"    {name}" in (known_answers.__doc__ or "") for name in CONTROLS)


class TestRun:
    """Which diagnoses are made, with one that answers at once."""

    @pytest.fixture
    def diagnosed(self, monkeypatch) -> list[Captures]:
        seen: list[Captures] = []

        def diagnose(captures, emulator, calibration, options):
            seen.append(captures)
            if len(set(captures.side)) == 1:
                raise DiagnosisError("one face only")
            return _answer(captures)

        monkeypatch.setattr(run, "diagnose", diagnose)
        monkeypatch.setattr(run, "read", lambda answer: answer)
        return seen

    def test_every_picture_set_is_diagnosed_once(self, under_control, diagnosed):
        told: list[float] = []
        made = controlled(
            under_control, None, None, names=["shift", "faces", "halves"],  # pyright: ignore[reportArgumentType]
            progress=lambda what, share: told.append(share),
        )  # fmt: skip
        assert len(diagnosed) == 3 + 2 + 2  # as it is and either face; shifts; halves
        assert told[-1] == 1.0
        found = {one.control: one for one in made}
        assert found["shift"].hit == "yes"
        assert found["shift"].estimate_right == "yes"
        assert found["halves"].verdict_before == REFUSED
        assert found["halves"].hit == "yes"

    def test_what_is_planted_shows_also_where_the_diagnosis_is_refused(self, under_control, diagnosed, monkeypatch):
        def refuse(captures, emulator, calibration, options):
            raise DiagnosisError("not today")

        monkeypatch.setattr(run, "diagnose", refuse)
        made = controlled(under_control, None, None, names=["shift"])  # pyright: ignore[reportArgumentType]
        assert [(one.verdict, one.hit) for one in made] == [(REFUSED, "no")] * 2
        assert all(one.largest_shift > 1 for one in made)


def _answer(captures: Captures) -> Reading:
    """Names an offset where outlines lie towards the planted direction, and estimates it by their first harmonic."""
    first = 2 * np.fft.rfft(captures.radii, axis=1)[:, 1].conj().mean() / captures.radii.shape[1]
    estimates = {"camera-offset": Estimate(abs(first), float(np.rad2deg(np.angle(first))))}
    angle = np.deg2rad(SHIFT_DIRECTION)
    along = (first * np.exp(-1j * angle)).real
    named = frozenset({"camera-offset"} if along > 1e-3 else ())
    return Reading("effect" if named else "none", 0.01, named, {frozenset(): 1.0}, estimates)


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


def test_a_fabric_that_is_refused_is_judged_as_such():
    one = judge(control("planted", {"creep"}), refused("one face only"), refused("one face only"), nan)
    assert (one.verdict, one.hit, one.note, one.named) == (REFUSED, "no", "one face only", "")
