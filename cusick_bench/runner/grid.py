"""The grid to run: solver x cloth x seed, each cell named by the hash of all that decides its numbers."""

import hashlib
import json
import logging
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.splits import Split
from cusick_bench.files.first_names import first_names
from cusick_bench.files.json_text import json_text
from cusick_bench.problem import LOSSES, Budget, ProblemError, canonical, parse_causes
from cusick_bench.problem.spaces import DEFAULT_SPACE, SPACES
from cusick_bench.runner.errors import RunnerError
from cusick_bench.runner.labels import labelled, unspaced
from cusick_bench.runner.numerics import cell_numerics, sought_at_rest
from cusick_bench.runner.samples import place_in_order, seen_of_samples
from cusick_bench.sim.constants import VERTICES_OF_PAPER
from cusick_bench.sim.effects.effect_timing import acts_later
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.solvers.base import Solver
from cusick_bench.solvers.registry import make_solver

_log = logging.getLogger(__name__)

CAMERAS = ("protocol", "parallel", "pinhole")
RENDERERS = ("coverage", "soft")
LAYINGS = ("image", "random")


@dataclass(frozen=True)
class ProblemSettings:
    """Everything about the problem that is not the cloth.

    Attributes:
        space: Parameter space.
        vertices: Number of vertices of the disc mesh.
        drape: Simulator settings; its seed is replaced by the cell's.
        camera: "protocol" (what the data say), "parallel", or "pinhole" (the published scripts' where the data's own
            is parallel).
        renderer: "coverage" or "soft".
        loss: What is minimised on the training image.
        laying: "image" lays the cloth with the folds that the training image shows, "random" by the seed alone.
        budget: Most a solver may spend.
        causes: What the base model leaves out and the problem's simulator does not, as `plate-tilt:angle=2`; kept with
            all parameters.
    """

    space: str = DEFAULT_SPACE
    vertices: int = VERTICES_OF_PAPER
    drape: DrapeSettings = field(default_factory=DrapeSettings)
    camera: str = "protocol"
    renderer: str = "coverage"
    loss: str = "mse"
    laying: str = "image"
    budget: Budget = field(default_factory=Budget)
    causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "causes", tuple(canonical(text) for text in self.causes))
        parse_causes(self.causes)  # refuses what cannot act together
        for name, value, options in (
            ("space", self.space, SPACES),
            ("camera", self.camera, CAMERAS),
            ("renderer", self.renderer, RENDERERS),
            ("loss", self.loss, LOSSES),
            ("laying", self.laying, LAYINGS),
        ):
            if value not in options:
                raise ProblemError(f"unknown {name} {value!r}; use one of {', '.join(options)}")

    def record(self) -> dict[str, Any]:
        """The settings as a document.

        Causes, clamp, membrane and pace are in it only where there are causes, where the clamp is mended, where the
        membrane is softened and where drops are brisk: cells without are named as before there was a choice.
        """
        drape = {name: value for name, value in asdict(self.drape).items() if name not in ("clamp", "membrane", "pace")}
        chosen = {"clamp": "half"} if self.drape.half_hinges else {}
        chosen |= {"membrane": "softened"} if self.drape.softens_membrane else {}
        chosen |= {"pace": self.drape.pace} if self.drape.pace != "steady" else {}
        record: dict[str, Any] = asdict(self) | {"drape": drape | chosen, "causes": list(self.causes)}
        return record if self.causes else {name: value for name, value in record.items() if name != "causes"}

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> "ProblemSettings":
        """Settings that a document describes: the clamp was whole and the membrane as given where it names neither.

        Args:
            record: As `record` gives it.

        Returns:
            The settings.

        Raises:
            KeyError, TypeError: It describes none.
        """
        named = dict(record["drape"])
        mended, softened = named.pop("clamp", "whole") == "half", named.pop("membrane", "given") == "softened"
        drape = DrapeSettings(**named)
        if drape.half_hinges and not mended:
            drape = replace(drape, clamp="whole")
        if drape.softens_membrane and not softened:
            drape = replace(drape, membrane="given")
        return cls(**record | {"drape": drape, "budget": Budget(**record["budget"])})


@dataclass(frozen=True)
class Cell:
    """One solver on one cloth with one seed.

    Attributes:
        solver: Registered name, with options.
        cloth: Cloth.
        seed: Seed of the solver's generator and of the laid-down shape.
        train: Index rows of the training samples.
        test: Index rows of the held-out samples.
        settings: The problem's settings.
        dataset: Name of the data set.
        dataset_hash: Content hash of the files in use.
        protocol: How the samples were split.
        numerics: Version of each part of the code that decides the numbers (`cell_numerics`).
        nominal: In what the protocol of the data is unlike the release's (`Protocol.unlike_release`), as JSON.
    """

    solver: str
    cloth: str
    seed: int
    train: tuple[int, ...]
    test: tuple[int, ...]
    settings: ProblemSettings
    dataset: str
    dataset_hash: str
    protocol: str
    numerics: tuple[tuple[str, int], ...]
    nominal: str = ""

    def problem_hash(self) -> str:
        """Fingerprint of the problem, whoever solves it."""
        record = {"dataset": self.dataset_hash, "cloth": self.cloth, "train": self.train, "test": self.test}
        return record_key(record | {"settings": self.settings.record()})

    def record(self) -> dict[str, Any]:
        """Contents of `cell.json`; the cell's key is their hash."""
        solver = make_solver(self.solver)
        record = {
            "solver": self.solver,
            "kind": solver.kind,
            "solver_options": {name: _written(value) for name, value in solver.options.items()},
            "cloth": self.cloth,
            "seed": self.seed,
            "space": self.settings.space,
            "vertices": self.settings.vertices,
            "dataset": self.dataset,
            "dataset_hash": self.dataset_hash,
            "problem_hash": self.problem_hash(),
            "protocol": self.protocol,
            "train": list(self.train),
            "test": list(self.test),
            "settings": self.settings.record(),
            "budget": asdict(self.settings.budget),
            "numerics": dict(self.numerics),
        }
        # Only where there is anything to say: cells on the release's protocol keep their names.
        return record | ({"nominal": json.loads(self.nominal)} if self.nominal else {})

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> "Cell":
        """The cell that a `cell.json` describes.

        Args:
            record: Its contents.

        Returns:
            The cell.

        Raises:
            RunnerError: It describes none.
        """
        names = ("solver", "cloth", "seed", "dataset", "dataset_hash", "protocol")
        try:
            return cls(
                **{name: record[name] for name in names},
                train=tuple(record["train"]),
                test=tuple(record["test"]),
                settings=ProblemSettings.from_record(record["settings"]),
                numerics=tuple(record.get("numerics", {}).items()),  # none in cells of before these had versions
                nominal=json.dumps(record["nominal"], sort_keys=True) if "nominal" in record else "",
            )
        except (KeyError, TypeError) as error:
            raise RunnerError(f"cell.json is of another version of this program: {error!r}") from error

    @property
    def label(self) -> str:
        """Solver and causes, as leaderboards name them."""
        return labelled(self.solver, self.settings.causes)

    @cached_property
    def key(self) -> str:
        """Name of the cell's folder."""
        return record_key(self.record())


def _written(option: Any) -> Any:
    """A solver's option as `cell.json` has it, whose hash is to be the cell's key; as text what JSON has not."""
    if isinstance(option, float) and not math.isfinite(option):
        return str(option)
    try:
        return json.loads(json_text(option))
    except (TypeError, ValueError):
        return str(option)


def record_key(record: dict[str, Any]) -> str:
    """Name of a cell's folder: a hash of all that decides its numbers.

    Args:
        record: Contents of `cell.json`.

    Returns:
        20 hexadecimal digits.
    """
    return hashlib.sha256(json.dumps(record, sort_keys=True, default=str).encode()).hexdigest()[:20]


def plan(
    dataset: DrapeDataset,
    *,
    solvers: list[str],
    cloths: list[str] | None = None,
    seeds: list[int] | None = None,
    settings: ProblemSettings | None = None,
    protocol: str = "paper",
    splits: Sequence[Split] | None = None,
) -> list[Cell]:
    """Lays out the grid and checks what can be checked before anything is simulated.

    Args:
        dataset: The data set.
        solvers: Registered names, with options; one that means the same as one before it is passed over.
        cloths: Cloths of the data set, all by default.
        seeds: Seeds, only 0 by default.
        settings: The problem's settings; a solver that is about one parameter space gets that one.
        protocol: How to split each cloth's samples.
        splits: The splits themselves, where they are none of the data set's protocols; `protocol` is then their name,
            and `cloths` is not looked at.

    Returns:
        Cells, cloth by cloth.

    Raises:
        CusickError: An unknown solver or cloth, no solver, one that knows no effects where some are asked for or not
            the law, a setting that would change nothing, or a cloth to be simulated has no areal density.
    """
    if not solvers:
        raise RunnerError("no solver given; see `cusick-bench solvers` for what there is")
    made = _made(solvers)
    asked, unlike = settings or ProblemSettings(), dataset.protocol.unlike_release()
    if asked.camera == "protocol":
        asked = replace(asked, camera=dataset.protocol.projection)
    meshed = [text for text, solver in made.items() if solver.needs_mesh]
    if asked.causes and meshed:
        raise RunnerError(f"{meshed[0]} balances forces without draping, so it knows no effects; run it without")
    posed = {text: _settings_for(solver, asked) for text, solver in made.items()}
    for text, own in posed.items():
        _require_effective(text, made[text], own)
    if asked.drape.law == "plate" and meshed:
        raise RunnerError(
            f"{meshed[0]} balances forces of faces and hinges at vertices, and law plate has none there; run it with "
            "--law paper, whose tables mean the same stiffness"
        )
    cells, idle = [], defaultdict[str, list[str]](list)
    for split in dataset.split(protocol, cloths) if splits is None else splits:
        seen = seen_of_samples(dataset, split.train, split.test)
        for text, solver in made.items():
            own = posed[text]
            if own.causes and seen["both_faces"] and solver.learns_both_faces:
                raise RunnerError(
                    f"{text} learns from both faces of {split.cloth}, but effects are simulated for the face of the "
                    "first sample only; run it without --with-effect, or with --protocol paper"
                )
            for name in _idle(dataset, split, own):
                idle[name].append(split.cloth)
            numerics = cell_numerics(solver, own.drape, own.causes, space=own.space, **seen)
            cells += [
                Cell(
                    solver=text,
                    cloth=split.cloth,
                    seed=seed,
                    train=tuple(split.train),
                    test=tuple(split.test),
                    settings=own,
                    dataset=dataset.name,
                    dataset_hash=dataset.content_hash,
                    protocol=protocol,
                    numerics=tuple(numerics.items()),
                    nominal=json.dumps(unlike, sort_keys=True) if unlike else "",
                )
                for seed in seeds or [0]
            ]
    for cell in cells:
        if made[cell.solver].kind == "solver":
            dataset.require_density(cell.train[0])
    for name, where in idle.items():
        _log.warning(
            "effect %s acts in later pictures of a drape only, but the picture of %s that is fitted is the first one: "
            "it changes nothing there; leave it out",
            name, first_names(list(dict.fromkeys(where))),
        )  # fmt: skip
    return cells


def _idle(dataset: DrapeDataset, split: Split, own: ProblemSettings) -> list[str]:
    """Names of the effects that leave the picture that is fitted as it is, since no earlier one lies before it."""
    if not own.causes or place_in_order(dataset, split.train[0])[1]:
        return []
    return [cause.effect.name for cause in parse_causes(own.causes) if acts_later(cause.effect, own.drape)]


def _made(solvers: Iterable[str]) -> dict[str, Solver]:
    """Solvers by their text, each once, in whatever order its options stand and whichever defaults it names."""
    made: dict[str, Solver] = {}
    for text in solvers:
        solver = make_solver(text)
        if not any(type(solver) is type(one) and solver.options == one.options for one in made.values()):
            made[unspaced(text)] = solver
            if solver.remark:
                _log.warning("%s: %s", text, solver.remark)
    return made


def _settings_for(solver: Solver, asked: ProblemSettings) -> ProblemSettings:
    """The settings in a solver's own parameter space; a solver that does not simulate meets no effects."""
    causes = asked.causes if solver.kind == "solver" else ()
    return replace(asked, space=solver.space or asked.space, causes=causes)


def _require_effective(text: str, solver: Solver, own: ProblemSettings) -> None:
    """Refuses settings that would be part of a cell's name and change nothing in it."""
    if solver.kind != "solver":
        return
    if own.laying != LAYINGS[0] and SPACES[own.space].lays_down:
        raise RunnerError(
            f"laying must be {LAYINGS[0]} in the space {own.space}, whose parameters say how the cloth is laid down, "
            f"got {own.laying}; run {text} without --laying"
        )
    if solver.pace_of_draws != "steady" and sought_at_rest(own.drape, own.causes):
        why = "mode equilibrium" if own.drape.mode == "equilibrium" else "self-contact, which is known at rest only"
        raise RunnerError(f"pace {solver.pace_of_draws} is for drops, got {why}; run {text} with pace=steady")


def require_space(solvers: Iterable[str], space: str) -> None:
    """Makes sure that solvers can be asked to work in a parameter space.

    Args:
        solvers: Registered names, with options.
        space: Name of the space.

    Raises:
        CusickError: An unknown space or solver, or a solver that is about another space.
    """
    if space not in SPACES:
        raise ProblemError(f"unknown space {space!r}; use one of {', '.join(SPACES)}")
    for text in solvers:
        own = make_solver(text).space
        if own not in (None, space):
            raise RunnerError(
                f"{text} works in the space {own} only, not in {space}; run it without a space, or give {space} to "
                "solvers that work in any; see `cusick-bench solvers`"
            )


def shard(cells: list[Cell], text: str) -> list[Cell]:
    """Every n-th cell, starting from the i-th, for `i/n` with 1 <= i <= n.

    Args:
        cells: The whole grid.
        text: Such as `1/4`.

    Returns:
        The cells of this shard.

    Raises:
        RunnerError: The text is no such fraction.
    """
    index, slash, count = text.partition("/")
    digits = all(re.fullmatch(r"\d{1,9}", part, re.ASCII) for part in (index, count))
    if not (slash and digits and 1 <= int(index) <= int(count)):
        raise RunnerError(f"--shard takes i/n with 1 <= i <= n < 10^9, such as 1/4; got {text[:60]!r}")
    return cells[int(index) - 1 :: int(count)]
