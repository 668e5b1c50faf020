"""Errors of the data layer: each says what is wrong, where, and what to do."""

from cusick_bench.sim.errors import CusickError


class DataError(CusickError, ValueError):
    """Data cannot be used as asked.

    Args:
        what: The rule that is broken and the value found; the whole message if nothing else is given.
        where: File (and line) concerned.
        remedy: What the user can do about it.
        kind: Fixed short name, the `kind` under which an audit lists the same fault.
    """

    def __init__(self, what: str, *, where: object = "", remedy: str = "", kind: str = "invalid-data"):
        self.what, self.where, self.remedy, self.kind = what, str(where), remedy, kind
        message = f"{where}: {what}" if str(where) else what
        super().__init__(f"{message}; {remedy}" if remedy else message)


class DataNotFound(DataError):
    """A folder or file is missing, empty or not permitted."""


class BadImage(DataError):
    """A silhouette cannot be read, or does not show one cloth on a plate."""


class BadMesh(DataError):
    """A mesh file cannot be read as a triangle mesh."""


class BadTable(DataError):
    """`fabrics.csv`, `protocol.json` or a checksum list is malformed."""
