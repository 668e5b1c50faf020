"""Errors of posing and solving a problem; each says the rule, the value and the remedy."""

from cusick_bench.sim.errors import CusickError


class ProblemError(CusickError, ValueError):
    """A problem cannot be posed as asked (bad density, space, budget, loss or parameter vector)."""


class StaleJournal(ProblemError):
    """The evaluations that an earlier run has kept are of another solver, machine or problem: they feed nobody."""


class BudgetExceeded(CusickError):
    """The next evaluation would go past the budget. Solvers answer with the best they have."""
