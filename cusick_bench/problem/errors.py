"""Errors of posing and solving a problem; each says the rule, the value and the remedy."""

from cusick_bench.sim.errors import CusickError


class ProblemError(CusickError, ValueError):
    """A problem cannot be posed as asked (bad density, space, budget, loss or parameter vector)."""


class StaleJournal(ProblemError):
    """Evaluations kept by an earlier run are of another solver, machine or problem, and cannot be used."""


class BudgetExceeded(CusickError):
    """The next evaluation would go past the budget. Solvers answer with the best they have."""
