"""Colours of figures on a page: each stands for a colour of the style sheet, which has a light and a dark mode.

Matplotlib needs fixed colours. The ones below are used for nothing else; `inline_svg` replaces each by its variable of
`templates/page.css`.
"""

from collections.abc import Mapping

INK = "#fe0001"  # text
SOFT = "#fe0002"  # axes, ticks
RULE = "#fe0003"  # grid
TINT = "#fe0004"  # plate
CARD = "#fe0005"  # what a figure lies on
REAL = "#fe0006"  # real drapes
MODEL = "#fe0007"  # simulated drapes
CAUSE = "#fe0008"  # simulated drapes with the cause of a gap
FLOOR = "#fe0009"  # floor of a gap
PALE = "#fe000a"  # model, where little is to be seen
MAP = "#fe000b"  # probability of a place
SERIES = tuple(f"#fe001{place}" for place in range(8))
"""Methods that are compared, in turn; each also has a dash, so that colour is not all that tells them apart."""

SIMULATED_DASH = (0, (5, 1.5))
"""Dash of a simulated drape beside a real one, which grey print would not tell apart."""

DASHES: tuple[str | tuple[int, tuple[float, ...]], ...] = ("-", (0, (5, 2)), (0, (1.2, 1.6)))
"""Dashes of the same methods: solid, dashed, dotted; a number that 8 is no multiple of, so that pairs differ."""

MARKS = ("", "o", "s", "^", "D", "v")
"""Marks along the lines of the same methods: none where colours and dashes tell all apart, then one for each round."""

VARIABLES: Mapping[str, str] = {
    INK: "--ink",
    SOFT: "--soft",
    RULE: "--rule",
    TINT: "--tint",
    CARD: "--card",
    REAL: "--real",
    MODEL: "--model",
    CAUSE: "--cause",
    FLOOR: "--floor",
    PALE: "--pale",
    MAP: "--map",
    **{colour: f"--series-{place}" for place, colour in enumerate(SERIES)},
}
"""Variable of the style sheet for each colour."""
