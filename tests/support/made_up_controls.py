"""Controls of a diagnosis with made-up readings, and a fabric to plant effects in."""

import numpy as np

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.diagnosis.controls.judgement import Judgement, judge
from cusick_bench.diagnosis.controls.known_answers import Amount, Control
from cusick_bench.diagnosis.controls.reading import Estimate, Reading

CLOTH = "fabric_2"


def radii(data: DrapeDataset, row: int) -> np.ndarray:
    return profile_of(data.image(row).numpy(), data.protocol).radii


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
