"""What a program must say of itself to get materials."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cusick_bench.export.material.fabric import FabricMaterial


@dataclass(frozen=True)
class Program:
    """A program that materials are written for.

    Attributes:
        name: What `--for` calls it.
        title: Its name in full.
        files: From a fabric and the edge length of the program's mesh [m] (None where it is not given) to text by name
            of file.
        use: How the files are used, for the README.
        kept: What carries over.
        lost: What does not.
        source: Where the conversion is from, and how far it has been checked.
        needs_edge_length: Whether values depend on an edge length that is given here.
    """

    name: str
    title: str
    files: Callable[[FabricMaterial, float | None], Mapping[str, str]]
    use: str
    kept: tuple[str, ...]
    lost: tuple[str, ...]
    source: str
    needs_edge_length: bool = False
