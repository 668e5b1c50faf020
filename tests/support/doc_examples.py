"""Fenced examples of Markdown pages, and what runs them.

A comment before the fence says how an example is treated; without one it is run, in the page's order, in one folder:

    <!-- example: real data -->     run where the public release is, left out elsewhere
    <!-- example: parsed -->        not run, as it takes long; its commands and options must exist
    <!-- example: shown -->         no example: a fragment, or a file's content
"""

import os
import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.core import TyperGroup
from typer.main import get_command
from typer.testing import CliRunner

from cusick_bench.cli import app

LANGUAGES = ("python", "sh")
TREATMENTS = ("run", "real data", "parsed", "shown")
_FENCE = re.compile(
    r"(?:^<!-- example: (?P<treatment>[\w ]+) -->\n\n?)?^```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^```$", re.M | re.S
)


class ExampleError(AssertionError):
    """An example of a page does not work; the message says where."""


@dataclass(frozen=True)
class Example:
    """One fenced block.

    Attributes:
        page: File it stands in.
        line: Line of its fence, from 1.
        language: What follows the fence: `python`, `sh`, `json`, ...
        treatment: One of `TREATMENTS`.
        text: The block.
    """

    page: Path
    line: int
    language: str
    treatment: str
    text: str

    def commands(self) -> list[list[str]]:
        """Words of each command of a shell block; comments and prompts are left out, variables filled in."""
        lines = self.text.replace("\\\n", " ").splitlines()
        split = [shlex.split(os.path.expandvars(line), comments=True) for line in lines]
        return [words for words in split if words]


def examples(page: Path) -> list[Example]:
    """Every fenced block of a page, in order.

    Args:
        page: Markdown file.

    Returns:
        Blocks with how they are to be treated.
    """
    text = page.read_text(encoding="utf-8")
    return [
        Example(
            page,
            text[: match.start("text")].count("\n"),
            match["language"],
            match["treatment"] or "run",
            match["text"],
        )
        for match in _FENCE.finditer(text)
    ]


def run_example(example: Example, names: dict[str, Any]) -> None:
    """Runs a block in the working folder.

    Args:
        example: The block.
        names: Names that earlier Python blocks of the page have defined; those of this one are added.

    Raises:
        ExampleError: A command ends with another status than 0, or is none of this project.
    """
    if example.language == "python":
        exec(compile(example.text, f"{example.page}:{example.line}", "exec"), names)
        return
    for words in example.commands():
        if words[0] == "cusick-bench":
            result = CliRunner().invoke(app, words[1:], prog_name="cusick-bench")
            if result.exit_code:
                raise ExampleError(
                    f"{example.page}:{example.line}: {shlex.join(words)}: status {result.exit_code}\n"
                    f"{result.output}\n{result.exception!r}"
                )
        else:
            check_command(example, words)


def check_command(example: Example, words: list[str]) -> None:
    """Whether a command exists and takes the options that it is given, without running it.

    Args:
        example: The block that it stands in, for the message.
        words: The command.

    Raises:
        ExampleError: There is no such command or option.
    """
    root = Path(__file__).resolve().parents[2]
    where = f"{example.page}:{example.line}: {shlex.join(words)}"
    if words[0] == "cusick-bench":
        try:
            _parse(words[1:])
        except Exception as error:
            raise ExampleError(f"{where}: {error!r}") from error
    elif words[0] == "make":
        targets = re.findall(r"^([\w-]+):", (root / "Makefile").read_text(encoding="utf-8"), re.M)
        unknown = set(words[1:]) - set(targets)
        if unknown:
            raise ExampleError(f"{where}: no target {unknown} in the Makefile")
    elif words[:2] == ["pip", "install"]:
        extras = _extras(root)
        named = {name for word in words for match in re.findall(r"\[([\w,-]+)\]", word) for name in match.split(",")}
        if named - extras:
            raise ExampleError(f"{where}: no extra {named - extras} in pyproject.toml")
    elif words[0] == "python" and len(words) > 1 and words[1].endswith(".py"):
        if not (root / words[1]).is_file():
            raise ExampleError(f"{where}: no file {words[1]}")
    else:
        raise ExampleError(f"{where}: not a command that examples may use")


def _extras(root: Path) -> set[str]:
    document = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    return set(document["project"]["optional-dependencies"])


def _parse(words: list[str]) -> None:
    """Follows groups down to the command and has it read its options."""
    command, context, name = get_command(app), None, "cusick-bench"
    while True:
        context = command.make_context(name, list(words), parent=context)
        if not isinstance(command, TyperGroup):
            return
        name, command, words = command.resolve_command(context, [*context._protected_args, *context.args])


def pages(root: Path) -> Iterator[Path]:
    """Every page whose examples must work: README, CONTRIBUTING and what lies in docs/.

    Args:
        root: The checkout.

    Yields:
        Markdown files.
    """
    yield root / "README.md"
    if (root / "CONTRIBUTING.md").exists():
        yield root / "CONTRIBUTING.md"
    yield from sorted((root / "docs").rglob("*.md"))
