"""Matplotlib figures as SVG elements of a page: coloured by its style sheet, with a description for screen readers.

Figures are measured in pixels of the page at full width; the page scales them. The same figure with the same
description gives the same bytes.
"""

import hashlib
import io
import re
from xml.etree import ElementTree

from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from cusick_bench.report.drawing.palette import RULE, SOFT, VARIABLES

TICK_SIZE = 11.5  # height of the letters of ticks and titles of axes [px]
_DPI = 72  # matplotlib's SVG has 72 units an inch
_NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}
_COLOUR = re.compile(r"#fe00[0-9a-f]{2}")
_LONG_NUMBER = re.compile(r"-?\d+\.\d{2,}")
_FONT = re.compile(r"font-family: [^;]*; ?")
_NO_TURN = re.compile(r"rotate\(-?0 [^)]*\)")


def page_figure(width: float, height: float) -> Figure:
    """An empty figure without background.

    Args:
        width: Width of the figure [px].
        height: Height of the figure [px].

    Returns:
        The figure; 1 point is 1 pixel in it.
    """
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
    figure.patch.set_visible(False)
    return figure


def panel(figure: Figure, left: float, top: float, width: float, height: float, *, polar: bool = False) -> Axes:
    """Axes in a figure of `page_figure`, with a line below and pale lines across at the ticks of y.

    Args:
        figure: The figure.
        left: Left edge [px].
        top: Upper edge, from the top of the figure [px].
        width: Width of the axes [px].
        height: Height of the axes [px].
        polar: Whether x is an angle and y a radius.

    Returns:
        The axes.
    """
    whole_width, whole_height = figure.get_size_inches() * _DPI
    place = (left / whole_width, 1 - (top + height) / whole_height, width / whole_width, height / whole_height)
    axes = figure.add_axes(place, projection="polar" if polar else None)
    if not polar:
        axes.spines[["left", "top", "right"]].set_visible(False)
        axes.spines["bottom"].set_color(SOFT)
        axes.tick_params(colors=SOFT, labelsize=TICK_SIZE)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", color=RULE)
        axes.xaxis.label.set(color=SOFT, size=TICK_SIZE)
        axes.yaxis.label.set(color=SOFT, size=TICK_SIZE)
        axes.set_axisbelow(True)
    axes.patch.set_visible(False)
    return axes


def printable(words: str) -> str:
    """Text from outside that any font and any XML reader takes.

    Args:
        words: The text.

    Returns:
        The text with a question mark for each character that is none.
    """
    return "".join(one if one.isprintable() else "?" for one in words)


def inline_svg(figure: Figure, description: str, style: str = "") -> Markup:
    """The figure as an SVG element.

    Args:
        figure: From `page_figure`.
        description: Description for readers who cannot see the figure.
        style: Further class of the element.

    Returns:
        The element, without size: it is as wide as its place on the page.
    """
    buffer = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": description}):
        FigureCanvasSVG(figure).print_svg(buffer, metadata=_NO_METADATA)  # `savefig` would draw twice
    root = ElementTree.fromstring(buffer.getvalue())
    box = root.get("viewBox", "")
    _remove_unused(root)
    _shorten(root)
    _merge_groups(root)
    _rename_ids(root, hashlib.sha256(f"{description}{buffer.getvalue()}".encode()).hexdigest()[:8])
    root.attrib.clear()
    root.attrib.update({"class": f"graph {style}".strip(), "viewBox": box, "role": "img", "aria-label": description})
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def _remove_unused(root: ElementTree.Element) -> None:
    """Takes off namespaces, metadata, and styles that would hold for the whole page."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element.text = element.text if element.tag == "text" else None
        element.tail = None
        for name in [name for name in element.attrib if "}" in name]:
            element.set(name.rpartition("}")[2], element.attrib.pop(name))
        for child in list(element):
            if child.tag.rpartition("}")[2] in ("metadata", "style"):
                element.remove(child)


def _shorten(root: ElementTree.Element) -> None:
    """Colours of the page for those of the palette, its font, and tenths of a pixel."""
    for element in root.iter():
        for name, value in element.attrib.items():
            if name == "style":
                value = _COLOUR.sub(lambda found: f"var({VARIABLES[found[0]]})", value)
                value = _FONT.sub("", value)
            elif name in ("d", "x", "y", "width", "height", "transform"):
                value = _LONG_NUMBER.sub(lambda found: f"{float(found[0]):.1f}", _NO_TURN.sub("", value)).strip()
                value = re.sub(r"\s*\n?([A-Za-z]) ", r"\1", value).strip() if name == "d" else value
            element.set(name, value)
        if not element.get("transform"):
            element.attrib.pop("transform", None)


def _merge_groups(element: ElementTree.Element) -> None:
    """Replaces groups that say nothing of their members by the members."""
    for child in list(element):
        _merge_groups(child)
    members: list[ElementTree.Element] = []
    for child in element:
        empty = child.tag == "g" and not set(child.attrib) - {"id"}
        members += list(child) if empty else [] if child.tag == "defs" and not len(child) else [child]
    element[:] = members


def _rename_ids(root: ElementTree.Element, prefix: str) -> None:
    """Keeps the ids that something in the figure refers to, made unique on the page."""
    text = " ".join(value for element in root.iter() for name, value in element.attrib.items() if name != "id")
    used = {*re.findall(r"url\(#([^)]+)\)", text), *re.findall(r"(?:^| )#([\w-]+)", text)}
    for element in root.iter():
        if element.get("id") not in used:
            element.attrib.pop("id", None)
        for name, value in element.attrib.items():
            if name == "id":
                element.set(name, f"{prefix}-{value}")
            elif "#" in value:
                element.set(name, re.sub(r"#(?=[\w-]+\)|[\w-]+$)", f"#{prefix}-", value) if name != "style" else value)
