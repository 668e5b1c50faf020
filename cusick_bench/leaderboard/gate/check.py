"""The regression gate: has any solver become worse than in a committed baseline?

A solver has become worse in a metric if the change is both significant (paired test, Holm's correction over all solvers
and metrics at the family-wise level) and large enough to matter (the minimum effect). A solver that is missing, lacks a
cloth, or fails where it did not fail before, is worse without any test; where it failed before as well, Fisher's exact
test decides. New solvers and cloths, and failures with seeds that the baseline lacks beside shared ones, are reported,
but not judged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isinf, isnan, nan
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from cusick_bench.leaderboard.bootstrap import Estimate, cell_values, repeats
from cusick_bench.leaderboard.cells.cell_number import LEFT_OUT, split_of
from cusick_bench.leaderboard.cells.variants import values_in_words
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate.paired import Comparison, blocks, compare, holm
from cusick_bench.leaderboard.metric_name import GATED, NO_METRIC, is_metric
from cusick_bench.leaderboard.order import Direction, direction

_BLIND = "values scatter too much: hardly any change would be found"


@dataclass(frozen=True)
class Gate:
    """When a change is a regression.

    Attributes:
        metrics: Metrics to compare, of which smaller is better.
        level: Family-wise probability of a false alarm.
        minimum: Relative change below which nobody cares: .02 stands for a ratio of 1.02.
        seed: Seed of permutations and resamples.
    """

    metrics: tuple[str, ...] = GATED
    level: float = 0.05
    minimum: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.level < 0.5:
            raise LeaderboardError(f"the level must lie between 0 and 0.5, got {self.level}; 0.05 is usual")
        if not 0 <= self.minimum < 2:
            raise LeaderboardError(f"the minimum effect must lie in [0, 2), got {self.minimum}; 0.02 is two per cent")
        for metric in self.metrics:
            if direction(metric) != Direction():
                raise LeaderboardError(f"smaller is not better in {metric!r}; compare for instance {', '.join(GATED)}")


@dataclass(frozen=True)
class Finding:
    """One line of the gate's table.

    Attributes:
        solver: Solver.
        metric: Metric, or "cells" where cells are missing or failed.
        verdict: "regression", "unchanged" (no regression was found), "undecided" (too few cells, none in common, or no
            change that would be found in four of five cases) or "new".
        detail: What there is to say, "" where the numbers say it.
        before: Mean over cloths of the compared cells in the baseline.
        after: The same now.
        comparison: The paired test; None where there was none.
        p: Its p-value after Holm's correction.
    """

    solver: str
    metric: str
    verdict: str
    detail: str = ""
    before: float = nan
    after: float = nan
    comparison: Comparison | None = None
    p: float = nan

    @property
    def ratio(self) -> Estimate:
        """After / before with its 95 % interval."""
        return self.comparison.ratio if self.comparison else Estimate(nan, nan, nan)

    def record(self) -> dict[str, Any]:
        """The line, flat, for JSON."""
        test = self.comparison
        return {
            **{name: getattr(self, name) for name in ("solver", "metric", "verdict", "detail", "before", "after", "p")},
            **self.ratio.columns("ratio"),
            "test": test.test if test else "",
            "units": test.units if test else 0,
            "detectable": test.detectable if test else nan,
        }


@dataclass(frozen=True)
class Outcome:
    """Outcome of the gate.

    Attributes:
        findings: A line a solver and metric, regressions first.
        notes: Remarks for readers.
    """

    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def regressions(self) -> list[Finding]:
        """The lines for which the gate closes."""
        return [finding for finding in self.findings if finding.verdict == "regression"]

    @property
    def decided(self) -> bool:
        """Whether anything could be said of any solver: there were cells in common, and enough of them."""
        compared = any(finding.comparison and finding.verdict == "unchanged" for finding in self.findings)
        return compared or bool(self.regressions)


def check(run: pd.DataFrame, baseline: pd.DataFrame, gate: Gate | None = None) -> Outcome:
    """Compares a run with a baseline.

    Args:
        run: Cells of the run, from `read_cells`.
        baseline: Cells to compare with, from `read_cells`.
        gate: When a change is a regression.

    Returns:
        A line a solver and metric, worst first.

    Raises:
        LeaderboardError: Other data or settings than the baseline's, no metric in common, or one that only one of the
            two has measured of a cloth.
    """
    gate = gate or Gate()
    metrics = _shared_metrics(run, baseline, gate)
    _require_same_problem(run, baseline)
    for metric in metrics:
        _require_measured(run, baseline, metric)
    known, present = set(baseline["solver"]), set(run["solver"])
    findings = [_gone(solver, baseline) for solver in sorted(known - present)]
    findings += [_new(solver, run) for solver in sorted(present - known)]
    shared = sorted(known & present)
    tested: list[Finding] = []
    for solver in shared:
        findings += _cloths_lost(_of(run, solver), _of(baseline, solver), solver)
        common = _in_common(_of(run, solver), _of(baseline, solver))
        findings += _cells_new(_of(run, solver), common[0], solver)
        tested += _failures(*common, solver)
    findings += _judged([*tested, *_compared(run, baseline, shared, metrics, gate)], gate)
    order = {"regression": 0, "undecided": 1, "unchanged": 2, "new": 3}
    findings.sort(key=lambda finding: (order[finding.verdict], finding.solver, finding.metric))
    return Outcome(tuple(findings), tuple(_notes(findings, gate)))


def _of(table: pd.DataFrame, solver: str) -> pd.DataFrame:
    return table.loc[table["solver"] == solver]


def _shared_metrics(run: pd.DataFrame, baseline: pd.DataFrame, gate: Gate) -> list[str]:
    lost = [name for name in gate.metrics if name in baseline and len(baseline[name].dropna()) and name not in run]
    if lost:
        raise LeaderboardError(
            f"the run has no {lost[0]}, and the baseline has; run it again, or choose other metrics with --metric"
        )
    shared = [name for name in gate.metrics if name in run and name in baseline]
    if not shared or (gate.metrics != GATED and len(shared) < len(gate.metrics)):
        raise LeaderboardError(
            f"run and baseline must both hold {', '.join(gate.metrics)}; both hold only "
            f"{', '.join(metrics_of_both(run, baseline)) or NO_METRIC}"
        )
    return shared


def metrics_of_both(run: pd.DataFrame, baseline: pd.DataFrame) -> list[str]:
    """Metrics that two tables of cells share.

    Args:
        run: Cells of the run.
        baseline: Cells to compare with.

    Returns:
        Names of metrics.
    """
    return sorted(name for name in baseline if name in run and is_metric(name))


def _require_same_problem(run: pd.DataFrame, baseline: pd.DataFrame) -> None:
    """Numbers on other data, splits, meshes or budgets say nothing about each other."""
    for name, remedy in (
        ("protocol", "run with the baseline's split (--protocol)"),
        ("dataset_hash", "run on the data that the baseline was made on"),
        ("settings", "run with the baseline's mesh, budget and other settings (its first lines have the command)"),
    ):
        if name not in run or name not in baseline:
            continue
        for solver in sorted(set(run["solver"]) & set(baseline["solver"])):
            now, then = (set(_of(table, solver)[name].dropna()) for table in (run, baseline))
            if now and then and now != then:
                asked, got = (values_in_words(name, values) for values in (then, now))
                raise LeaderboardError(
                    f"{solver} must have the baseline's {name.replace('_', ' ')} {asked}, got {got}; "
                    f"{remedy}, or make a new one with --write"
                )
    for solver in sorted(set(run["solver"]) & set(baseline["solver"])):
        now, then = (_in_turn(_of(table, solver)) for table in (run, baseline))  # also of baselines without a protocol
        if now != then:
            words = {True: "samples that are left out in turn", False: "one split of each cloth"}
            raise LeaderboardError(
                f"{solver} must have {words[then]} as in the baseline, got {words[now]}; run with the baseline's split "
                "(--protocol), or make a new one with --write"
            )


def _in_turn(table: pd.DataFrame) -> bool:
    return LEFT_OUT in table and bool(table[LEFT_OUT].notna().any())


def _require_measured(run: pd.DataFrame, baseline: pd.DataFrame, metric: str) -> None:
    """A finished cell without a number would drop out of the comparison, and nobody would know."""
    tables = {"run": run, "baseline": baseline}
    done = {name: table.loc[table["status"] == "done"] for name, table in tables.items()}
    lacking = {name: table.loc[table[metric].isna()] for name, table in done.items()}
    measured = {name: table.loc[table[metric].notna()] for name, table in done.items()}
    for name, other in (("run", "baseline"), ("baseline", "run")):
        known = set(zip(measured[other]["solver"], measured[other]["cloth"], strict=True))
        for solver, cloth, seed in zip(*(lacking[name][column] for column in ("solver", "cloth", "seed")), strict=True):
            if (solver, cloth) in known:
                raise LeaderboardError(
                    f"{solver} on {cloth}, seed {seed}, has no {metric} in the {name}, and the {other} has one; run it "
                    "again, or choose other metrics with --metric"
                )


def _gone(solver: str, baseline: pd.DataFrame) -> Finding:
    return Finding(solver, "cells", "regression", f"gone: {len(_of(baseline, solver))} cells in the baseline, none now")


def _new(solver: str, run: pd.DataFrame) -> Finding:
    return Finding(solver, "cells", "new", f"{len(_of(run, solver))} cells, none in the baseline")


def _cloths_lost(run: pd.DataFrame, baseline: pd.DataFrame, solver: str) -> Iterator[Finding]:
    if missing := sorted(set(baseline["cloth"]) - set(run["cloth"])):
        yield Finding(solver, "cells", "regression", f"lacks {', '.join(missing)}")


def _in_common(run: pd.DataFrame, baseline: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The cells of a solver that both tables have, paired as `paired.blocks` pairs them: by cloth, split and seed; of a
    split of which they share no seed, by cloth and split; of a cloth of which they share no split, by cloth.
    """
    now, then = (list(zip(table["cloth"], repeats(table), strict=True)) for table in (run, baseline))
    cells = set(now) & set(then)
    splits = set(map(_split, now)) & set(map(_split, then))
    cloths = set(run["cloth"]) & set(baseline["cloth"])
    with_seeds, with_splits = set(map(_split, cells)), {cloth for cloth, _ in splits}

    def common(cell: tuple[str, int]) -> bool:
        if _split(cell) in with_seeds:
            return cell in cells
        return _split(cell) in splits if cell[0] in with_splits else cell[0] in cloths

    return run.loc[list(map(common, now))], baseline.loc[list(map(common, then))]


def _split(cell: tuple[str, int]) -> tuple[str, int]:
    """Cloth of a cell, and number of its split."""
    return cell[0], split_of(cell[1])


def _cells_new(run: pd.DataFrame, common: pd.DataFrame, solver: str) -> Iterator[Finding]:
    """A line for cells of cloths that the baseline lacks, and one for failures with seeds that it lacks."""
    new = run.drop(common.index)
    of_new_cloths = ~new["cloth"].isin(common["cloth"])
    cloths, seeds = new.loc[of_new_cloths], new.loc[~of_new_cloths]
    if len(cloths):
        names = ", ".join(sorted(set(cloths["cloth"])))
        yield Finding(solver, "cells", "new", f"cloths not in the baseline: {names}; {_failed_of(cloths)}")
    if "failed" in set(seeds["status"]):
        yield Finding(solver, "cells", "new", f"seeds not in the baseline; {_failed_of(seeds)}")


def _failed_of(cells: pd.DataFrame) -> str:
    return f"{list(cells['status']).count('failed')} of {len(cells)} cells failed"


def _failures(run: pd.DataFrame, baseline: pd.DataFrame, solver: str) -> Iterator[Finding]:
    """A line where cells failed; its p-value is 0 where the baseline knows no failure."""
    failed, before = (list(table["status"]).count("failed") for table in (run, baseline))
    if failed:
        table = [[failed, len(run) - failed], [before, len(baseline) - before]]
        p = float(stats.fisher_exact(table, alternative="greater").pvalue) if before else 0.0  # pyright: ignore
        detail = f"{_failed_of(run)}, {before} of {len(baseline)} in the baseline"
        yield Finding(solver, "cells", "undecided", detail, p=p)


def _compared(
    run: pd.DataFrame, baseline: pd.DataFrame, solvers: Sequence[str], metrics: Sequence[str], gate: Gate
) -> Iterator[Finding]:
    """One line a solver and metric, yet without correction for their number."""
    generator = np.random.default_rng(gate.seed)
    level = gate.level / (len(solvers) * len(metrics) or 1)
    for solver in solvers:
        for metric in metrics:
            before, after = (cell_values(_of(table, solver), metric) for table in (baseline, run))
            pairs = blocks(before, after).values()
            if not pairs:
                if before:
                    yield Finding(solver, metric, "undecided", "no cell in common")
                continue
            then, now = (
                float(np.mean([np.mean([getattr(block, side).mean() for block in cloth]) for cloth in pairs]))
                for side in ("before", "after")
            )
            comparison = compare(before, after, level=level, generator=generator)
            yield Finding(solver, metric, "undecided", "", then, now, comparison, comparison.p)


def _judged(findings: Sequence[Finding], gate: Gate) -> Iterator[Finding]:
    for finding, p in zip(findings, holm([finding.p for finding in findings]), strict=True):
        if isnan(p):
            yield replace(finding, detail=finding.detail or "one cell decides nothing")
        else:
            least, test, detail = 1 + gate.minimum, finding.comparison, finding.detail
            worse = p <= gate.level and (test is None or max(test.ratio.value, test.change) >= least)
            if worse and test is not None and test.ratio.value < least:
                detail = f"x {test.change:.3g} by the mean change; the ratio is that of a few values near 0"
            blind = not worse and test is not None and isinf(test.detectable)
            verdict = "regression" if worse else "undecided" if blind else "unchanged"
            yield replace(finding, p=p, verdict=verdict, detail=detail or (_BLIND if blind else ""))


def _notes(findings: Sequence[Finding], gate: Gate) -> Iterator[str]:
    compared = [finding for finding in findings if finding.comparison is not None]
    tests = sum(not isnan(finding.p) for finding in findings)  # Fisher's among them
    yield (
        f"A regression is a change for the worse of at least {100 * gate.minimum:g} % that is real at a family-wise "
        f"level of {100 * gate.level:g} % (Holm over {tests} tests, paired by cloth and shared seed)."
    )
    if others := [name for name in gate.metrics if name not in GATED]:
        yield (
            f"Smaller is taken to be better in {', '.join(others)}; of what is better where it is larger, such as an "
            "accuracy, compare the error."
        )
    blind = [f"{f.solver} {f.metric}" for f in compared if f.verdict == "undecided"]
    if blind:
        yield f"Too few cells to tell anything of {', '.join(blind)}: add cloths or seeds."
    weak = sorted(
        {f.solver for f in compared if f.comparison and f.comparison.detectable > 1 + max(0.05, gate.minimum)}
    )
    if weak:
        yield f"A change of 5 % could have been missed in {', '.join(weak)}: add cloths or seeds to both runs."
