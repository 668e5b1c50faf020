"""A diagnosis as one JSON document: for files, for the report page, and as the answer to a withheld case."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.diagnose import Diagnosis, single_causes
from cusick_bench.diagnosis.inference.equivalents import ABSORBED, EQUIVALENTS
from cusick_bench.diagnosis.inference.evidence import NONE, UNKNOWN, Candidate
from cusick_bench.diagnosis.inference.hypotheses import shifts
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.statistics import GROUPS
from cusick_bench.diagnosis.measure.statistics import NAMES as STATISTICS
from cusick_bench.diagnosis.simulation.samples import Simulated
from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.sim.effects import registered

STAGES: tuple[str, ...] = ("material", "history", "boundary", "contact", "imaging", NONE, UNKNOWN)
_LEAST = 0.005  # probability of a cause that is worth a line
_BESIDE = {UNKNOWN: "something that is not on the list", NONE: "chance alone"}
"""What an ambiguous set may hold beside effects."""


def document(
    diagnosis: Diagnosis, captures: Captures, emulator: Emulator, *, command: str, version: str
) -> dict[str, Any]:
    """Everything about one diagnosis.

    Args:
        diagnosis: What was found.
        captures: The data.
        emulator: The atlas.
        command: That made it.
        version: Of the code.
    """
    answer_part = answer(diagnosis)
    theta = diagnosis.residual.theta
    found = diagnosis.gap
    return {
        "fabric": diagnosis.fabric,
        "headline": headline(diagnosis),
        **answer_part,
        "gap": answer_part["gap"]
        | {
            "effect": None if found is None else _number(found.effect),
            "groups": {}
            if found is None
            else {
                name: {"gap": _number(value), "floor": _number(found.groups_floor[name])}
                for name, value in found.groups.items()
            },
        },
        "causes": [_cause(diagnosis, name, p) for name, p in _ranked(diagnosis)],
        "steps": _steps(diagnosis),
        "base": dict(zip(PARAMETERS, theta.tolist(), strict=True)),
        "data": _counts(captures),
        "statistics": _statistics(diagnosis, emulator),
        "profiles": {
            "data": [
                {"sample": int(captures.sample[i]), "side": str(captures.side[i]), "radii_m": row.tolist()}
                for i, row in enumerate(np.round(captures.radii * CLOTH_RADIUS / captures.protocol.cloth_radius_m, 5))
            ],
            "base": _profiles(diagnosis.simulated and diagnosis.simulated.base),
            "effect": _profiles(diagnosis.simulated and diagnosis.simulated.effect),
        },
        "indistinguishable": [
            {"effects": sorted(alike.effects), "why": alike.why}
            for alike in (*EQUIVALENTS, ABSORBED)
            if alike.effects.intersection(diagnosis.set90)
        ],
        "notes": list(diagnosis.notes),
        "without": list(diagnosis.without),
        "made": {"version": version, "command": command, "atlas": f"{len(emulator.responses)} effects"},
    }  # fmt: skip


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """The part that answers a withheld case."""
    found, spot = diagnosis.gap, diagnosis.place
    single = single_causes(diagnosis.probability)
    stage: dict[str, float] = dict.fromkeys(STAGES, 0.0)
    for name, p in single.items():
        stage[_class(name) or name] += p
    closed = diagnosis.cause[0].hypothesis.name if diagnosis.cause and found is not None else None
    return {
        "verdict": diagnosis.verdict,
        "gap": {
            "base": None if found is None else _number(found.base),
            "floor": None if found is None else _number(found.floor),
            "p": diagnosis.p,
        },
        "causes": [
            {"effect": name, "class": _class(name), "probability": p, "parameters": _values(diagnosis, name)}
            for name, p in _ranked(diagnosis)
        ],
        "set90": list(diagnosis.set90),
        "where": {
            "stage": stage,
            "map": np.round(spot.map, 5).tolist(),
            "kind": spot.kind,
            "angle_deg": None if spot.angle is None else list(spot.angle),
            "radius_m": None if spot.radius is None else list(spot.radius),
            "localisable": spot.localisable,
            "why_not": spot.why_not,
        },
        "closure": {
            "effect": closed,
            "fraction": None if found is None else _number(found.closure),
            "ci90": None if found is None or not isfinite(found.closure) else list(found.closure_interval),
        },
        "next": [
            {"name": a.measurement.name, "what": a.measurement.what, "bits": a.bits, "about": list(a.about)}
            for a in diagnosis.advice
        ],
        "baselines": {name: _baseline(p) for name, p in diagnosis.baselines.items()},
    }  # fmt: skip


def _steps(diagnosis: Diagnosis) -> dict[str, Any]:
    """Causes taken off one after the other, and how far all of them together close the gap."""
    all_of_them = diagnosis.together and diagnosis.together.gap
    return {
        "causes": [
            {
                "effect": step.candidate.hypothesis.name,
                "parameters": dict(step.candidate.value),
                "log_evidence": step.candidate.log_evidence,
                "misfit_left": step.misfit,
            }
            for step in diagnosis.steps
        ],
        "misfit": diagnosis.residual.misfit / len(diagnosis.residual.white),
        "closure": None if all_of_them is None else _number(all_of_them.closure),
        "ci90": None
        if all_of_them is None or not isfinite(all_of_them.closure)
        else list(all_of_them.closure_interval),
    }


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    p = single_causes(diagnosis.probability)
    if diagnosis.verdict == NONE:
        return "No unmodelled effect shows: the drapes differ from the base model no more than chance allows."
    if diagnosis.verdict == UNKNOWN:
        parts = [step.candidate.hypothesis.name for step in diagnosis.steps]
        share = f" Parts of it, one after the other: {', '.join(parts)}{_closed(diagnosis)}." if parts else ""
        return f"The drapes differ from the base model, and no known effect, nor two of them, explains how.{share}"
    names = [one.hypothesis.name for one in diagnosis.cause]
    summary = "; and ".join(registered()[name].summary for name in names)
    if diagnosis.verdict == "effect":
        return f"{' + '.join(names)}, with probability {p[names[0]]:.0%}: {summary}."
    several = ", ".join(name for name in diagnosis.set90 if name not in _BESIDE)
    beside = "".join(f", or {what} ({p[name]:.0%})" for name, what in _BESIDE.items() if name in diagnosis.set90)
    return f"Something shows that these drapes alone cannot tell apart: one of {several}{beside}."


def _closed(diagnosis: Diagnosis) -> str:
    """How far all steps together close the gap, where that was simulated and is surely something."""
    found = diagnosis.together and diagnosis.together.gap
    if found is None or not found.closure_interval[0] > 0:
        return ""
    low, high = found.closure_interval
    return f"; together they close {found.closure:.0%} of the gap [{low:.0%}, {high:.0%}]"


def table(found: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows for the terminal: cause, class, probability, parameters."""
    rows = []
    for cause in found["causes"][:8]:
        parts = [f"{name} {value['value']:.3g} {value['unit']}".strip() for name, value in cause["parameters"].items()]
        rows.append((cause["effect"], cause["class"], f"{cause['probability']:.2f}", ", ".join(parts)))
    return rows


def _ranked(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    single = single_causes(diagnosis.probability)
    named = {one.hypothesis.name for one in diagnosis.cause}
    return [(n, p) for n, p in sorted(single.items(), key=lambda item: -item[1]) if p >= _LEAST or n in named]


def _best(diagnosis: Diagnosis, name: str) -> Candidate | None:
    chosen = [*diagnosis.cause, *diagnosis.best]
    return next((one for one in chosen if one.hypothesis.name == name), None)


def _values(diagnosis: Diagnosis, name: str) -> dict[str, float]:
    best = _best(diagnosis, name)
    return {} if best is None else dict(best.value)


def _cause(diagnosis: Diagnosis, name: str, probability: float) -> dict[str, Any]:
    effect = registered().get(name)
    units = {} if effect is None else {p.name: p.unit for p in effect.parameters}
    pair = [one.hypothesis.name for one in diagnosis.cause if one.hypothesis.name != name]
    leads = bool(diagnosis.cause) and diagnosis.cause[0].hypothesis.name == name
    return {
        "effect": name,
        "class": _class(name),
        "probability": probability,
        "parameters": {
            key: {"value": value, "unit": units.get(key, "")} for key, value in _values(diagnosis, name).items()
        },
        "summary": "" if effect is None else effect.summary,
        "pair_with": pair[0] if leads and pair else None,
    }


def _class(name: str) -> str:
    effect = registered().get(name)
    return "" if effect is None else effect.kind


def _baseline(probability: Mapping[str, float]) -> dict[str, Any]:
    """In the form of an answer, which names one effect or none."""
    causes = [
        {"effect": name, "class": _class(name), "probability": round(p, 4), "parameters": {}}
        for name, p in list(probability.items())[:5]
    ]
    return {
        "verdict": "effect" if causes else NONE,
        "causes": causes or [{"effect": NONE, "class": "", "probability": 1.0, "parameters": {}}],
        "set90": [causes[0]["effect"]] if causes else [NONE],
    }


def _counts(captures: Captures) -> dict[str, Any]:
    density = captures.areal_density
    return {
        "samples": len(np.unique(captures.sample)),
        "captures": len(captures),
        "up": int((captures.side == "up").sum()),
        "down": int((captures.side == "down").sum()),
        "later": len(captures) - len(set(zip(captures.sample.tolist(), captures.side.tolist(), strict=True))),
        "areal_density_kg_m2": density if isfinite(density) else None,
    }


def _statistics(diagnosis: Diagnosis, emulator: Emulator) -> list[dict[str, Any]]:
    """Each statistic: data by face, base model, base with the cause, and by how many standard errors they differ."""
    sd, found = diagnosis.residual.sd, diagnosis.features
    base, effect, simulated = _means(diagnosis, emulator)
    error = sd * np.sqrt(1 / max(int(found.samples.sum()), 1) + (1 / simulated if simulated else 0))
    group_of = {column: name for name, columns in GROUPS.items() for column in columns}
    rows = []
    for k, name in enumerate(STATISTICS):
        known = (found.mean[:, k] - base[k])[np.isfinite(found.mean[:, k])]
        difference = known[np.argmax(np.abs(known))] if len(known) else np.nan
        rows.append(
            {
                "name": name,
                "group": group_of[k],
                "unit": _unit(name),
                "up": _number(found.mean[0, k]),
                "down": _number(found.mean[1, k]),
                "base": float(base[k]),
                "effect": _number(effect[k]),
                "z": _number(float(difference / error[k])),
            }
        )
    return rows


def _means(diagnosis: Diagnosis, emulator: Emulator) -> tuple[ndarray, ndarray, int]:
    """Mean statistics of base model and base with the cause, and of how many drapes; 0 where the atlas tells them."""
    drapes = diagnosis.simulated
    if drapes is not None and np.isfinite(drapes.base.specimens).any((0, 1)).all():
        base = np.nanmean(drapes.base.specimens, (0, 1))
        changed = np.nan * base if drapes.effect is None else np.nanmean(drapes.effect.specimens, (0, 1))
        return base, changed, int(np.isfinite(drapes.base.specimens[..., 0]).sum())
    residual = diagnosis.residual
    base, moved = emulator.mean(residual.theta), np.full(len(STATISTICS), np.nan)
    if len(diagnosis.cause) == 1:
        one = diagnosis.cause[0]
        point = {name: np.array([value]) for name, value in one.value.items()}
        row = shifts(emulator, one.hypothesis, residual.theta, residual.sd, residual.drift, point).rows[0]
        moved = row[: 2 * len(STATISTICS)].reshape(2, -1).mean(0) * residual.sd
    return base, base + moved, 0


def _unit(name: str) -> str:
    if name in ("area_dc", "folds", "fold_centroid", "skewness") or name.startswith("envelope"):
        return "1"
    return "m/rad" if name == "roughness" else "m"


def _profiles(simulated: Simulated | None) -> list[dict[str, Any]]:
    if simulated is None:
        return []
    return [
        {"sample": sample + 1, "side": side, "radii_m": np.round(simulated.radii[sample, face], 5).tolist()}
        for sample in range(len(simulated.radii))
        for face, side in enumerate(("up", "down"))
        if np.isfinite(simulated.radii[sample, face]).all()
    ]


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
