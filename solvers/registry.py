"""Names of solvers. Write `homo`, `nlopt:LN_BOBYQA`, or with options `null:random-phase,draws=100`.

A package elsewhere registers its own through an entry point in the group `cusick_bench.solvers`, whose value
is a `Solver` subclass.
"""

import ast
import math
from collections.abc import Callable
from dataclasses import MISSING, fields
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pydantic import PydanticSchemaGenerationError, TypeAdapter, ValidationError

from cusick_bench.sim.errors import did_you_mean, failure_text, raise_stop
from cusick_bench.sim.plugins import leave_out, registered_classes, why_left_out
from cusick_bench.solvers.base import KINDS, Solver, SolverError
from cusick_bench.solvers.bayesian_optimisation.baxus import Baxus
from cusick_bench.solvers.bayesian_optimisation.hesbo import Hesbo
from cusick_bench.solvers.bayesian_optimisation.rembo import Rembo
from cusick_bench.solvers.bayesian_optimisation.turbo import Turbo
from cusick_bench.solvers.bayesian_optimisation.vanilla_bo import VanillaBo
from cusick_bench.solvers.black_box.cmaes import CmaEs
from cusick_bench.solvers.black_box.nlopt_family import BENCHMARKED, nlopt_solver
from cusick_bench.solvers.black_box.sobol import Sobol
from cusick_bench.solvers.convex.equilibrium_gap import EquilibriumGap
from cusick_bench.solvers.gradient.heter import Heter
from cusick_bench.solvers.gradient.homo import Homo
from cusick_bench.solvers.reference.null import NullCopy, NullDisc, NullRandomPhase, NullRotation
from cusick_bench.solvers.reference.oracle import OracleBestOther, OracleMean, OracleRepeat
from cusick_bench.solvers.variational.bdp import Bdp
from cusick_bench.solvers.variational.bdp_field import BdpField

ENTRY_POINTS = "cusick_bench.solvers"

_BUILT_IN: tuple[type[Solver], ...] = (
    Homo,
    Heter,
    Bdp,
    BdpField,
    EquilibriumGap,
    Rembo,
    Hesbo,
    VanillaBo,
    Turbo,
    Baxus,
    CmaEs,
    Sobol,
    NullDisc,
    NullCopy,
    NullRotation,
    NullRandomPhase,
    OracleMean,
    OracleBestOther,
    OracleRepeat,
)
# Families: "prefix:" -> the solver class of what follows the colon.
_FAMILIES: dict[str, Callable[[str], type[Solver]]] = {"nlopt": nlopt_solver}


def registered() -> dict[str, type[Solver]]:
    """Every solver by name: built in, the benchmarked members of families, and those of other packages."""
    solvers = {solver.name: solver for solver in _BUILT_IN}
    solvers |= {f"nlopt:{algorithm}": nlopt_solver(algorithm) for algorithm in BENCHMARKED}
    for name, solver in registered_classes(ENTRY_POINTS, Solver, solvers).items():
        if (family := name.partition(":")[0]) in _FAMILIES:  # would stand for a member, or pass for a built-in one
            why = f"has a name of the family {family}, whose members are built in; give it another one"
            leave_out(ENTRY_POINTS, name, solver, why)
        elif solver.kind in KINDS:
            solvers[name] = solver
        else:  # would count as one without physics, which meets no effects
            why = f"must be of a kind among {', '.join(KINDS)}, got kind = {solver.kind!r:.60}; correct it"
            leave_out(ENTRY_POINTS, name, solver, why)
    return solvers


def solver_names() -> list[str]:
    """Names of all registered solvers; nothing of other packages is imported."""
    names = [solver.name for solver in _BUILT_IN] + [f"nlopt:{algorithm}" for algorithm in BENCHMARKED]
    return [*names, *(entry.name for entry in entry_points(group=ENTRY_POINTS))]


def is_built_in(text: str) -> bool:
    """Whether a solver is this package's own.

    Args:
        text: Name, with or without options.

    Returns:
        False of a solver of another package, or one that nobody knows.
    """
    name = text.partition(",")[0].strip()
    return name.partition(":")[0] in _FAMILIES or name in {solver.name for solver in _BUILT_IN}


def entry_point_of(name: str) -> EntryPoint | None:
    """Entry point by which another package registers a solver; nothing of the package is imported.

    Args:
        name: Name of the solver, without options.

    Returns:
        The entry point, whose `dist` is the package where that is known; None of a solver that is built in, or unknown.
    """
    if is_built_in(name):
        return None
    return next((entry for entry in entry_points(group=ENTRY_POINTS) if entry.name == name), None)


def solver_class(name: str) -> type[Solver]:
    """The solver of a name.

    Args:
        name: A registered name, or `FAMILY:MEMBER`.

    Returns:
        The class.

    Raises:
        SolverError: There is none; the message lists what there is, or says why one of another package cannot be used.
    """
    solvers = registered()
    if name in solvers:
        return solvers[name]
    family, _, member = name.partition(":")
    why = why_left_out(ENTRY_POINTS, name)
    if family in _FAMILIES and member:
        try:
            return _FAMILIES[family](member)
        except SolverError:
            if not why:
                raise
    if why:
        raise SolverError(f"solver {why}")
    raise SolverError(f"unknown solver {name!r}; {did_you_mean(name, solvers)}registered are {', '.join(solvers)}")


def make_solver(text: str) -> Solver:
    """Makes a solver from `name` or `name,option=value,...`.

    Args:
        text: Name and options.

    Returns:
        The solver.

    Raises:
        SolverError: The name or an option is unknown, an option is missing, or the solver refuses its options.
    """
    name, *settings = text.split(",")
    cls = solver_class(name.strip())
    known = [field.name for field in fields(cls) if not field.kw_only]
    options: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or key.strip() not in known:
            raise SolverError(
                f"{name} has no option {setting!r}; write option=value, with option one of: "
                f"{', '.join(known) or '(none)'}"
            )
        if key.strip() in options:
            raise SolverError(f"{name} has the option {key.strip()!r} twice; give it once")
        options[key.strip()] = _checked(cls, key.strip(), _literal(value.strip()))
    for option, usual in default_options(cls).items():
        if usual is MISSING and option not in options:
            raise SolverError(f"{name} needs the option {option}; write {text},{option}=VALUE")
    try:
        return cls(**options)
    except SolverError:
        raise
    except (TypeError, ValueError) as error:  # one of another package may refuse its options in its own way
        raise SolverError(f"{text}: {error}") from error
    except SystemExit as error:
        raise_stop(error)
        raise SolverError(f"{text} cannot be made: {failure_text(error)}") from error


def default_options(cls: type[Solver]) -> dict[str, Any]:
    """What a solver's options are where they are not given.

    Args:
        cls: The solver.

    Returns:
        Value by option, `dataclasses.MISSING` for one that must be given.
    """
    own = [field for field in fields(cls) if not field.kw_only]
    return {field.name: field.default if field.default_factory is MISSING else field.default_factory() for field in own}


def _checked(cls: type[Solver], option: str, value: Any) -> Any:
    """The value of an option, if it is of the type that the solver's field states."""
    kind = _type_of(cls, option)
    try:
        TypeAdapter(kind).validate_python(value, strict=True)
    except PydanticSchemaGenerationError:  # a type of another package, which its solver has to check
        return value
    except ValidationError as error:
        choices = ", ".join(map(str, get_args(kind))) if get_origin(kind) is Literal else ""
        words = f"one of {choices}" if choices else getattr(kind, "__name__", str(kind))
        raise SolverError(f"option {option} of {cls.name} must be {words}, got {str(value)[:60]!r}") from error
    if isinstance(value, float) and not math.isfinite(value):
        raise SolverError(f"option {option} of {cls.name} must be finite, got {value}")
    return value


def _type_of(cls: type[Solver], option: str) -> Any:
    """The type that a solver's field states; Any where its module imports some name for type checkers only."""
    try:
        return get_type_hints(cls)[option]
    except (NameError, AttributeError, TypeError):
        return Any


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
