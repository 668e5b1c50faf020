"""Labels and answers of a small withheld suite, and their scores."""

import json

import numpy as np

from cusick_bench.withheld.format import location
from cusick_bench.withheld.format.causes import EFFECTS, class_of
from cusick_bench.withheld.scoring.labelled_answers import LabelledAnswers, read_labelled_answers
from cusick_bench.withheld.scoring.score import Scores
from cusick_bench.withheld.scoring.score import score as score_fully

LOCAL = "local-stiff-patch"


PLACE = {"kind": "patch", "angle_deg": [80, 100], "radius_m": [0.11, 0.13]}


def label(effect, multiple=2.0, **more):
    named = effect if isinstance(effect, str) else effect[0]
    found = {"effect": effect, "class": class_of(named), "severity": 1.0, "parameters": {}, "location": None}
    return {**found, "oracle_closure": None, "multiple": multiple, **more}


def peaked_map(angle=90.0, radius=0.12):
    """A map whose strongest cell holds that point."""
    ring = int((radius - location.PLATE_EDGE) / (location.RIM - location.PLATE_EDGE) * 4)
    values = np.zeros((4, 16))
    values[ring, int(angle / 22.5)] = 1
    return values.tolist()


def answer(verdict, *named, set90=None, p=0.5, **more):
    """An answer; `named` are names with probabilities."""
    stated = [{"effect": name, "class": class_of(name), "probability": chance} for name, chance in named]
    members = [name for name, _ in named] if set90 is None else set90
    return {"verdict": verdict, "gap": {"base": 1, "floor": 0.1, "p": p}, "causes": stated, "set90": members, **more}


def suite(nulls=30, outside=20):
    """Labels: nulls, every effect at four severities, pairs, effects outside the list."""
    names = list(EFFECTS)
    labels = {f"null_{i}": label("none", None, severity=None) for i in range(nulls)}
    for name in names:
        place = PLACE if name == LOCAL else None
        for multiple in (0.5, 1, 2, 4):
            labels[f"{name}_{multiple}"] = label(name, multiple, location=place, oracle_closure=0.8)
    labels |= {f"pair_{i}": label([names[i], names[i + 9]], [2, 4], severity=[1, 1]) for i in range(10)}
    return labels | {f"outside_{i}": label("unknown", None, severity=None, hidden="wind") for i in range(outside)}


def perfect(truth):
    effect = truth["effect"]
    if effect in ("none", "unknown"):
        return answer(effect, (effect, 1.0), p=0.9 if effect == "none" else 0.001)
    named = [effect] if isinstance(effect, str) else effect
    return answer(
        "effect",
        *((name, 1 / len(named)) for name in named),
        p=0.001,
        where={"map": peaked_map(), **PLACE, "localisable": truth["location"] is not None},
        closure={"effect": effect, "fraction": 0.75, "ci90": [0.6, 0.9]},
    )


def revealed(tmp_path, labels, answers, commitment=None):
    for name, document in (("labels", labels), ("answers", answers)):
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
    return read_labelled_answers(tmp_path / "answers.json", tmp_path / "labels.json", commitment)


def scored(tmp_path, labels, answers) -> Scores:
    return score(revealed(tmp_path, labels, answers))


def score(answered: LabelledAnswers, seed: int = 0) -> Scores:
    """Scores with few resamples, which is fast; values and goals do not depend on them."""
    return score_fully(answered, seed, resamples=100, deals=3)
