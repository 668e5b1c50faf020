"""Errors that a user can correct: each states the rule, the value found, the place, and the remedy."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any


class CusickError(Exception):
    """Base of every error that bad input can cause; the command line prints it and exits with status 2."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as it is, as what workers raise is: Python would call the class again, with the message alone."""
        return _as_it_was, (type(self), self.args, vars(self))


def _as_it_was(kind: type[CusickError], args: tuple[Any, ...], state: dict[str, Any]) -> CusickError:
    error = kind.__new__(kind, *args)
    vars(error).update(state)
    return error


class SimulationError(CusickError, ValueError):
    """A drape cannot be simulated as asked (bad mesh, material or settings)."""


class BadMeshFile(SimulationError):
    """A file cannot be read as a triangle mesh.

    Args:
        where: The file.
        what: The rule that is broken and the value found.
        kind: Fixed short name of the fault, as an audit lists it.
    """

    def __init__(self, where: object, what: str, *, kind: str = "unreadable-mesh") -> None:
        super().__init__(f"{where}: {what}")
        self.where, self.what, self.kind = str(where), what, kind


class DrapeDiverged(SimulationError):
    """A drape did not converge: positions became non-finite or the solver ran out of iterations."""


class MembersDiverged(DrapeDiverged):
    """Some cloths of a batch did not converge.

    Attributes:
        members: Their places in the batch.
        steps: Steps that they took before.
    """

    def __init__(self, message: str, members: Iterable[int], steps: int = 0) -> None:
        super().__init__(message)
        self.members, self.steps = tuple(int(member) for member in members), steps


class TimeLimit(SystemExit):
    """The end of a task's time limit: a request to stop that is kept apart from a plug-in's own `sys.exit`."""


def stop_behind(error: BaseException) -> BaseException | None:
    """The request to stop (Ctrl-C, SIGTERM, the end of a time limit) that an error stands for.

    A request that arrives while a compiled kernel runs comes out of it as the cause of a SystemError. Other exceptions
    that are no errors (the end of a generator, a solver of another package that calls `sys.exit`) are no request.

    Args:
        error: What was raised.

    Returns:
        The KeyboardInterrupt or TimeLimit that it is or was caused by, None where there is none.
    """
    behind: BaseException | None = error
    while behind is not None and not isinstance(behind, KeyboardInterrupt | TimeLimit):
        behind = behind.__cause__ or behind.__context__
    return behind


def raise_stop(error: BaseException) -> None:
    """Passes on the request to stop that an error stands for; does nothing where it stands for none.

    Args:
        error: What was raised.

    Raises:
        KeyboardInterrupt, TimeLimit: It is one, or was caused by one.
    """
    stop = stop_behind(error)
    if stop is None:
        return
    if stop is error:
        raise stop
    raise stop from error


def failure_text(error: BaseException) -> str:
    """What went wrong, in a line with the kind of the error.

    Args:
        error: What was raised.

    Returns:
        Kind and message; of a `SystemExit`, whose message is a number or nothing, also where it was raised.
    """
    if not isinstance(error, SystemExit):
        return f"{type(error).__name__}: {error}"
    place, traced = "", error.__traceback__
    while traced is not None:
        place, traced = f" in {traced.tb_frame.f_code.co_filename}, line {traced.tb_lineno}", traced.tb_next
    return f"SystemExit: a solver or an effect called sys.exit({error.code!r}){place}; let it raise an error instead"


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Names the nearest choice to a name that does not exist.

    Args:
        name: What was written.
        choices: What could have been meant.

    Returns:
        A question with a space at its end, empty where nothing is near.
    """
    near = get_close_matches(name, list(choices), n=1)
    return f"did you mean {near[0]!r}? " if near else ""
