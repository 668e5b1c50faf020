"""Drapes of a batch of cloths in arrays: which diverged, which came to rest, and the adjoint to the parameters."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.contact.barrier import SelfContact
from cusick_bench.sim.contact.drop import contact_drop
from cusick_bench.sim.contact.equilibrium import ContactRest, contact_equilibrium, contact_equilibrium_adjoint
from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.dynamics.drop_batch import drop_batch
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns, VertexUnknowns
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.descent import FALLING
from cusick_bench.sim.engine.statics.equilibrium import Equilibrium, equilibrium, equilibrium_adjoint
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.threads import alone

DROP_AT_REST = 0.05
"""Net force below which a dropped cloth counts as at rest, as a fraction of its weight."""


@dataclass(eq=False)
class Outcome:
    """Outcome of a batch, apart from the positions, with the data that the gradient needs.

    Attributes:
        system: Mesh, law and support.
        unknowns: What the system computes with, from and to vertices, faces and hinges.
        settings: How the cloths are draped.
        factor_memory: Most memory for kept factors [bytes].
        warm: Where an equilibrium starts [m], or None.
        failures, residual, iterations, halvings: As in `DrapeBatch`.
    """

    system: ClothSystem
    unknowns: VertexUnknowns | ShellUnknowns
    settings: DrapeSettings
    factor_memory: int
    warm: Float[ndarray, "members vertices 3"] | None
    failures: list[str | None] = field(init=False)
    residual: Float[ndarray, "members"] = field(init=False)
    iterations: Int[ndarray, "members"] = field(init=False)
    halvings: Int[ndarray, "members"] = field(init=False)

    @property
    def at_rest(self) -> float:
        """Residual of a cloth that counts as at rest."""
        return DROP_AT_REST if self._drops else self.settings.tolerance

    def run(self, p: Parameters, laid: ndarray, differentiate: bool) -> tuple[ndarray, "Adjoint"]:
        """Drapes the batch: positions, and the way back.

        Args:
            p: A batch of cloths.
            laid: Shapes in which they are laid down (members, vertices, 3) [m].
            differentiate: Whether to keep what gradients need.

        Returns:
            Positions [m], NaN where a cloth diverged, and the function from their gradient to that of the
            parameters, which is NaN for a cloth where theirs is not finite.
        """
        members = len(laid)
        self.failures = [None] * members
        self.residual, self.iterations = np.full(members, np.nan), np.zeros(members, np.int64)
        self.halvings = np.zeros(members, np.int64)
        own, start = self.unknowns.parameters(p), self.unknowns.configuration(laid)
        with alone():
            x, own_back = self._drop(own, start, differentiate) if self._drops else self._rest(own, start)

        def back(g_x: ndarray) -> tuple[ParameterGradient, ndarray]:
            known = np.array([bool(np.isfinite(one).all()) for one in g_x])
            own = self.unknowns.by_configuration(np.where(known[:, None, None], g_x, 0.0))
            with alone():
                found = own_back(own)
            gradient, g_initial = self.unknowns.gradient(*found)
            lost = ~known & [failure is None for failure in self.failures]
            for array in (*vars(gradient).values(), g_initial):
                array[lost] = np.nan
            return gradient, g_initial

        return self.unknowns.positions(x), back

    @property
    def _drops(self) -> bool:
        return self.settings.mode == "drop"

    def _drop(self, p: Parameters, laid: ndarray, differentiate: bool) -> tuple[ndarray, "Adjoint"]:
        memory = self.factor_memory if differentiate else None
        dropped = drop_batch(
            self.system, self.settings, p, laid, factor_memory=memory, halvings=self.settings.halvings
        )  # fmt: skip
        self.failures, self.residual = dropped.failures, dropped.residual
        self.iterations, self.halvings = dropped.iterations, dropped.halvings
        return dropped.positions, dropped.gradient

    def _rest(self, p: Parameters, laid: ndarray) -> tuple[ndarray, "Adjoint"]:
        """Lets the cloths come to rest one by one: from where they fell, which decides their folds, or a warm start."""
        s, system = self.settings, self.system
        touching = s.self_contact > 0
        mu = FALLING if self.warm is None else 0.0
        search = _TouchingSearch(system, s) if touching else _FreeSearch(system, s, mu, self.warm is None)
        if self.warm is not None:
            starts: ndarray | None = self.unknowns.configuration(self.warm).copy()
            starts[:, system.fixed] = laid[:, system.fixed]
        else:
            starts = None if touching else self._fallen(p, laid)
        positions = np.full_like(laid, np.nan)
        rests: dict[int, Any] = {}
        for member in range(len(laid)):
            try:
                rest = search.rest(p.member(member), laid[member], None if starts is None else starts[member])
            except DrapeDiverged as error:
                self.failures[member] = str(error)
                continue
            self.iterations[member] = rest.iterations
            if rest.converged:
                rests[member], positions[member], self.residual[member] = rest, rest.positions, rest.residual
            else:
                otherwise = "" if touching else ", or use mode 'drop'"
                self.failures[member] = (
                    f"the drape did not come to rest: net force {rest.residual:.2g} of the weight after "
                    f"{rest.iterations} Newton steps (tolerance {s.tolerance:g}); raise `iterations`{otherwise}"
                )

        def back(g_x: ndarray) -> tuple[ParameterGradient, ndarray]:
            gradient, g_initial = system.zero_gradient(len(laid)), np.zeros_like(g_x)
            for member, rest in rests.items():
                found, g_initial[member] = search.adjoint(p.member(member), rest, g_x[member])
                gradient.put(member, found)
            return gradient, g_initial

        return positions, back

    def _fallen(self, p: Parameters, laid: ndarray) -> ndarray:
        """Positions after the drop; a cloth that flew apart starts as laid down, from where the descent is safe."""
        fallen = drop_batch(self.system, self.settings, p, laid, factor_memory=None, halvings=0)
        blown = np.array([failure is not None for failure in fallen.failures])
        return np.where(blown[:, None, None], laid, fallen.positions)


@dataclass(frozen=True, eq=False)
class _FreeSearch:
    """Rests of cloths that may pass through themselves."""

    system: ClothSystem
    settings: DrapeSettings
    mu: float
    again: bool

    def rest(self, p: Parameters, laid: ndarray, start: ndarray | None) -> Equilibrium:
        """The rest; where `again`, and there is none to be found from where the cloth fell, descends as it was laid."""
        try:
            found = self._from(laid if start is None else start, p, laid)
            if found.converged or not self.again:
                return found
        except DrapeDiverged:
            if not self.again:
                raise
        return self._from(laid, p, laid)

    def _from(self, start: ndarray, p: Parameters, laid: ndarray) -> Equilibrium:
        s = self.settings
        return equilibrium(self.system, p, start, laid, tolerance=s.tolerance, iterations=s.iterations, mu=self.mu)

    def adjoint(self, p: Parameters, rest: Equilibrium, g_x: ndarray) -> tuple[ParameterGradient, ndarray]:
        return equilibrium_adjoint(self.system, p, rest, g_x)


@dataclass(frozen=True, eq=False)
class _TouchingSearch:
    """Rests of cloths that keep off themselves; they also fall so, for a rest that is free of crossings."""

    system: ClothSystem
    settings: DrapeSettings

    @cached_property
    def contact(self) -> SelfContact:
        return SelfContact(self.system.mesh, self.settings.self_contact)

    def rest(self, p: Parameters, laid: ndarray, start: ndarray | None) -> ContactRest:
        s = self.settings
        if start is None:
            try:
                start = contact_drop(self.system, p, laid, self.contact, steps=s.steps, step_seconds=s.step_seconds)
            except DrapeDiverged:
                start = None  # descends from the laid-down shape instead
        return contact_equilibrium(
            self.system, p, laid, self.contact, tolerance=s.tolerance, iterations=s.iterations, start=start
        )

    def adjoint(self, p: Parameters, rest: ContactRest, g_x: ndarray) -> tuple[ParameterGradient, ndarray]:
        return contact_equilibrium_adjoint(self.system, p, rest, g_x)


Adjoint = Callable[[ndarray], tuple[ParameterGradient, ndarray]]
"""From the derivative to the positions to those to parameters and initial shape."""
