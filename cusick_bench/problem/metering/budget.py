"""Cost of a solver, measured by the problem and never by the solver: budget, meter, anytime trace."""

import math
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import takewhile

from cusick_bench.problem.errors import BudgetExceeded, ProblemError

# Forward-equivalents [drapes] of what a solver can ask for; an adjoint costs about as much as its forward
# pass. Draws from a fitted posterior are its prediction, not its search: counted and timed, but free.
COST = {"loss": 1, "gradient": 2, "drape": 1, "draw": 0}


@dataclass(frozen=True)
class Budget:
    """Most that a solver may spend.

    Attributes:
        forward_equivalents: Drapes, a gradient counting as two; None for no limit.
        seconds: Wall time [s]; None for no limit.
    """

    forward_equivalents: float | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        for name in ("forward_equivalents", "seconds"):
            value = getattr(self, name)
            if value is None:
                continue
            if not 0 < value < math.inf:
                raise ProblemError(
                    f"budget in {name.replace('_', ' ')} must be > 0 and finite, got {value}; leave it out for no limit"
                )
            object.__setattr__(self, name, float(value))  # 8 and 8.0 name the same cell


@dataclass(frozen=True)
class Evaluation:
    """One entry of the trace. Counts and times are totals up to and including this evaluation.

    Attributes:
        kind: "loss", "gradient", "drape" or "draw".
        digest: Fingerprint of the parameter vector.
        loss: Loss at the vector; inf where the drape failed.
        best_loss: Smallest loss so far, of the search.
        forward_equivalents: Drapes spent.
        wall_seconds: Time since the solver began, its own work included [s].
        seconds: Time of this evaluation [s].
        simulated_seconds: Simulated time of this evaluation [s].
        failure: Why the drape failed, empty where it did not.
        jumped: Whether the drape left the branch of rests that it was followed from; its gradient tells nothing of
            the jump.
    """

    kind: str
    digest: str
    loss: float
    best_loss: float
    forward_equivalents: float
    wall_seconds: float
    seconds: float
    simulated_seconds: float = 0.0
    failure: str = ""
    jumped: bool = False


def _counted(count: int, kind: str) -> str:
    return f"a {kind} costs" if count == 1 else f"{count} evaluations ({kind}) cost"


@dataclass
class Meter:
    """Counts what a problem computes and refuses what its budget does not allow.

    In forward-equivalents the budget is never exceeded. In seconds an evaluation is refused where the last
    one of its kind tells that it would end too late; one under way is not interrupted.

    Attributes:
        budget: The limits.
        trace: Every evaluation so far.
        observers: Called with each new evaluation, for progress bars.
        draws: Drapes that the prediction will take once the search is over, outside of the budget.
    """

    budget: Budget = field(default_factory=Budget)
    trace: list[Evaluation] = field(default_factory=list)
    observers: list[Callable[[Evaluation], None]] = field(default_factory=list)
    draws: int = 0
    _reserved: float = 0.0
    _owed: float = 0.0
    _running: bool = False
    _clock_zero: float = field(default_factory=time.perf_counter)

    @property
    def forward(self) -> int:
        """Drapes simulated, those of gradients included."""
        return len(self.trace)

    @property
    def gradient(self) -> int:
        """Adjoints computed."""
        return sum(evaluation.kind == "gradient" for evaluation in self.trace)

    @property
    def failed(self) -> int:
        """Evaluations whose drape failed; they are paid for like any other."""
        return sum(bool(evaluation.failure) for evaluation in self.trace)

    @property
    def jumped(self) -> int:
        """Drapes that left the branch that they were followed from."""
        return sum(evaluation.jumped for evaluation in self.trace)

    @property
    def forward_equivalents(self) -> float:
        """Drapes spent, a gradient counting as two."""
        return self.trace[-1].forward_equivalents if self.trace else 0.0

    @property
    def simulated_seconds(self) -> float:
        """Simulated time [s]."""
        return sum(evaluation.simulated_seconds for evaluation in self.trace)

    @property
    def best_loss(self) -> float:
        """Smallest loss so far; inf before the first success."""
        return self.trace[-1].best_loss if self.trace else math.inf

    @property
    def wall_seconds(self) -> float:
        """Time since the solver began [s], without pauses between solvers or between a kill and its resumption."""
        return time.perf_counter() - self._clock_zero

    @property
    def share(self) -> float:
        """How much of the work is done, of budget and prediction, in [0, 1]; NaN as long as that has no limit."""
        most, drawn = self.budget.forward_equivalents, self.drawn
        shares = [] if most is None else [self.forward_equivalents / most]
        if self.budget.seconds is not None:
            shares.append(self.wall_seconds / self.budget.seconds)
        searched = 1.0 if drawn else min(max(shares), 1.0) if shares else math.nan
        if not self.draws or math.isnan(searched):
            return searched
        if self.budget.seconds is not None:  # as many drapes as there is time for, at the speed so far
            most = self.forward_equivalents / searched if searched else None
        return min(((most or 0.0) * searched + drawn) / ((most or 0.0) + self.draws), 1.0)

    @property
    def drawn(self) -> int:
        """Drapes of the prediction so far, which end the trace."""
        return sum(1 for _ in takewhile(lambda evaluation: evaluation.kind == "draw", reversed(self.trace)))

    @contextmanager
    def running(self) -> Iterator[None]:
        """Lets the clock begin with the solver, or go on where the last evaluation left it, however old the problem is.

        Yields:
            Nothing; a solver that another one calls begins no time of its own.
        """
        called, self._running = self._running, True
        if not called:
            self._clock_zero = time.perf_counter() - (self.trace[-1].wall_seconds if self.trace else 0.0)
        try:
            yield
        finally:
            self._running = called

    @contextmanager
    def reserve(self, drapes: float) -> Iterator[None]:
        """Keeps drapes back while a solver searches, so that it can still afford its prediction.

        Their time is kept back, too, as far as it can be told; afterwards they are granted however late it is.

        Args:
            drapes: Number of forward-equivalents that are kept back.

        Yields:
            Nothing; the drapes are granted at the end of the `with` block.
        """
        self._reserved += drapes
        try:
            yield
        finally:
            self._reserved -= drapes
            self._owed = drapes

    def admit(self, kind: str, count: int = 1, *, replayed: bool | None = None) -> None:
        """Raises BudgetExceeded where so many evaluations of this kind are not affordable.

        Args:
            kind: "loss", "gradient", "drape" or "draw".
            count: Number of evaluations.
            replayed: Whether an earlier run, which is replayed, has made them: then there was time for them, and else
                there was none; None where nothing is replayed.
        """
        if refusal := self._refusal(kind, count, replayed):
            raise BudgetExceeded(refusal)
        if kind == "drape" and not self._reserved and not replayed:
            self._owed = max(self._owed - count, 0)

    def _refusal(self, kind: str, count: int, replayed: bool | None) -> str:
        """Why so many evaluations are not affordable; empty where they are."""
        cost = count * COST[kind]
        limit = self.budget.forward_equivalents
        if limit is not None and cost and self.forward_equivalents + cost + self._reserved > limit:
            return (
                f"{_counted(count, kind)} {cost} forward-equivalents, {self.forward_equivalents:g} of {limit:g} "
                f"are spent and {self._reserved:g} kept back; raise --budget to go on"
            )
        limit = self.budget.seconds
        granted = kind == "drape" and count <= self._owed and not self._reserved
        if limit is None or not cost or replayed or granted:
            return ""
        if replayed is not None:
            return f"there was no time for {count} x {kind} before the run was killed; raise --seconds to go on"
        kept_back = self._reserved * (self.trace[-1].seconds if self.trace else 0.0)
        expected = kept_back + count * next((past.seconds for past in reversed(self.trace) if past.kind == kind), 0.0)
        if self.wall_seconds + expected <= limit:
            return ""
        return (
            f"{self.wall_seconds:.1f} of {limit:g} s are spent and {count} x {kind} takes about "
            f"{expected:.1f} s; raise --seconds to go on"
        )

    def affordable(self, kind: str, most: int, *, replayed: bool | None = None) -> int:
        """How many evaluations of a kind the budget allows for.

        Args:
            kind: As in `admit`.
            most: Number that is wanted.
            replayed: As in `admit`.

        Returns:
            At most that number; 0 where not even one is affordable.
        """
        return bisect_left(range(1, most + 1), True, key=lambda count: bool(self._refusal(kind, count, replayed)))

    def record(self, evaluation: Evaluation) -> None:
        """Adds an evaluation to the trace and tells the observers.

        Args:
            evaluation: What was paid for.
        """
        self.trace.append(evaluation)
        for observer in self.observers:
            observer(evaluation)

    def replay(self, evaluation: Evaluation) -> None:
        """Records an evaluation of an earlier, killed run, and sets the clock to what it showed then.

        Args:
            evaluation: An evaluation from the journal.
        """
        self._clock_zero = time.perf_counter() - evaluation.wall_seconds
        self.record(evaluation)
