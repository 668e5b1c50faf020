"""Keys of `protocol.json` that are not known: remarks and counts are kept, what may be an unused measure is refused."""

import json
import re
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from cusick_bench.datasets.errors import BadTable
from cusick_bench.sim.errors import did_you_mean

NOTES = "notes"
"""The key under which anything may stand."""

_LIKE = 0.75  # similarity from which a key that holds text counts as a misspelling (difflib's ratio)
_OTHER_WORDS = {
    "cloth_radius_m": ("radius", "diameter", "cloth", "sample", "specimen", "sample_radius", "sample_diameter",
                       "cloth_diameter", "fabric_radius"),
    "plate_radius_m": ("plate", "disc_radius", "support_radius", "pedestal_radius", "plate_diameter"),
    "gravity_m_s2": ("g", "gravity"),
    "image_size_px": ("size", "width", "height", "resolution", "image_width", "image_height", "image_size"),
    "px_per_m": ("scale", "px_per_mm", "px_per_cm", "pixels_per_metre", "pixels_per_meter", "ppm", "dpi", "m_per_px",
                 "mm_per_px", "pixel_size"),
    "centre_px": ("centre", "center", "origin", "cx", "cy", "principal_point"),
    "projection": ("perspective", "fov"),
    "camera_height_m": ("camera_height", "camera_distance", "eye_height", "height_m"),
    "image_y": ("y", "flip", "y_axis"),
    "foreground": ("background", "invert", "inverted"),
    "captures": ("sides", "faces", "face", "side"),
    "turn_over": ("turned", "turn", "flip_axis"),
}  # fmt: skip
"""Known key -> what others call it, or its name in another unit."""

_COUNTED = "(sample|specimen|face|side|capture|picture|image|silhouette|repeat|drape|observation|fabric|cloth|case)"
_COUNT = re.compile(
    rf"(n|num|number_of|count_of)_{_COUNTED}s(_per_{_COUNTED})?|{_COUNTED}s(_per_{_COUNTED})?|{_COUNTED}_(id|number|count)|"
    r"([a-z]+_)?(version|seed)|id"
)
"""Keys that say how many there are, or which one it is: no measure of what the images show."""
_UNIT = re.compile(r"_(m|cm|mm|um|px|in|inch)$")
_WORDED = ("foreground", "image_y", "projection")  # known keys that hold a word


def check_unknown_keys(unknown: Mapping[str, Any], known: Collection[str], path: Path) -> None:
    """Refuses unknown keys that may be meant as a measure.

    Args:
        unknown: Keys that are not known, and their values.
        known: Keys that are.
        path: The file, for the message.

    Raises:
        BadTable: A key that resembles a known one, or that holds anything but text, nothing (null), or the number of a
            count, a version or a seed.
    """
    for key, value in unknown.items():
        if key == NOTES or _counts(key, value):
            continue
        near = _meant(key, value, known)
        if near or not (value is None or isinstance(value, str)):
            shown = json.dumps(value)
            raise BadTable(
                f"unknown key {key!r}, which holds {shown[:40] + '...' if len(shown) > 40 else shown}",
                where=path,
                remedy=(near or did_you_mean(key, known)) + f"known keys are {', '.join((*known, NOTES))} "
                f"(docs/drape-meter.md explains them); remarks go into {NOTES!r}",
                kind="protocol-invalid",
            )


def _plain(key: str) -> str:
    return key.strip().lower().replace(" ", "_").replace("-", "_")


def _counts(key: str, value: Any) -> bool:
    """Whether a number says how many there are, or which one it is; only versions need not be whole."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    whole = isinstance(value, int) or _plain(key).endswith("version")
    return number and whole and _COUNT.fullmatch(_plain(key)) is not None


def _meant(key: str, value: Any, known: Collection[str]) -> str:
    """A question with the known key that this one resembles, by its letters or its meaning; empty if none."""
    plain = _plain(key)
    near = get_close_matches(plain, list(known), n=1, cutoff=_LIKE)
    measured = not isinstance(value, str) or value.strip()[:1] in set("0123456789.-+")
    for name, words in _OTHER_WORDS.items():
        if (measured or name in _WORDED) and (plain in words or _UNIT.sub("", plain) in words):
            near = [name]
    half = ", half of a diameter" if near and "diameter" in plain else ""
    return f"did you mean {near[0]!r}{half}? " if near else ""
