"""The error of every reader, and that of a folder which another process holds."""

from cusick_bench.sim.errors import CusickError


class BadFile(CusickError, ValueError):
    """A file cannot be read as what it should be.

    Args:
        where: The file.
        what: The rule that is broken and the value found.
        remedy: What the user can do about it.
    """

    def __init__(self, where: object, what: str, remedy: str) -> None:
        super().__init__(f"{where}: {what}; {remedy}" if remedy else f"{where}: {what}")
        self.where, self.what, self.remedy = str(where), what, remedy


class FolderInUse(CusickError):
    """Another process is writing into a folder."""
