"""Errors of the leaderboard."""

from cusick_bench.sim.errors import CusickError


class LeaderboardError(CusickError, ValueError):
    """A results folder cannot be ranked: it is missing, empty, or nothing in it is finished."""
