"""The sentence that says what acts and what is left."""

from dataclasses import replace

from atlas_fabrics import only

from cusick_bench.datasets import load
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.diagnose import diagnose
from cusick_bench.diagnosis.document.headline import headline
from cusick_bench.diagnosis.inference.findings.budget import Budget, Share
from cusick_bench.diagnosis.inference.single_effects.evidence import (
    NONE,
    UNKNOWN,
    Candidate,
)
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.measure.captures import read_captures


def test_a_headline_says_what_acts_and_what_is_left(emulator: Emulator) -> None:
    captures = read_captures(load("synthetic"), "fabric_1")
    found = diagnose(captures.select(captures.sample <= 3), emulator, options=only("camera-offset", "creep"))
    doubtful = {UNKNOWN: 0.55, "camera-offset": 0.3, "plate-tilt": 0.1, NONE: 0.05}
    for kept in ((UNKNOWN, "camera-offset", "plate-tilt"), ("camera-offset", "plate-tilt")):
        said = headline(replace(found, verdict="ambiguous", probability=doubtful, set90=kept))
        assert "one of camera-offset, plate-tilt" in said
        assert ("something that is not on the list (55%)" in said) == (UNKNOWN in kept)
        assert "chance" not in said
    said = headline(replace(found, verdict="ambiguous", probability=doubtful | {NONE: 0.92}, set90=(NONE,)))
    assert said.startswith("Something shows, but no known effect stands out: it may be chance alone (92%).")
    acting, shared = {"camera-offset": 0.9, "creep": 0.7}, Budget({}, Share(0.25, (0.2, 0.3)))
    said = headline(
        replace(
            found, verdict="several", effects=("camera-offset", "creep"), groups=(("cut-size", "threshold"),),
            acting=acting, budget=shared, causes=found.causes or (Candidate(hypotheses(emulator)[0], {}),),
        )
    )  # fmt: skip
    assert "camera-offset (90%), creep (70%), and one of cut-size, threshold" in said
    assert said.endswith("Unexplained of the gap on unseen samples: 25%.")
    groups = (("camera-offset", "plate-tilt"), ("cut-size", "threshold"))
    said = headline(
        replace(found, verdict="ambiguous", effects=(), groups=groups, probability=doubtful, set90=sum(groups, ()))
    )
    assert said.startswith("Several effects act together")
    assert "one of camera-offset, plate-tilt, and one of cut-size, threshold." in said
