"""Draws docs/architecture.svg from the import contracts in pyproject.toml.

python docs/architecture_picture.py     # writes the picture anew; a test says when that is due
"""

import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"
WIDTH, MARGIN, NAMES = 1180, 16, 132  # [px] of the picture, around it, and of the column of package names
LINE, GAP, FLOOR_GAP = 30, 6, 14  # [px] height of a line of boxes, between boxes, and between floors
CHARACTER, PADDING, ARROW = 6.7, 10, 18  # [px] of a letter at 12 px, beside the letters in a box, of an arrow
STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#1d2b2a}.name{font-weight:600;font-size:13px}"
    ".floor{fill:#e3f0ee;stroke:#7aa9a3}.box{fill:#fff;stroke:#7aa9a3}.sign{fill:#5b7a76}"
    ".note{fill:#5b7a76;font-size:11px}"
)


def contracts(root: Path = ROOT) -> tuple[list[list[str]], dict[str, list[list[str]]]]:
    """Floors of the house, and of its rooms.

    Args:
        root: The checkout.

    Returns:
        Packages of each layer from top to bottom, and for each package that has layers of its own, its modules.
    """
    document = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    layered = [one for one in document["tool"]["importlinter"]["contracts"] if one["type"] == "layers"]
    split = {one["name"]: [_members(layer) for layer in one["layers"]] for one in layered}
    house = next(one for one in layered if "containers" not in one)
    rooms = {container: split[one["name"]] for one in layered for container in one.get("containers", [])}
    return split[house["name"]], rooms


def _members(layer: str) -> list[str]:
    return [member.strip().strip("()") for member in layer.replace(":", "|").split("|")]


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    mark = f' class="{kind}"' if kind else ""
    return f'<text x="{x:g}" y="{y:g}"{mark}>{escape(text)}</text>'


def _boxes(layers: list[list[str]], left: float, top: float) -> tuple[list[str], float]:
    """Boxes from the lowest layer to the highest, in lines; their drawing and the height that they take [px]."""
    drawn, x, y = [], left, top
    for number, layer in enumerate(reversed(layers)):
        words = ", ".join(layer)
        width = len(words) * CHARACTER + 2 * PADDING
        if x + ARROW + width > WIDTH - MARGIN - PADDING and x > left:
            x, y = left, y + LINE
        if number:
            drawn.append(_text(x, y + 19, "→", "sign"))
            x += ARROW
        drawn.append(f'<rect class="box" x="{x:g}" y="{y + 3:g}" width="{width:g}" height="{LINE - 6}" rx="4"/>')
        drawn.append(_text(x + PADDING, y + 19, words))
        x += width + GAP
    return drawn, y + LINE - top


def picture(root: Path = ROOT) -> str:
    """The picture as SVG.

    Args:
        root: The checkout.

    Returns:
        A floor for each layer, the highest on top; in it each package with its own layers from left (lowest) to right.
    """
    floors, rooms = contracts(root)
    drawn, y = [], float(MARGIN)
    for floor in floors:
        inside, bottom = [], y + GAP
        for package in floor:
            inside.append(_text(MARGIN + PADDING, bottom + 20, package.rsplit(".", 1)[-1], "name"))
            boxes, height = _boxes(rooms.get(package, []), MARGIN + NAMES, bottom)
            inside += boxes
            bottom += height
        height = bottom + GAP - y
        drawn.append(
            f'<rect class="floor" x="{MARGIN}" y="{y:g}" width="{WIDTH - 2 * MARGIN}" height="{height:g}" rx="6"/>'
        )
        drawn += inside
        y += height + FLOOR_GAP
    note = "Imports point down, and inside a package to the left; data flow up, and to the right."
    drawn.append(_text(MARGIN, y + 6, note, "note"))
    size = f'width="{WIDTH}" height="{y + 20:g}" viewBox="0 0 {WIDTH} {y + 20:g}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="Layers of cusick-bench">'
    return "\n".join(
        [head, f"<style>{STYLE}</style>", '<rect width="100%" height="100%" fill="#fff"/>', *drawn, "</svg>", ""]
    )


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
