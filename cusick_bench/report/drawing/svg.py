"""Elements of graphs as inline SVG; the page's style sheet colours them, so that they follow its light or dark mode.

Coordinates are pixels of the page at full width, y down. Text that comes from outside is escaped here.
"""

from collections.abc import Sequence

from markupsafe import Markup, escape


def picture(parts: Sequence[str], width: float, height: float, description: str, style: str = "") -> Markup:
    """The picture.

    Args:
        parts: What it shows, already safe.
        width, height: Its size [px].
        description: What a reader who cannot see it is told.
        style: Further class.
    """
    head = f'<svg class="{f"graph {style}".strip()}" viewBox="0 0 {width:g} {height:g}" role="img" '
    return Markup(head + f'aria-label="{escape(description)}">' + "".join(parts) + "</svg>")


def label(x: float, y: float, words: str, style: str = "") -> str:
    """Text with its baseline at y."""
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>'


def upright(x: float, y: float, words: str, style: str = "") -> str:
    """Text that reads upwards, centred on y."""
    return f'<g transform="rotate(-90 {x:.1f} {y:.1f})">{label(x, y, words, f"{style} middle".strip())}</g>'


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """A straight line."""
    return f'<line class="{style}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def polyline(points: str, style: str) -> str:
    """An open line."""
    return f'<polyline class="line {style}" points="{points}"/>'


def polygon(points: str, style: str) -> str:
    """A closed outline."""
    return f'<polygon class="{style}" points="{points}"/>'
