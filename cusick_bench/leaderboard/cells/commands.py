"""The commands that made cells, and the machines that they ran on."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

_MACHINE = ("processor", "platform", "cores")


def typed(command: str | Sequence[object]) -> str:
    """A command line as one types it, wherever the program lies.

    Args:
        command: Words of a command line, or the whole of it.

    Returns:
        Text without the program's folder; words that a shell would split are in quotes, and bytes of paths that are no
        text are question marks.
    """
    if isinstance(command, str):
        program, *rest = command.split(" ")
    else:
        program, *rest = map(str, command or [""])
        rest = list(map(shlex.quote, rest))
    name = Path(program).name
    text = " ".join(["cusick-bench" if name == "__main__.py" else name, *rest])
    return text.encode(errors="replace").decode()


def command_record(run: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """What `run.json` records of the command that asked for some cells, or of the commands that did so together.

    Args:
        run: Contents of `run.json`; earlier commands into the same folder are in its history.
        keys: Names of the cells.

    Returns:
        The record of the last command that asked for all of them. If none did, that of the last command that asked for
        any, with the command lines and the machines of all that are needed, the earliest first. The last command's
        where no record names its cells.
    """
    wanted, history = set(keys), run.get("history", [])
    records = [run, *reversed(history)]
    for record in records:
        if wanted <= set(record.get("cells", [])):
            return dict(record)
    needed: list[Mapping[str, Any]] = []
    for record in records:
        if wanted & set(record.get("cells", [])):
            needed.insert(0, record)
            wanted -= set(record["cells"])
    if not needed:
        return dict(run)
    joined = {name: "; ".join(_once(record.get(name, "") for record in needed)) for name in _MACHINE}
    return {**needed[-1], **joined, "command": "; ".join(_once(typed(record.get("command", "")) for record in needed))}


def cells_of_grid(run: Mapping[str, Any]) -> list[str]:
    """Cells of the last command's grid, of which it may have run a part.

    Args:
        run: Contents of `run.json`.

    Returns:
        Names of cells, whether there are results of them or not.
    """
    return list(run.get("grid") or run.get("cells", []))


def machine(record: Mapping[str, Any]) -> str:
    """Machine that a command ran on, as rows of tables name it.

    Args:
        record: From `command_record`.

    Returns:
        Its processor, platform and number of cores.
    """
    return " ".join(str(record.get(name, "")) for name in _MACHINE).strip()


def _once(values: Iterable[object]) -> list[str]:
    """Values as text, each once, without empty ones."""
    return [value for value in dict.fromkeys(map(str, values)) if value]
