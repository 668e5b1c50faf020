"""Subsets of judged cases that figures are given for: all, clear effects, each level of severity."""

import numpy as np
import pandas as pd
from jaxtyping import Bool
from numpy import ndarray

from cusick_bench.withheld.format.label import DETECTABLE, OUTSIDE, PAIR, SINGLE
from cusick_bench.withheld.scoring.measures import ALL, CLEAR, CLEAR_FROM, DISTINCT, DISTINCT_FROM, HIDDEN, LEVELS


def subsets_of(cases: pd.DataFrame) -> dict[str, Bool[ndarray, " cases"]]:
    """Which cases are in which subset: all, clear ones, each level of severity that there is or that has a goal.

    Where shifts were measured, clear ones that no other effect makes are a subset too. Single effects whose severity is
    in another unit than the levels' form a subset of their own.

    Args:
        cases: Judgements, a row a case.

    Returns:
        By name of the subset, whether each case belongs to it.
    """
    level, single = levels_of(cases), cases["kind"].to_numpy(str) == SINGLE
    known = {*filter(None, level[np.isin(cases["kind"].to_numpy(str), (SINGLE, OUTSIDE, PAIR))]), *LEVELS}
    clear = are_clear(cases)
    distinct = clear & (cases["unlike"].to_numpy(float) >= DISTINCT_FROM)
    others = single & (level == "") & (cases["level"].to_numpy(str) != "")
    return {
        ALL: np.ones(len(cases), bool),
        CLEAR: clear,
        **({DISTINCT: distinct} if distinct.any() else {}),
        **{name: level == name for name in sorted(known, key=lambda name: float(name.rstrip("x")))},
        **({HIDDEN: others} if others.any() else {}),
    }


def levels_of(cases: pd.DataFrame) -> ndarray:
    """Level of severity of every case.

    Where any case has multiples of the detectable shift, only these count: who gives typical severities beside them
    does so because the effect is not known to be detectable.

    Args:
        cases: Judgements, a row a case.

    Returns:
        The level, "" where a case has none, or one in another unit.
    """
    detectable = cases["unit"].to_numpy(str) == DETECTABLE
    return np.where(detectable | (not detectable.any()), cases["level"].to_numpy(str), "")


def unit_of_levels(cases: pd.DataFrame) -> str:
    """What levels of severity are multiples of.

    Args:
        cases: Judgements, a row a case.

    Returns:
        `DETECTABLE` or `TYPICAL`; "" where no case has a level.
    """
    units = sorted(set(cases["unit"].to_numpy(str)[levels_of(cases) != ""]))
    return units[0] if units else ""


def are_clear(cases: pd.DataFrame) -> Bool[ndarray, " cases"]:
    """Which cases have a severity of at least twice the unit of the levels.

    Args:
        cases: Judgements, a row a case.

    Returns:
        True for each such case.
    """
    return (cases["multiple"].to_numpy(float) >= CLEAR_FROM) & (levels_of(cases) != "")
