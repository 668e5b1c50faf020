"""Makes the document of a diagnosis, and the answer to a withheld case."""

from collections.abc import Mapping
from math import isfinite

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import NAMES as PARAMETERS
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.diagnose import Diagnosis
from cusick_bench.diagnosis.document import answer as stated
from cusick_bench.diagnosis.document import model
from cusick_bench.diagnosis.document.answer import Answer
from cusick_bench.diagnosis.document.headline import headline
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.diagnosis.document.part import Interval, Map
from cusick_bench.diagnosis.document.statistic_rows import finite, statistic_rows
from cusick_bench.diagnosis.document.with_effect import bound_notes, turning_notes, turns_with_cloth, with_effect
from cusick_bench.diagnosis.inference.single_effects.equivalents import ABSORBED, EQUIVALENTS
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.gap import Gap
from cusick_bench.diagnosis.simulation.samples import Simulated
from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.sim.effects import registered
from cusick_bench.sim.effects.effect_timing import acts_later

STAGES: tuple[str, ...] = ("material", "history", "boundary", "contact", "imaging", NONE, UNKNOWN)
_LEAST = 0.005  # probability from which a cause, or a set, is listed
_LEAST_ACTING = 0.02  # probability that it acts, likewise
_MOST_OF_BASELINE = 5  # largest number of causes in a simpler method's answer


def document(
    diagnosis: Diagnosis, captures: Captures, emulator: Emulator, *, command: str, version: str
) -> DiagnosisDocument:
    """Everything about one diagnosis.

    Args:
        diagnosis: The diagnosis.
        captures: The data that were diagnosed.
        emulator: The atlas.
        command: Command that made it.
        version: Version of the code.

    Returns:
        The document.
    """
    answered = answer(diagnosis)
    return DiagnosisDocument(
        fabric=diagnosis.fabric,
        headline=headline(diagnosis),
        verdict=answered.verdict,
        effects=answered.effects,
        groups=answered.groups,
        budget=answered.budget,
        unexplained=answered.unexplained,
        gap=_gap(diagnosis),
        causes=tuple(_cause(diagnosis, name, p) for name, p in _ranked(diagnosis)),
        set90=answered.set90,
        where=_mapped_location(diagnosis),
        closure=answered.closure,
        next=answered.next,
        baselines=answered.baselines,
        sets=tuple(model.EffectSet(effects=names, probability=p) for names, p in diagnosis.sets.items() if p >= _LEAST),
        fit=model.Fit(
            base=finite(diagnosis.plain.squares / len(diagnosis.plain.white)),
            novelty_p=diagnosis.novelty.p,
            misfit=finite(diagnosis.misfit),
        ),
        with_effect=tuple(with_effect(one, captures.protocol.cloth_scale) for one in diagnosis.causes),
        base=_base(diagnosis),
        data=_counts(captures),
        statistics=statistic_rows(diagnosis),
        profiles=model.Profiles(
            data=_measured(captures),
            base=_simulated(diagnosis.simulated and diagnosis.simulated.base),
            effect=_simulated(diagnosis.simulated and diagnosis.simulated.effect),
        ),
        indistinguishable=tuple(
            model.Indistinguishable(effects=tuple(sorted(alike.effects)), why=alike.why)
            for alike in (*EQUIVALENTS, ABSORBED)
            if alike.effects.intersection(diagnosis.set90)
        ),
        notes=(
            *diagnosis.notes,
            *turning_notes(diagnosis.causes, captures.warp_seen_down),
            *bound_notes(diagnosis.causes, captures.protocol.cloth_scale),
        ),
        without=diagnosis.without,
        provenance=model.Provenance(version=version, command=command, atlas=f"{len(emulator.responses)} effects"),
    )


def refused_document(fabric: str, reason: str, *, command: str, version: str) -> DiagnosisDocument:
    """The document of a fabric about which no diagnosis can say anything.

    Args:
        fabric: Its name.
        reason: Why nothing can be said.
        command: Command that made it.
        version: Version of the code.

    Returns:
        The document.
    """
    return DiagnosisDocument(
        fabric=fabric,
        headline=f"Not diagnosed: {reason}.",
        verdict="refused",
        where=model.MappedLocation(why_not=reason),
        refused=reason,
        provenance=model.Provenance(version=version, command=command),
    ).complete()


def answer(diagnosis: Diagnosis) -> Answer:
    """The part that answers a withheld case.

    Args:
        diagnosis: The diagnosis.

    Returns:
        The answer; `without` and `refused` are left open.
    """
    gap = diagnosis.gap
    return Answer(
        verdict=diagnosis.verdict,
        effects=diagnosis.effects,
        groups=diagnosis.groups,
        budget=_budget(diagnosis),
        unexplained=_unexplained(diagnosis),
        gap=stated.StatedGap(
            base=None if gap is None else finite(gap.base),
            floor=None if gap is None else finite(gap.floor),
            p=diagnosis.p,
        ),
        causes=tuple(
            stated.StatedCause(
                effect=name,
                stage=_stage(name),
                probability=p,
                acting=_acting(diagnosis, name),
                parameters=_values(diagnosis, name),
            )
            for name, p in _ranked(diagnosis)
        ),
        set90=diagnosis.set90,
        where=_location(diagnosis),
        closure=stated.Closure(
            effect=_simulated_effects(diagnosis) if gap is not None else (),
            fraction=None if gap is None else finite(gap.closure),
            ci90=_interval(gap),
        ),
        next=tuple(
            stated.NextMeasurement(
                name=advice.measurement.name, what=advice.measurement.what, bits=advice.bits, about=advice.about
            )
            for advice in diagnosis.advice
        ),
        baselines={name: _baseline(probability) for name, probability in diagnosis.baselines.items()},
    )


def _gap(diagnosis: Diagnosis) -> model.Gap:
    gap = diagnosis.gap
    if gap is None:
        return model.Gap(base=None, floor=None, p=diagnosis.p, effect=None, groups={})
    groups = {
        name: model.GroupGap(gap=finite(value), floor=finite(gap.groups_floor[name]))
        for name, value in gap.groups.items()
    }
    return model.Gap(
        base=finite(gap.base), floor=finite(gap.floor), p=diagnosis.p, effect=finite(gap.effect), groups=groups
    )


def _interval(gap: Gap | None) -> Interval | None:
    """Interval of the closure, where there is one."""
    return None if gap is None or not isfinite(gap.closure) else gap.closure_interval


def _simulated_effects(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Causes that were simulated together: all but creep, which the gap does not see."""
    effects = (one.hypothesis.effect for one in diagnosis.causes)
    return tuple(effect.name for effect in effects if not acts_later(effect))


def _location(diagnosis: Diagnosis) -> stated.Location:
    stage = dict.fromkeys(STAGES, 0.0)
    for name, p in diagnosis.probability.items():
        stage[_stage(name) or name] += p
    place = diagnosis.place
    return stated.Location(
        stage=stage,
        map=_map(place.map),
        kind=place.kind,
        angle_deg=place.angle,
        radius_m=place.radius,
        localisable=place.localisable,
        why_not=place.why_not,
    )


def _mapped_location(diagnosis: Diagnosis) -> model.MappedLocation:
    place, resolution = diagnosis.place, None
    if place.resolution is not None:
        resolution = model.Resolution(angle_deg=place.resolution[0], radius_m=place.resolution[1])
    return model.MappedLocation(
        **dict(_location(diagnosis)),
        null_map=None if place.null_map is None else _map(place.null_map),
        null_p=place.null_p,
        resolution=resolution,
    )


def _map(table: Float[ndarray, "4 16"]) -> Map:
    return tuple(tuple(row) for row in np.round(table, 5).tolist())


def _budget(diagnosis: Diagnosis) -> tuple[stated.BudgetShare, ...]:
    """Shares of the gap, the largest first."""
    shares = {} if diagnosis.budget is None else diagnosis.budget.effects
    return tuple(
        stated.BudgetShare(effect=name, share=one.value, ci90=one.interval)
        for name, one in sorted(shares.items(), key=lambda item: -item[1].value)
    )


def _unexplained(diagnosis: Diagnosis) -> stated.Unexplained:
    if diagnosis.budget is None:
        return stated.Unexplained(share=None, ci90=None)
    left = diagnosis.budget.unexplained
    return stated.Unexplained(share=left.value, ci90=left.interval)


def _base(diagnosis: Diagnosis) -> model.BaseParameters:
    values = [finite(value) for value in diagnosis.residual.theta.tolist()]
    return model.BaseParameters(**dict(zip(PARAMETERS, values, strict=True)))


def _ranked(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Causes that are named or likely enough to be listed, with their probability, the likeliest first."""
    listed = {*diagnosis.effects, *(n for n, p in diagnosis.acting.items() if p >= _LEAST_ACTING)}
    ranked = sorted(diagnosis.probability.items(), key=lambda item: -item[1])
    return [(n, p) for n, p in ranked if p >= _LEAST or n in listed]


def _acting(diagnosis: Diagnosis, name: str) -> float | None:
    return diagnosis.acting.get(name)


def _values(diagnosis: Diagnosis, name: str) -> dict[str, float]:
    """Best parameters of an effect; directions within one turn, as the ends of their intervals begin."""
    best = diagnosis.best.get(name)
    if best is None:
        return {}
    directions = {p.name for p in best.hypothesis.effect.parameters if p.role == "direction"}
    return {key: value % best.hypothesis.turn if key in directions else value for key, value in best.value.items()}


def _cause(diagnosis: Diagnosis, name: str, probability: float) -> model.Cause:
    effect = registered().get(name)
    units = {} if effect is None else {p.name: p.unit for p in effect.parameters}
    intervals = diagnosis.intervals.get(name, {})
    return model.Cause(
        effect=name,
        stage=_stage(name),
        probability=probability,
        acting=_acting(diagnosis, name),
        parameters={
            key: model.ParameterValue(value=value, unit=units.get(key, ""), ci90=intervals.get(key))
            for key, value in _values(diagnosis, name).items()
        },
        summary="" if effect is None else effect.summary,
        named=name in diagnosis.effects,
        shared=name in diagnosis.shared,
        turns_with_cloth=name in diagnosis.best and turns_with_cloth(diagnosis.best[name]),
    )


def _stage(name: str) -> str:
    """Class of an effect; "" for `none` and `unknown`."""
    effect = registered().get(name)
    return "" if effect is None else effect.kind


def _baseline(probability: Mapping[str, float]) -> stated.Baseline:
    """Probabilities of a simpler method in the form of an answer that names one effect or none."""
    causes = tuple(
        stated.StatedCause(effect=name, stage=_stage(name), probability=round(p, 4), parameters={})
        for name, p in list(probability.items())[:_MOST_OF_BASELINE]
    )
    if not causes:
        nothing = stated.StatedCause(effect=NONE, stage="", probability=1.0, parameters={})
        return stated.Baseline(verdict="none", causes=(nothing,), set90=(NONE,))
    return stated.Baseline(verdict="effect", causes=causes, set90=(causes[0].effect,))


def _counts(captures: Captures) -> model.DataCounts:
    drapes = set(zip(captures.sample.tolist(), captures.side.tolist(), strict=True))
    return model.DataCounts(
        samples=len(np.unique(captures.sample)),
        captures=len(captures),
        up=int((captures.side == "up").sum()),
        down=int((captures.side == "down").sum()),
        later=len(captures) - len(drapes),
        areal_density_kg_m2=finite(captures.areal_density),
        cloth_radius_m=captures.protocol.cloth_radius_m,
        plate_radius_m=captures.protocol.plate_radius_m,
        gravity_m_s2=captures.protocol.gravity_m_s2,
    )


def _measured(captures: Captures) -> tuple[model.Profile, ...]:
    """Profiles of the data, as if the cloth had the radius of the simulated ones and were turned over about y."""
    scaled = np.round(captures.radii * CLOTH_RADIUS / captures.protocol.cloth_radius_m, 5)
    if captures.warp_seen_down == 0:
        down = captures.side == "down"
        scaled[down] = np.roll(scaled[down], scaled.shape[1] // 2, axis=1)
    return tuple(
        model.Profile(sample=sample, side=side, radii_m=tuple(radii))
        for sample, side, radii in zip(captures.sample.tolist(), captures.side.tolist(), scaled.tolist(), strict=True)
    )


def _simulated(simulated: Simulated | None) -> tuple[model.Profile, ...]:
    """Profiles of simulated drapes, without those that failed."""
    if simulated is None:
        return ()
    return tuple(
        model.Profile(sample=sample + 1, side=side, radii_m=tuple(np.round(simulated.radii[sample, face], 5).tolist()))
        for sample in range(len(simulated.radii))
        for face, side in enumerate(("up", "down"))
        if np.isfinite(simulated.radii[sample, face]).all()
    )
