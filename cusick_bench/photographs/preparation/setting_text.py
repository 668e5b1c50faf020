"""Description of the experiment as text from the command line: sizes and weights with their units, faces by capture.

Nothing heavy is imported before it is used, since help pages show the defaults.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.quantities import LENGTHS, quantity
from cusick_bench.photographs.preparation.weights import TABLE, read_weights, weights_of_options
from cusick_bench.sim.constants import PLATE_RADIUS

if TYPE_CHECKING:
    from cusick_bench.photographs.preparation.prepare import Setting

_log = logging.getLogger(__name__)

_STANDARD = (0.12, 0.15, 0.18)  # [m] radii of the cloths of ISO 9073-9, all on one plate
_NEAR = 0.0025  # [m] largest difference from a size of the standard, such as that of inches


@dataclass(frozen=True)
class SettingText:
    """A `Setting` as it is written on a command line; each attribute is an option of that name.

    Attributes:
        weight: Weights with units: NUMBER=WEIGHT, or of all fabrics that have none of their own, also in the table.
        weights: Table of weights; by default `weights.csv` in the folder of the photographs, if it is there.
        cloth_diameter: Diameter of the flat cloth, with its unit.
        plate_diameter: Diameter of the plate, with its unit.
        captures: Which face lies up in which capture, NUMBER=up|down,...
        camera_height: Height of the camera above the plate, with its unit; None where it was not measured.
        printed_ruler: Length of the printed board's ruler of 150 mm as it was measured, with its unit.
    """

    weight: tuple[str, ...] = ()
    weights: Path | None = None
    cloth_diameter: str = "300 mm"
    plate_diameter: str = "180 mm"
    captures: str = "1=up,2=up,3=down,4=down"
    camera_height: str | None = None
    printed_ruler: str = "150 mm"

    def weights_table(self, photographs: Path) -> Path | None:
        """The table of weights that is used.

        Args:
            photographs: Folder of the photographs.

        Returns:
            Its path; None where there is none.
        """
        if self.weights is not None:
            return self.weights
        return photographs / TABLE if (photographs / TABLE).is_file() else None


def setting_of(text: SettingText, photographs: Path, fabrics: Sequence[int]) -> Setting:
    """Reads the description of the experiment.

    Args:
        text: As it is written.
        photographs: Folder of the photographs, which may hold a table of weights.
        fabrics: Numbers of the fabrics that are shown there.

    Returns:
        The same in SI units.

    Raises:
        BadPhotograph: A quantity, a face or a table that is not understood or no drape meter's; the option is named.
    """
    from cusick_bench.datasets.files.protocol import CAMERA_HEIGHTS, CLOTH_RADII, PLATE_RADII
    from cusick_bench.photographs.preparation.prepare import Setting
    from cusick_bench.photographs.sheet import RULER

    table = text.weights_table(photographs)
    weights, thicknesses = read_weights(table) if table else ({}, {})
    cloth = _length(text.cloth_diameter, "--cloth-diameter", (2 * CLOTH_RADII[0], 2 * CLOTH_RADII[1])) / 2
    plate = _length(text.plate_diameter, "--plate-diameter", (2 * PLATE_RADII[0], 2 * PLATE_RADII[1])) / 2
    if plate >= 0.9 * cloth:
        sizes = f"plate {2e3 * plate:g} mm, cloth {2e3 * cloth:g} mm"
        raise BadPhotograph(
            f"the plate must be smaller than 0.9 of the cloth, got {sizes}", remedy="correct a diameter"
        )
    if abs(plate - PLATE_RADIUS) > _NEAR or min(abs(cloth - radius) for radius in _STANDARD) > _NEAR:
        sizes = ", ".join(f"{2e3 * radius:g}" for radius in _STANDARD)
        _log.warning(
            "plate %g mm and cloth %g mm in diameter are no sizes of the standard (plate %g mm; cloth %s mm): make "
            "sure that they are diameters of your drape meter, not radii",
            2e3 * plate, 2e3 * cloth, 2e3 * PLATE_RADIUS, sizes,
        )  # fmt: skip
    height = text.camera_height
    return Setting(
        cloth_radius=cloth,
        plate_radius=plate,
        weights=weights_of_options(text.weight, fabrics, weights),
        thicknesses=thicknesses,
        captures=_faces(text.captures),
        camera_height=None if height is None else _length(height, "--camera-height", CAMERA_HEIGHTS),
        printed=_length(text.printed_ruler, "--printed-ruler", (0.9e-3 * RULER, 1.1e-3 * RULER)) / (1e-3 * RULER),
    )


def _length(text: str, option: str, bounds: tuple[float, float]) -> float:
    """A length within bounds [m]."""
    value = quantity(text, LENGTHS, option, "300 mm")
    if not bounds[0] <= value <= bounds[1]:
        raise BadPhotograph(
            f"{option} must be from {bounds[0]:g} to {bounds[1]:g} m, got {text}", remedy="correct number or unit"
        )
    return value


def _faces(text: str) -> dict[int, str]:
    """Which face lies up in which capture."""
    sides: dict[int, str] = {}
    for part in text.split(","):
        number, _, side = (word.strip() for word in part.partition("="))
        if not number.isdecimal() or side not in ("up", "down", ""):
            raise BadPhotograph(f"--captures must be NUMBER=up|down,..., got {part!r}", remedy="such as 1=up,2=down")
        if int(number) == 0:
            raise BadPhotograph(f"numbers of --captures begin at 1, got {part!r}", remedy="such as 1=up,2=down")
        if int(number) in sides:
            raise BadPhotograph(f"--captures has {int(number)} twice, got {text!r}", remedy="keep one of them")
        sides[int(number)] = side
    return sides
