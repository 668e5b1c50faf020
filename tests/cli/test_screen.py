"""Printed text and tables: harmless, whole, in the encoding of the terminal."""

import io
import re

import pytest
from rich.table import Table
from rich.text import Text

from cusick_bench.cli.screen import Screen, harmless, in_encoding

NUMBERS = ("0.0123", "1.2e-05", "0.1234 ± 0.0021", "12.5 mm", "30 %", ".0529 [.0511, .0547]")
HOSTILE = "[bold]red[/bold] \x1b[2J\x1b]0;owned\x07 \u202egnp.exe :smile:"
SEEN = r"[bold]red[/bold] \x1b[2J\x1b]0;owned\x07 \u202egnp.exe :smile:"


class Ascii(io.StringIO):
    """A file that says that it takes ASCII alone."""

    encoding = "ascii"


def printed(*objects, file: io.StringIO | None = None, **options) -> str:
    written = file or io.StringIO()
    Screen(file=written).print(*objects, **options)
    return written.getvalue()


def table() -> Table:
    made = Table("cloth", "solver", *(f"heading of number {place}" for place in range(len(NUMBERS))), title="a title")
    made.add_row("cotton blue", "null:random-phase,draws=1000", *NUMBERS)
    made.add_row("viscose", "a solver whose summary has many words", *NUMBERS[::-1], style="red")
    return made


def words(text: str) -> str:
    return " ".join(re.sub(r"[│┃|]", " ", text).split())


def test_text_is_taken_at_its_word():
    assert printed(HOSTILE).rstrip("\n") == SEEN
    assert printed(Text(HOSTILE)).rstrip("\n") == SEEN.replace(r"\x07", "")  # rich itself takes the bell away


def test_cells_are_taken_at_their_word():
    made = Table("Hausdorff [mm]", title="[i]title[/i]")
    made.add_row(HOSTILE)
    text = printed(made)
    assert SEEN in text
    assert "Hausdorff [mm]" in text
    assert "[i]title[/i]" in text
    assert len({len(line) for line in text.splitlines()[1:]}) == 1  # the frame is straight


@pytest.mark.parametrize(
    "character", ["\x00", "\x1b", "\x7f", "\x9b", "\r", "\b", "\u200b", "\u2066", "\ufeff", "\udce9"]
)
def test_characters_that_steer_a_terminal_are_written_out(character):
    assert harmless(f"a{character}b") == f"a{character.encode('unicode_escape').decode()}b"
    printed(f"a{character}b").encode()  # a byte that is no text can be printed


def test_words_of_any_language_stay():
    text = "Baumwolle, größer; хлопок; 木綿\tand a\nsecond line"
    assert harmless(text) == text


def test_without_a_terminal_a_table_has_its_natural_width(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    text = printed(table())
    assert "…" not in text
    (line,) = (line for line in text.splitlines() if "cotton blue" in line)
    assert [cell.strip() for cell in line.strip("│").split("│")][2:] == list(NUMBERS)


@pytest.mark.parametrize("width", [20, 30, 40, 60, 80, 100, 130, 160, 200, 300])
def test_no_number_is_ever_cut(monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    text = printed(table())
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    if width >= 40:  # the longest number has 20 characters
        lines = text.splitlines()
        assert all(sum(number in line for line in lines) >= 2 for number in NUMBERS)


def test_headings_fold_before_rows_are_stacked(monkeypatch):
    monkeypatch.setenv("COLUMNS", "150")
    text = printed(table())
    assert "┃" in text
    assert "heading of number 1" not in text
    monkeypatch.setenv("COLUMNS", "80")
    stacked = printed(table())
    assert "┃" not in stacked
    for place, number in enumerate(NUMBERS):
        assert f"heading of number {place} {number}" in words(stacked)
    assert "cloth cotton blue" in words(stacked)


def test_ascii_has_a_stand_in_for_everything():
    made = Table("cloth", "value")
    made.add_row("größer ✗", "0.12 ± 0.02 …")
    text = printed(made, Text("→ 5 µm"), file=Ascii())
    assert text.isascii()
    assert "0.12 +/- 0.02 ..." in text
    assert r"gr\xf6\xdfer x" in text
    assert "-> 5 um" in text
    assert len({len(line) for line in text.splitlines()[:-1]}) == 1


def test_an_encoding_keeps_what_it_has():
    assert in_encoding("größer ±", "latin-1") == "größer ±"
    assert in_encoding("größer …", "latin-1") == "größer ..."
    assert in_encoding("…", "utf-8") == "…"


def test_a_table_keeps_its_width_where_its_log_is_coloured(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    plain = printed(table())
    monkeypatch.setenv("FORCE_COLOR", "1")
    coloured = printed(table())
    assert coloured != plain
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured) == plain
