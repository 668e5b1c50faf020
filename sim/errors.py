"""Errors a user can act on: each states the rule, the value found, where, and the remedy."""

from collections.abc import Iterable


class CusickError(Exception):
    """Base of every error that bad input can cause; the command line prints it and exits with status 2."""


class SimulationError(CusickError, ValueError):
    """A drape cannot be simulated as asked (bad mesh, material or settings)."""


class DrapeDiverged(SimulationError):
    """A drape did not converge: positions became non-finite or the solver ran out of iterations."""


class MembersDiverged(DrapeDiverged):
    """Some cloths of a batch did not converge.

    Attributes:
        members: Their places in the batch.
    """

    def __init__(self, message: str, members: Iterable[int]) -> None:
        super().__init__(message)
        self.members = tuple(int(member) for member in members)
