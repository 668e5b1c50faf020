"""Folds touch and rest on each other instead of passing through; under law `plate` their control nets do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


class SelfContact(Effect):
    """A cloth that keeps off itself."""

    name = "self-contact"
    kind = "contact"
    summary = "folds cannot pass through each other"
    physics = (
        "Parts nearer than the thickness repel each other by a smooth barrier energy, and no step takes one through "
        "another; without friction. The drape is then a rest (mode `equilibrium`), with the extra `contact`."
    )
    reference = (
        "Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Incremental Potential Contact. ACM "
        "Transactions on Graphics 39(4), 2020, Eq. 6."
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "thickness", "m", 0.0, 5e-3, 1e-3, "assumed: two layers of an apparel cloth half a millimetre thick",
            summary="distance below which parts of the cloth repel each other",
        ),
    )  # fmt: skip
    repeatable = False  # a cloth has one thickness: that of the last one would stand

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return replace(setup, self_contact=float(value["thickness"]))
