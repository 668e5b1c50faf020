"""The document of a laboratory: effects that all fabrics of a data set share."""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

from pydantic import Field

from cusick_bench.diagnosis.document.model import ParameterValue
from cusick_bench.diagnosis.document.part import Part, Probability
from cusick_bench.diagnosis.inference.findings.intervals import ParameterInterval
from cusick_bench.diagnosis.inference.laboratory.shared_effects import Laboratory, least_lead
from cusick_bench.diagnosis.inference.residuals.samples import lengths_of_atlas
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import registered

_LEAST = 0.01  # probability from which an effect is listed


class SharedCause(Part):
    """An effect that all fabrics may share.

    Attributes:
        effect: Its name.
        stage: Its class. The file's key is `class`.
        probability: That all fabrics show it, or one of its look-alikes, with one severity and direction.
        named: Whether it is taken to act in every fabric.
        parameters: Shared parameters by name.
        evidence: By fabric, ln of its likelihood with the effect over that without [nat].
        look_alikes: Effects that may act in its place, with how far the shared set with them stays behind [nat].
        in_its_place: Shared parameters of these look-alikes, by effect and name.
    """

    effect: str
    stage: str = Field(default="", validation_alias="class", serialization_alias="class")
    probability: Probability
    named: bool
    parameters: dict[str, ParameterValue]
    evidence: dict[str, float]
    look_alikes: dict[str, float] = Field(default_factory=dict)
    in_its_place: dict[str, dict[str, ParameterValue]] = Field(default_factory=dict)


class LaboratoryDocument(Part):
    """The content of `laboratory.json`.

    Attributes:
        fabrics: Fabrics that were looked at together.
        effects: Effects that they may share, the likeliest first.
        notes: What is in doubt, and what lengths are in.
    """

    fabrics: tuple[str, ...]
    effects: tuple[SharedCause, ...]
    notes: tuple[str, ...] = ()


def write_laboratory(document: LaboratoryDocument | None, folder: Path) -> None:
    """Writes `laboratory.json`, whole or not at all.

    Args:
        document: The document; None where no fabrics were looked at together, which removes that of an earlier run.
        folder: Where to; it must be there.
    """
    path = folder / "laboratory.json"
    if document is None:
        path.unlink(missing_ok=True)
    else:
        write_atomically(path, json.dumps(document.content(), allow_nan=False).encode())


def laboratory_document(found: Laboratory, captures: Mapping[str, Captures]) -> LaboratoryDocument:
    """Everything about one laboratory.

    Args:
        found: What its fabrics share.
        captures: Silhouettes of each of its fabrics.

    Returns:
        The document.
    """
    named = {one.hypothesis.name for one in found.named}
    causes = []
    for one in found.effects:
        if one.probability < _LEAST:
            continue
        causes.append(
            SharedCause(
                effect=one.name,
                stage=registered()[one.name].kind,
                probability=one.probability,
                named=one.name in named,
                parameters=_parameters(one.cause, one.intervals),
                evidence=dict(one.evidence),
                look_alikes=dict(one.look_alikes),
                in_its_place={name: _parameters(cause, {}) for name, cause in one.in_its_place.items()},
            )
        )
    own = [captures[name] for name in found.fabrics]
    notes = (*_in_doubt(found), *lengths_of_atlas(own[0].protocol), *shown_twice(own))
    return LaboratoryDocument(fabrics=found.fabrics, effects=tuple(causes), notes=notes)


def _parameters(cause: Candidate, intervals: Mapping[str, ParameterInterval]) -> dict[str, ParameterValue]:
    units = {p.name: p.unit for p in cause.hypothesis.effect.parameters}
    return {
        name: ParameterValue(value=value, unit=units[name], ci90=intervals.get(name))
        for name, value in cause.value.items()
    }


def _in_doubt(found: Laboratory) -> Iterator[str]:
    """Which named effects cannot be told from others."""
    needed = least_lead(len(found.fabrics))
    for one in found.effects:
        if one.look_alikes:
            others = ", ".join(f"{name} ({nats:.0f} nat behind)" for name, nats in one.look_alikes.items())
            yield f"{one.name} is the likeliest of several that explain the same: {others}; {needed:.0f} nat would tell"


def shown_twice(fabrics: Sequence[Captures]) -> Iterator[str]:
    """Which sets share pictures, as a named set does with the fabric that it is taken from.

    Args:
        fabrics: Silhouettes of each.

    Yields:
        A note for each two of them.
    """
    outlines = {one.fabric: {radii.tobytes() for radii in one.radii} for one in fabrics}
    for first, second in combinations(outlines, 2):
        if count := len(outlines[first] & outlines[second]):
            yield (
                f"{first} and {second} share {count} pictures: what these say of the laboratory counts twice; name one "
                "of the two with --fabric to count it once"
            )
