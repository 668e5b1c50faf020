"""HTML pages from the templates in `report/templates`: one frame and one style sheet for all of them.

A page stands alone: a content security policy forbids it every request, and every script but its own, by
their hashes. Words from outside (names of solvers and cloths) cannot become code even where escaping failed.
"""

import hashlib
from base64 import b64encode
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from cusick_bench.runner.store import write_atomically

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


def render_page(template: str, *, scripts: Sequence[str] = (), **content: Any) -> str:
    """A page as HTML; text is escaped, markup (`markupsafe.Markup`) is not.

    Args:
        template: Name of a file in `report/templates`.
        scripts: Names of files in `report/templates/scripts` that the page runs, in this order.
        content: What the template asks for.

    Returns:
        The page.

    Raises:
        jinja2.UndefinedError: The template asks for something that is not there.
    """
    sources = [_script(name) for name in scripts]
    allowed = "".join(f" '{_hash(source)}'" for source in sources)
    policy = f"{_POLICY}; script-src{allowed}" if allowed else _POLICY
    frame = {"policy": policy, "scripts": [Markup(source) for source in sources]}
    return _environment().get_template(template).render(**frame, **content)


def write_html(path: Path, page: str) -> None:
    """Writes a page, whole or not at all; bytes of a path that are no text become question marks.

    Args:
        path: HTML file to write.
        page: From `render_page`.
    """
    write_atomically(path, page.encode(errors="replace"))


def _script(name: str) -> str:
    environment = _environment()
    assert environment.loader is not None
    return environment.loader.get_source(environment, f"scripts/{name}")[0]


def _hash(source: str) -> str:
    return f"sha256-{b64encode(hashlib.sha256(source.encode()).digest()).decode()}"


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cusick_bench.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
