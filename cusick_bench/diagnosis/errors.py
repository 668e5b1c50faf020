"""Errors of the diagnosis."""

from cusick_bench.sim.errors import CusickError


class DiagnosisError(CusickError, ValueError):
    """Drapes cannot be diagnosed as asked: too few of them, of unequal shape, or with values that are not finite."""


class Refused(DiagnosisError):
    """A fabric that is sound data, but about which no diagnosis can say anything: the answer is `refused`."""
