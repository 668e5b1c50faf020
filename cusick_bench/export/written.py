"""What writers of folders share: the templates in `export/templates`, and that nothing is overwritten."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import jinja2

from cusick_bench.export.errors import ExportError


def require_new(folder: Path, what: str) -> None:
    """Makes sure that a folder is new or empty.

    Args:
        folder: Where something is to be written.
        what: What, for the message.

    Raises:
        ExportError: There is something.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ExportError(f"{what} is written into a new folder, and {folder} is there already; give another one")


def write_files(files: Mapping[Path, str | bytes]) -> list[Path]:
    """Writes the files of a new folder: all of them, or none where one cannot be written.

    Text is written as UTF-8; bytes of a path that are no UTF-8 are written as Python's escapes.

    Args:
        files: What to write, by path; folders are made.

    Returns:
        The paths.
    """
    contents = {
        path: content if isinstance(content, bytes) else content.encode(errors="backslashreplace")
        for path, content in files.items()
    }
    new = {folder for path in contents for folder in path.parents if not folder.exists()}
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except BaseException:
        with suppress(OSError):
            for path in contents:
                path.unlink(missing_ok=True)
            for folder in sorted(new, reverse=True):  # what lies in a folder comes before it
                if folder.exists():
                    folder.rmdir()
        raise
    return list(contents)


def literal(value: str | Sequence[str]) -> str:
    """Text in double quotes, as Python and YAML read it in a file of `write_files`.

    JSON's own escapes are no help: of a character such as an emoji they make two, which neither joins.

    Args:
        value: A text, or a list of them.

    Returns:
        The literal.
    """
    return json.dumps(value, ensure_ascii=False)


def fill(template: str, **content: Any) -> str:
    """A template filled in.

    Args:
        template: Name of a file in `export/templates`, without `.j2`.
        content: What it asks for; nothing is escaped, so that Python is given as Python's own literals.

    Returns:
        The text.

    Raises:
        jinja2.UndefinedError: The template asks for something that is not there.
    """
    return _environment().get_template(f"{template}.j2").render(**content)


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cusick_bench.export", "templates"),
        autoescape=False,  # Python and Markdown
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
