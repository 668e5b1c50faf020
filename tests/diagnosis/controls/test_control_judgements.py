"""What is judged right, and tables of it."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from made_up_controls import NOTHING, OFFSET, control, judged, says, some_judgements
from scipy.stats import binomtest

from cusick_bench.diagnosis.controls.figures import figures
from cusick_bench.diagnosis.controls.judgement import judge, largest_shift
from cusick_bench.diagnosis.controls.known_answers import alike, turning_over
from cusick_bench.diagnosis.controls.reading import REFUSED, Reading, refused
from cusick_bench.diagnosis.controls.table import control_lines, document, markdown, read_judgements, rows, share_lines
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.files.csv_text import csv_text


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


def test_a_fabric_that_is_refused_is_judged_as_such():
    one = judge(control("planted", {"creep"}), refused("one face only"), refused("one face only"), nan)
    assert (one.verdict, one.hit, one.note, one.named) == (REFUSED, "no", "one face only", "")


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

    def test_fabrics_that_go_well_or_badly_as_a_whole_count_as_few_cases(self):
        """Where each of k fabrics with n cases has all hits or none, the design effect is n k / (k - 1), by hand."""
        one = some_judgements()[0]

        def share(hits: list[int], cases: int) -> tuple[float, float]:
            """Interval of hits by fabric, of so many cases each."""
            made = [
                replace(one, fabric=f"fabric_{number}", kind="real", hit="yes" if case < count else "no")
                for number, count in enumerate(hits)
                for case in range(cases)
            ]
            found = {figure.name: figure for figure in figures(made)}["known effects of the data found"]
            assert found.value == pytest.approx(np.mean(hits) / cases)
            return found.low, found.high

        assert share([10, 10, 0, 0], 10) == pytest.approx((0.1253, 0.8747), abs=1e-4)  # Wilson's of 1.5 of 3
        for hits, cases in (([5, 5, 5, 5], 10), ([1, 1, 0, 0], 1), ([3, 3], 3), ([4], 9)):
            interval = binomtest(sum(hits), cases * len(hits)).proportion_ci(0.95, "wilson")
            assert share(hits, cases) == pytest.approx((interval.low, interval.high)), (hits, cases)

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
        assert "of as many cases as the scatter between fabrics leaves" in page
        written = document(made, shares, facts)
        assert written["missed"] == ["planted effects found (>= 80 %)"]
        assert len(written["controls"]) == len(made)
        assert all(len(line) == len(lines[0]) for lines in (share_lines(shares), control_lines(made)) for line in lines)

    def test_a_table_is_read_as_it_was_written(self, tmp_path):
        made, facts, path = some_judgements(), {"command": "a", "code": "1"}, tmp_path / "controls.csv"
        path.write_text(csv_text(rows(made, figures(made), facts)))
        assert list(map(repr, read_judgements(path, facts))) == list(map(repr, made))
        formula = [replace(made[0], fabric="@wool")]  # which the file guards against spreadsheets
        path.write_text(csv_text(rows(formula, figures(formula), facts)))
        assert [one.fabric for one in read_judgements(path, facts)] == ["@wool"]
        assert read_judgements(path, {**facts, "code": "2"}) == []
        assert read_judgements(path, {**facts, "data_sha256": "a table of before knows nothing of it"}) == []
        assert read_judgements(tmp_path / "none.csv", facts) == []
        path.write_text("row,command,code\ncontrol,a,1\n")
        with pytest.raises(DiagnosisError, match="no table of controls"):
            read_judgements(path, facts)
