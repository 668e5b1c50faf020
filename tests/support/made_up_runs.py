"""Made-up cells of a run, with as much noise between seeds as one likes, for the regression check."""

import numpy as np
import pandas as pd

CLOTHS = ("a", "b", "c", "d", "e")
METRICS = ("train_mse", "test_mse")
SOLVERS = ("sampler", "noisy", "exact")
NOISE = {"sampler": 0.03, "noisy": 0.10, "exact": 0.0}  # of a metric, between seeds


def cells(seeds, generator: np.random.Generator, worse: dict[str, float] | None = None) -> pd.DataFrame:
    """A run whose solvers differ in how much seeds matter; cloths differ fivefold in difficulty."""
    rows = []
    for solver in SOLVERS:
        for place, cloth in enumerate(CLOTHS):
            for seed in seeds:
                factor = (worse or {}).get(solver, 1.0)
                values = {m: 0.01 * (1 + place) * factor * np.exp(NOISE[solver] * generator.normal()) for m in METRICS}
                rows.append({"solver": solver, "cloth": cloth, "seed": seed, "status": "done", **values})
    return pd.DataFrame(rows)


def verdicts(outcome) -> dict[tuple[str, str], str]:
    return {(finding.solver, finding.metric): finding.verdict for finding in outcome.findings}
