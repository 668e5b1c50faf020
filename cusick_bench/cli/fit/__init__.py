"""Commands that run solvers."""
