"""Which public functions lack a part of their docstring: Args that name every argument, Returns.

python tests/support/docstrings.py [FOLDER ...]     # lists them
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

FOLDERS = ("sim", "solvers", "datasets", "cusick_bench")


def _is_property(function: ast.FunctionDef) -> bool:
    names = {getattr(d, "id", getattr(d, "attr", "")) for d in function.decorator_list}
    return bool(names & {"property", "cached_property", "setter", "overload"})


def _arguments(function: ast.FunctionDef) -> list[str]:
    found = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return [argument.arg for argument in found if argument.arg not in ("self", "cls") and argument.arg[0] != "_"]


def _returns(function: ast.FunctionDef) -> bool:
    return not (function.returns is None or ast.unparse(function.returns) in ("None", "NoReturn"))


def _functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef, bool]]:
    """Public functions and methods of public classes: qualified name, node, whether a method."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name[0] != "_":
            yield node.name, node, False
        elif isinstance(node, ast.ClassDef) and node.name[0] != "_":
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and inner.name[0] != "_" and not _is_property(inner):
                    yield f"{node.name}.{inner.name}", inner, True


def _lacks(function: ast.FunctionDef) -> str:
    text = ast.get_docstring(function) or ""
    if not text:
        return "no docstring"
    arguments = _arguments(function)
    section = re.search(r"^Args:\n((?:[ \t]+.*\n?|\n)+)", text, re.MULTILINE)
    listed = section.group(1) if section else ""
    missing = [a for a in arguments if not re.search(rf"^\s+(?:\*?\w+, )*\*?{a}(?:, \*?\w+)*( \(.*\))?:", listed, re.M)]
    if missing:
        return f"Args lacks {', '.join(missing)}"
    if arguments and _returns(function) and not re.search(r"^(Returns|Yields):$", text, re.MULTILINE):
        return "no Returns"
    return ""


def incomplete_docstrings(root: Path, folders: tuple[str, ...] = FOLDERS) -> list[str]:
    """Public functions whose docstring is incomplete.

    A method may leave its sections to the method of the same name that it overrides; commands of the command line are
    described by their options' help; private modules and kernels (compiled functions) are left out.

    Args:
        root: The checkout.
        folders: Folders below it to read.

    Returns:
        `path:line name: what is missing`, sorted.
    """
    found: list[tuple[str, str, bool, str]] = []
    complete: set[str] = set()
    paths = [path for folder in folders for path in sorted((root / folder).rglob("*.py"))]
    for path in paths:
        place = path.relative_to(root)
        if place.parts[:2] == ("cusick_bench", "cli") or any(
            (root / Path(*place.parts[:n])).is_symlink() for n in (1, 2)
        ):
            continue
        for name, function, is_method in _functions(ast.parse(path.read_text(encoding="utf-8"))):
            if any("kernel" in ast.unparse(d) for d in function.decorator_list):
                continue
            lack = _lacks(function)
            if lack:
                found.append((f"{place}:{function.lineno} {name}", function.name, is_method, lack))
            elif is_method and _arguments(function):
                complete.add(function.name)
    return [
        f"{where}: {lack}"
        for where, name, is_method, lack in found
        if not (is_method and name in complete and lack != "no docstring")
    ]


if __name__ == "__main__":
    here = Path(__file__).resolve().parents[2]
    lines = incomplete_docstrings(here, tuple(sys.argv[1:]) or FOLDERS)
    print("\n".join([*lines, f"{len(lines)} incomplete"]))
