"""Answers, labels and commitments of withheld cases, and what else `withheld` reads."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bad_input.case import Case, Outcome, Stock
from bad_input.odd_files import ODD

SCORE = "withheld score {here}/answers.json {here}/labels.json --json"
LABEL = {
    "effect": "creep",
    "class": "history",
    "severity": 1.0,
    "parameters": {},
    "location": None,
    "oracle_closure": None,
    "multiple": 2.0,
}
CAUSE = {"effect": "creep", "class": "history", "probability": 0.9}
ANSWER = {"verdict": "effect", "gap": {"base": 1, "floor": 0.1, "p": 0.001}, "causes": [CAUSE], "set90": ["creep"]}


def _write(answers: Any, labels: Any, here: Path, stock: Stock) -> None:
    for name, document in (("answers", answers), ("labels", labels)):
        content = document if isinstance(document, str) else json.dumps(document)
        (here / f"{name}.json").write_text(content)


def _odd(name: str, make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    _write({"a": ANSWER}, {"a": LABEL}, here, stock)
    (here / name).unlink(missing_ok=True)
    make(here / name)


def _beside(name: str, content: str, here: Path, stock: Stock) -> None:
    _write({"a": ANSWER}, {"a": LABEL}, here, stock)
    (here / name).write_text(content)


def _scored(outcome: Outcome) -> bool:
    return isinstance(outcome.document, dict)


_ANSWERS: dict[str, Any] = {
    "empty": "",
    "a list": [],
    "null": "null",
    "a key twice": '{"a": {}, "a": {}}',
    "NaN": '{"a": NaN}',
    "lists within each other": "[" * 9999 + "]" * 9999,
    "an answer a list": {"answers": {"a": [ANSWER]}},
    "an answer of nothing": {"a": {}},
    "unknown verdict": {"a": ANSWER | {"verdict": "perhaps"}},
    "verdict a number": {"a": ANSWER | {"verdict": 1}},
    "no causes": {"a": ANSWER | {"causes": []}},
    "causes an object": {"a": ANSWER | {"causes": CAUSE}},
    "causes of texts": {"a": ANSWER | {"causes": ["creep"]}},
    "unknown cause": {"a": ANSWER | {"causes": [CAUSE | {"effect": "wind"}]}},
    "probability above one": {"a": ANSWER | {"causes": [CAUSE | {"probability": 1.5}]}},
    "negative probability": {"a": ANSWER | {"causes": [CAUSE | {"probability": -0.1}]}},
    "probability as text": {"a": ANSWER | {"causes": [CAUSE | {"probability": "0.9"}]}},
    "probability true": {"a": ANSWER | {"causes": [CAUSE | {"probability": True}]}},
    "a cause twice": {"a": ANSWER | {"causes": [CAUSE, CAUSE]}},
    "probabilities of two": {
        "a": ANSWER | {"causes": [CAUSE, {"effect": "plate-tilt", "class": "boundary", "probability": 0.9}]}
    },
    "set90 a text": {"a": ANSWER | {"set90": "creep"}},
    "set90 of numbers": {"a": ANSWER | {"set90": [1]}},
    "set90 of unknown causes": {"a": ANSWER | {"set90": ["wind"]}},
    "gap a number": {"a": ANSWER | {"gap": 1}},
    "gap as text": {"a": ANSWER | {"gap": {"base": "1", "floor": 0.1, "p": 0.1}}},
    "p above one": {"a": ANSWER | {"gap": {"base": 1, "floor": 0.1, "p": 2}}},
    "map of another shape": {"a": ANSWER | {"where": {"map": [[1, 2], [3]]}}},
    "map of texts": {"a": ANSWER | {"where": {"map": [["a"] * 16] * 4}}},
    "closure as text": {"a": ANSWER | {"closure": {"effect": "creep", "fraction": "most"}}},
    "answers to other cases": {"b": ANSWER},
}
_LABELS: dict[str, Any] = {
    "empty": "",
    "a number": "5",
    "a key twice": '{"a": {}, "a": {}}',
    "a label of nothing": {"a": {}},
    "unknown effect": {"a": LABEL | {"effect": "wind"}},
    "effect a number": {"a": LABEL | {"effect": 7}},
    "three effects": {"a": LABEL | {"effect": ["creep", "plate-tilt", "cut-size"]}},
    "severity as text": {"a": LABEL | {"severity": "much"}},
    "severity a list": {"a": LABEL | {"severity": [1, 2, 3]}},
    "multiple as text": {"a": LABEL | {"multiple": "two"}},
    "negative multiple": {"a": LABEL | {"multiple": -2.0}},
    "multiple of 1e400": json.dumps({"a": LABEL}).replace("2.0", "1e400"),
    "location as text": {"a": LABEL | {"location": "left"}},
    "closure above one": {"a": LABEL | {"oracle_closure": "all"}},
    "labels of other cases": {"b": LABEL},
}
_BESIDE: dict[str, tuple[str, str, str]] = {
    "commitment: a list": ("--commitment", "[]", "one JSON object"),
    "commitment: other cases": ("--commitment", '{"cases": {"b": "0"}}', "lacks a"),
    "commitment: another seal": (
        "--commitment",
        json.dumps({"cases": {"a": "0" * 64}}),
        "must be the one that was sealed",
    ),
    "commitment: a seal of a number": ("--commitment", '{"cases": {"a": 5}}', "lacks a"),
    "oracle: a number": ("--oracle", "5", "one JSON object"),
    "oracle: closures of texts": ("--oracle", '{"a": "all"}', "oracle|beside"),
    "oracle: NaN": ("--oracle", '{"a": NaN}', "NaN is no JSON"),
    "twins: a list": ("--twins", "[]", "one JSON object"),
    "twins: shifts of numbers": ("--twins", '{"a": 5}', "beside"),
}

_WITHOUT_VERDICT = {key: value for key, value in ANSWER.items() if key != "verdict"}
_ALL_ROUND = {"kind": "patch", "angle_deg": [1, 2]}

CASES = [
    Case("plain answers", SCORE, partial(_write, {"a": ANSWER}, {"a": LABEL}), right=_scored),
    Case("answers without a verdict", SCORE, partial(_write, {"a": _WITHOUT_VERDICT}, {"a": LABEL}), right=_scored),
    Case(
        "place without a radius",
        SCORE,
        partial(_write, {"a": ANSWER}, {"a": LABEL | {"location": _ALL_ROUND}}),
        right=_scored,
    ),
    *(
        Case(f"answers: {n}", SCORE, partial(_write, d, {"a": LABEL}), refused="answers.json|labels.json")
        for n, d in _ANSWERS.items()
    ),
    *(
        Case(f"labels: {n}", SCORE, partial(_write, {"a": ANSWER}, d), refused="labels.json|answers.json")
        for n, d in _LABELS.items()
    ),
    *(
        Case(f"answers: {n}", SCORE, partial(_odd, "answers.json", make), refused=said + "|no file at")
        for n, (make, said) in ODD.items()
    ),
    *(
        Case(n, f"{SCORE} {option} {{here}}/beside.json", partial(_beside, "beside.json", content), refused=said)
        for n, (option, content, said) in _BESIDE.items()
    ),
    *(
        Case(
            f"table of detectable severities: {n}",
            "withheld generate --out {here}/c --labels {here}/l --nulls 1 --singles 0 --pairs 0 --unknown 0 --vertices 100 "
            "--samples 1 --workers 1 --detectable {here}/beside.json",
            partial(_beside, "beside.json", content),
            refused="beside.json",
        )
        for n, content in {
            "empty": "",
            "a list": "[]",
            "no severities": '{"stiffness": [1]}',
            "severities of texts": '{"stiffness": ["a"], "severity": {"creep": ["b"]}}',
            "severities of another length": '{"stiffness": [-9.0, -8.0], "severity": {"creep": [1.0]}}',
        }.items()
    ),
]
