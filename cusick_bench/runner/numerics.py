"""Versions of the numerics: they identify the code that decided a number, part by part, independently of its source.

Each part of the code states its own version: `NUMERICS_VERSION` in a law's file or a package's `__init__`, `version` of
a solver. A change of a part's numbers raises its version by 1. Results with other versions are then computed again; an
edit that changes no number, such as of a comment or a file's name, leaves finished work valid. A cell depends only on
the versions of the parts that it uses.

`tests/golden/numerics.json` holds numbers of every part and version, and a test fails where numbers change without a
new version. After raising a version: `python tests/support/golden.py --write`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cusick_bench import datasets, metrics, problem
from cusick_bench.datasets.files import hanging_line
from cusick_bench.problem import followed_branch
from cusick_bench.problem.spaces import DEFAULT_SPACE, SPACES
from cusick_bench.sim import contact, effects, engine, render
from cusick_bench.sim.cloth import membrane
from cusick_bench.sim.effects.base import Effect
from cusick_bench.sim.effects.registry import is_built_in, parse, registered
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.laws import paper, plate, published
from cusick_bench.solvers.base import Solver

if TYPE_CHECKING:
    from cusick_bench.problem.space import ParameterSpace

LAWS = {"plate": plate.NUMERICS_VERSION, "paper": paper.NUMERICS_VERSION, "published": published.NUMERICS_VERSION}
"""Version of each material law, by its name in `DrapeSettings`."""


def drape_numerics(law: str, *, with_contact: bool = False, with_effects: bool = False) -> dict[str, int]:
    """Versions of what makes a drape and its silhouette.

    Args:
        law: Name of the material law.
        with_contact: Whether the cloth keeps off itself.
        with_effects: Whether anything is simulated that the base model leaves out.

    Returns:
        Version of each part, by name.
    """
    versions = {"engine": engine.NUMERICS_VERSION, f"law {law}": LAWS[law], "renderer": render.NUMERICS_VERSION}
    if with_contact or with_effects:
        versions["contact"] = contact.NUMERICS_VERSION
    if with_effects:
        versions["effects"] = effects.NUMERICS_VERSION
    return versions


BOTH_FACES = 1
"""Version of the procedure of cells that train on both faces of a cloth."""
SPRINGS = 1
"""Version of which vertices springs hold; cells without it also held some on the plate's edge."""
REST_SHAPE = 1
"""Version of where a random rest shape lies on a cloth with effects; cells without it had it about the plate's axis."""
REPEATS = 1
"""Version of the scores of held-out samples with several captures."""
SERIES = 1
"""Version of effects in a later picture of a series over time; cells without it took it for the first one."""


def cell_numerics(
    solver: Solver,
    drape: DrapeSettings,
    causes: tuple[str, ...] = (),
    *,
    space: str = DEFAULT_SPACE,
    both_faces: bool = False,
    repeats: bool = False,
    series: bool = False,
    pinhole: bool = False,
) -> dict[str, int]:
    """Versions of what decides a cell's numbers.

    Args:
        solver: Who answers; one without physics does not depend on the simulator.
        drape: How the problem's drapes are simulated.
        causes: What is simulated that the base model leaves out.
        space: Name of the parameter space, for solvers that have no space of their own.
        both_faces: Whether samples of both faces train.
        repeats: Whether a held-out sample was captured several times.
        series: Whether the picture that is fitted is a later one of a series over time.
        pinhole: Whether the camera was so near that radii are corrected for perspective.

    Returns:
        Version of each part, by name.
    """
    versions = {
        "datasets": datasets.NUMERICS_VERSION,
        "metrics": metrics.NUMERICS_VERSION,
        f"solver {solver.name}": solver.version,
    }
    if solver.kind == "solver":
        with_contact, with_effects = drape.self_contact > 0, bool(causes)
        versions |= drape_numerics(drape.law, with_contact=with_contact, with_effects=with_effects)
        if drape.support == "springs":
            versions["springs"] = SPRINGS
        if with_effects and drape.rest_amplitude > 0:
            versions["rest shape"] = REST_SHAPE
        if with_effects and series:
            versions["series"] = SERIES
        if drape.softens_membrane:
            versions["membrane"] = membrane.NUMERICS_VERSION
        versions["problem"] = problem.NUMERICS_VERSION
        versions |= raised_versions("space", [SPACES[solver.space or space]])
        if sought_at_rest(drape, causes):
            versions["branch"] = followed_branch.NUMERICS_VERSION
        versions |= raised_versions("effect", [parse(cause).effect for cause in causes])
    if both_faces:
        versions["both faces"] = BOTH_FACES
    if repeats:
        versions["repeats"] = REPEATS
    if pinhole:
        versions["perspective"] = hanging_line.NUMERICS_VERSION
    return dict(sorted(versions.items()))


def sought_at_rest(drape: DrapeSettings, causes: Iterable[str] = ()) -> bool:
    """Whether drapes are equilibria instead of a drop's end.

    Args:
        drape: How they are simulated.
        causes: What is simulated that the base model leaves out.

    Returns:
        True in mode `equilibrium`, and with self-contact, which is known at rest only.
    """
    return drape.mode == "equilibrium" or any(parse(cause).effect.kind == "contact" for cause in causes)


def diagnosis_numerics(**above: int) -> dict[str, int]:
    """Versions of what a diagnosis is made of.

    Args:
        above: Versions of parts that this package cannot know, by name: `diagnosis`, `withheld`.

    Returns:
        Version of each part, by name.
    """
    versions = {"datasets": datasets.NUMERICS_VERSION, "metrics": metrics.NUMERICS_VERSION, **above}
    for law in ("paper", "plate"):  # of an atlas' cheaper drapes, and of the base model
        versions |= drape_numerics(law, with_effects=True)
    known = registered().values()
    versions |= {f"effect {one.name}": one.version for one in known if not is_built_in(one)}  # which may be here or not
    return dict(sorted((versions | raised_versions("effect", known)).items()))


def raised_versions(kind: str, parts: Iterable[Effect | type[ParameterSpace]]) -> dict[str, int]:
    """Versions of effects or of parameter spaces; records omit version 1.

    Args:
        kind: What they are: "effect" or "space".
        parts: The effects or spaces.

    Returns:
        Version of each whose version is above 1, by the part's name.
    """
    return {f"{kind} {one.name}": one.version for one in parts if one.version > 1}
