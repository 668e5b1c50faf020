"""HTML pages from the templates in `report/templates`: one frame and one style sheet for all of them."""

from functools import lru_cache
from typing import Any

import jinja2


def render_page(template: str, **content: Any) -> str:
    """A page as HTML; text is escaped, markup (`markupsafe.Markup`) is not.

    Args:
        template: Name of a file in `report/templates`.
        content: What the template asks for.

    Returns:
        The page.

    Raises:
        jinja2.UndefinedError: The template asks for something that is not there.
    """
    return _environment().get_template(template).render(**content)


@lru_cache(maxsize=1)
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cusick_bench.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
