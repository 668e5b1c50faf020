"""One fabric's silhouettes as radius-angle profiles, with the sample, face and order that each belongs to.

Captures are nested: a fabric has samples, a sample two faces, a face captures of what may be one and the same drape.
Everything after this keeps the labels, since captures of one sample are not independent.

Profiles are kept as the camera sees them. A cloth that lies face down was turned over about y, so a point at the
angle phi of the cloth, counter-clockwise from warp with the face up, is seen at pi - phi; `cloth_frame` undoes that.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import nan

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.image import PlateFit, fit_plate
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.impossible import require_possible
from cusick_bench.diagnosis.errors import DiagnosisError

ANGLES = 360  # a radius per degree: twelve for the narrowest fold
SIDES = ("up", "down", "")
_ABOUT_X = re.compile(r"\b(about|around)\s+(the\s+)?x\b|^\s*(the\s+)?x([ _-]?axis)?\s*$", re.IGNORECASE)
_SLIP = 4.0  # least distance of a slip from the fabric's median [robust standard deviations]


@dataclass(frozen=True, eq=False)
class Captures:
    """Silhouettes of one fabric.

    Attributes:
        fabric: Name of the fabric.
        areal_density: Mass per area [kg/m2]; NaN if unknown.
        thickness: [m]; NaN if unknown.
        protocol: Nominal values of the experiment.
        radii: Outermost radius at whole degrees, counter-clockwise from the camera's x axis, as seen [m].
        area: Grey-weighted area of the silhouette [m2].
        sample: Number of the sample.
        side: "up", "down", or "" if unknown.
        capture: Order in which the sample's captures were taken.
        notes: What was left out or is in doubt.
    """

    fabric: str
    areal_density: float
    thickness: float
    protocol: Protocol
    radii: Float[ndarray, "captures angles"]
    area: Float[ndarray, " captures"]
    sample: Int[ndarray, " captures"]
    side: ndarray
    capture: Int[ndarray, " captures"]
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        _check(self)

    def __len__(self) -> int:
        return len(self.radii)

    def cloth_frame(self) -> Float[ndarray, "captures angles"]:
        """Radii at angles from the warp of the cloth seen face up [m]; an unknown side counts as up."""
        return np.take_along_axis(self.radii, self.seen_at(), axis=1)

    def seen_at(self) -> Int[ndarray, "captures angles"]:
        """Degree at which the camera sees each degree of the cloth; an unknown side counts as up.

        The protocol's words may say that the cloth was turned about x instead of y: then phi is seen at -phi.
        """
        degrees = np.arange(ANGLES)
        seen_down = (round(np.rad2deg(self.warp_seen_down)) - degrees) % ANGLES
        return np.where((self.side == "down")[:, None], seen_down, degrees)

    @property
    def warp_seen_down(self) -> float:
        """Angle at which the camera sees the warp of a cloth that lies face down [rad]: pi where it is turned about y,
        0 about x."""
        return 0.0 if _turned_about_x(self.protocol) else np.pi

    def select(self, rows: Bool[ndarray, " captures"] | Int[ndarray, " chosen"]) -> "Captures":
        """Some of the captures.

        Args:
            rows: Indices of the captures, or a mask.

        Returns:
            These.

        Raises:
            DiagnosisError: None is left.
        """
        names = ("radii", "area", "sample", "side", "capture")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def captures_from_profiles(
    radii: Float[ndarray, "captures angles"],
    *,
    sample: Int[ndarray, " captures"],
    side: Sequence[str] | ndarray,
    capture: Int[ndarray, " captures"],
    protocol: Protocol | None = None,
    area: Float[ndarray, " captures"] | None = None,
    fabric: str = "simulated",
    areal_density: float = nan,
    thickness: float = nan,
) -> Captures:
    """Captures from profiles that are already known, such as simulated ones.

    Args:
        radii: Radii at equidistant angles from 0, as the camera sees the cloth: of a cloth that lies face down, the
            mirror image [m]. The number of angles is a multiple of 360.
        sample, side, capture: Labels of each profile.
        protocol: Nominal values; the public release's by default.
        area: Area of the silhouettes [m2]; by default that within the profile.
        fabric: Name of the cloth.
        areal_density: Mass per area [kg/m2]; NaN if unknown.
        thickness: [m]; NaN if unknown.

    Returns:
        The captures.

    Raises:
        DiagnosisError: Another number of angles, labels that do not fit, or radii that are no radii.
    """
    if radii.ndim != 2 or radii.shape[1] == 0 or radii.shape[1] % ANGLES:
        raise DiagnosisError(
            f"profiles must be (captures, angles) with a multiple of {ANGLES} angles, got {radii.shape}; "
            f"sample them at whole degrees"
        )
    every = radii.shape[1] // ANGLES
    enclosed = np.pi * (radii**2).mean(1)
    return Captures(
        fabric,
        areal_density,
        thickness,
        protocol or Protocol(),
        np.ascontiguousarray(radii[:, ::every]),
        enclosed if area is None else area,
        np.asarray(sample),
        np.asarray(side, dtype=str),
        np.asarray(capture),
    )


def read_captures(dataset: DrapeDataset, fabric: str, *, force: bool = False) -> Captures:
    """Silhouettes of one fabric of a data set, with the corrections that it was loaded with.

    An image is left out, and a note says so, if it cannot be read, if a ray from the plate's axis meets no cloth, or
    if the plate does not fit into the silhouette where it should be and the silhouette's place or size is unlike the
    fabric's others'. Where it is like theirs it is no slip but something to be diagnosed (the camera's place or scale,
    cloths laid off centre), and it stays.

    Args:
        dataset: The data set.
        fabric: One of its `cloths`.
        force: Whether to use silhouettes that no cloth on the plate can show; a note says so.

    Returns:
        The captures, with notes.

    Raises:
        DataError: No such fabric, or without `force` a silhouette that no cloth on the plate can show.
        DiagnosisError: No image of it can be used.
    """
    chosen = dataset.select(cloth=fabric)
    rows, unreadable, notes = [], [], []
    for row in range(len(chosen)):
        try:
            rows.append(_read(chosen, row))
        except DataError as error:
            unreadable.append(row)
            notes.append(f"left out: {error}")
    slips = _slips(rows, 1 / chosen.protocol.px_per_m)
    used = [read.row for read, slip in zip(rows, slips, strict=True) if not slip]
    require_possible(chosen, used + unreadable, force=force)
    notes += [f"forced: {fault}" for fault in require_possible(chosen, used, force=force)]
    notes += [f"left out: {read.image}: {read.plate.fault}" for read, slip in zip(rows, slips, strict=True) if slip]
    kept = [read for read, slip in zip(rows, slips, strict=True) if not slip]
    faults = Counter(read.plate.fault for read in kept if read.plate.fault)
    notes += [
        f"{count} of {len(kept)} images are {fault}, but like the others; kept" for fault, count in faults.items()
    ]
    unknown = sum(not read.side for read in kept)
    notes += [f"the face of {unknown} of {len(kept)} images is unknown"] if unknown else []
    if not kept:
        raise DiagnosisError(f"no silhouette of {fabric} can be used: {'; '.join(notes)}; see `data audit`")
    captures = captures_from_profiles(
        np.stack([read.radii for read in kept]),
        sample=np.array([read.sample for read in kept]),
        side=[read.side for read in kept],
        capture=np.array([read.capture for read in kept]),
        protocol=chosen.protocol,
        area=np.array([read.area for read in kept]),
        fabric=fabric,
        areal_density=float(chosen.table["areal_density"].iloc[0]),
        thickness=float(chosen.table["thickness"].iloc[0]),
    )
    return replace(captures, notes=tuple(notes))


def read_usable_captures(
    dataset: DrapeDataset, fabrics: Iterable[str], *, force: bool = False
) -> tuple[dict[str, Captures], dict[str, DiagnosisError]]:
    """Silhouettes of those fabrics of which an image can be used.

    Args:
        dataset: The data set.
        fabrics: Some of its `cloths`.
        force: As in `read_captures`.

    Returns:
        The captures by fabric, and for each of the others why none of its images can be used.

    Raises:
        DataError: As in `read_captures`.
    """
    found: dict[str, Captures] = {}
    unusable: dict[str, DiagnosisError] = {}
    for name in fabrics:
        try:
            found[name] = read_captures(dataset, name, force=force)
        except DiagnosisError as error:
            unusable[name] = error
    return found, unusable


@dataclass(frozen=True, eq=False)
class _Read:
    """One silhouette; names as in `Captures`."""

    row: int
    image: str
    radii: Float[ndarray, " angles"]
    area: float
    sample: int
    side: str
    capture: int
    plate: PlateFit


def _read(dataset: DrapeDataset, row: int) -> _Read:
    drape, protocol = dataset.sample(row), dataset.protocol
    labels = {str(name): value for name, value in drape.row.items()}
    image = drape.image.numpy()
    if (drape.profile.radii <= 0).any():
        raise DataError("does not cover the plate's axis", where=labels["image"], remedy="correct `centre_px`")
    return _Read(
        row,
        str(labels["image"]),
        drape.profile.radii,
        float(image.sum()) / protocol.px_per_m**2,
        int(labels["sample"]),
        str(labels["side"]),
        int(labels["observation"] or labels["capture"]),
        fit_plate(image, protocol),
    )


def _slips(rows: Sequence[_Read], pixel: float) -> list[bool]:
    """Which images do not show the plate inside the cloth and differ from the others in place (first harmonic) or size.

    Args:
        rows: The images.
        pixel: Width of a pixel [m], below which no distance tells.
    """
    if not rows:
        return []
    radii = np.stack([read.radii for read in rows])
    transform = np.fft.rfft(radii, axis=1)[:, :2] / radii.shape[1]
    place = np.stack([2 * np.real(transform[:, 1]), 2 * np.imag(transform[:, 1]), np.real(transform[:, 0])], axis=1)
    distance = np.abs(place - np.median(place, axis=0))
    scale = np.maximum(1.4826 * np.median(distance, axis=0), pixel)
    apart = np.any(distance > _SLIP * scale, axis=1)
    return [bool(read.plate.fault) and far for read, far in zip(rows, apart.tolist(), strict=True)]


def _turned_about_x(protocol: Protocol) -> bool:
    """Whether it says `about x`, or names the axis alone: `x`, `x-axis`."""
    return _ABOUT_X.search(protocol.turn_over) is not None


def _check(captures: Captures) -> None:
    count = len(captures.radii)
    if count == 0:
        raise DiagnosisError(f"a diagnosis needs at least one silhouette, {captures.fabric} has none")
    if captures.radii.shape != (count, ANGLES):
        raise DiagnosisError(f"profiles must have {ANGLES} angles, got {captures.radii.shape}")
    for name in ("area", "sample", "side", "capture"):
        shape = getattr(captures, name).shape
        if shape != (count,):
            raise DiagnosisError(f"{name} must hold one value for each of {count} profiles, got {shape}")
    if not (np.isfinite(captures.radii).all() and (captures.radii > 0).all()):
        raise DiagnosisError("radii must be finite and > 0 m; a silhouette is empty or a drape has diverged")
    unknown = sorted(set(captures.side.tolist()) - set(SIDES))
    if unknown:
        raise DiagnosisError(f'side must be "up", "down" or "" (unknown), got {unknown[0]!r}')
