"""Statistics of a fabric's samples, with lengths scaled to the atlas' cloth: the input of inference."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.protocol import CAMERA_HEIGHTS, Protocol
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.features import features as features_of
from cusick_bench.diagnosis.measure.statistics import specimen_statistics
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS


@dataclass(frozen=True, eq=False)
class SampleStatistics:
    """Statistics of a fabric's samples.

    Attributes:
        specimens: Means over the captures of each sample and side; NaN where there is none.
        drift: Last minus first capture of each sample.
        later: Share of captures that are not the first of their drape.
    """

    specimens: Float[ndarray, "samples 2 statistics"]
    drift: Float[ndarray, "samples statistics"]
    later: float

    def features(self, chosen: ndarray | None = None) -> Features:
        """Features of all samples, or of some.

        Args:
            chosen: Indices of the samples.

        Returns:
            Their features.
        """
        if chosen is None:
            return features_of(self.specimens, self.drift)
        return features_of(self.specimens[chosen], self.drift[chosen])


def to_atlas(captures: Captures) -> tuple[Captures, list[str]]:
    """Captures with lengths in units of the atlas' cloth.

    Args:
        captures: Silhouettes of a fabric.

    Returns:
        The captures, scaled; their notes.

    Raises:
        Refused: Plate and cloth are not in the atlas' ratio.
    """
    protocol = captures.protocol
    if not protocol.has_standard_ratio:
        ratio, nominal_ratio = protocol.plate_radius_m / protocol.cloth_radius_m, PLATE_RADIUS / CLOTH_RADIUS
        raise Refused(
            f"the atlas is for plate over cloth = {nominal_ratio:g}, this protocol has {protocol.plate_radius_m:g} m "
            f"over {protocol.cloth_radius_m:g} m = {ratio:.3g}; drape samples of "
            f"{2 * protocol.standard_cloth_radius_m:.3g} m, or correct protocol.json"
        )
    factor, notes = CLOTH_RADIUS / protocol.cloth_radius_m, [*captures.notes, *lengths_of_atlas(protocol)]
    if protocol.projection == "pinhole":
        notes.append(
            "radii are corrected for the pinhole camera of protocol.json as cloth hangs and bulges from the plate's "
            "edge on average: what is left of perspective may show as an effect of the camera"
        )
    nominal = replace(
        protocol,
        cloth_radius_m=CLOTH_RADIUS,
        plate_radius_m=PLATE_RADIUS,
        px_per_m=protocol.px_per_m / factor,
        camera_height_m=float(np.clip(protocol.camera_height_m * factor, *CAMERA_HEIGHTS)),  # no radius needs it
    )
    scaled = replace(captures, radii=captures.radii * factor, area=captures.area * factor**2, protocol=nominal)
    return scaled, notes


def lengths_of_atlas(protocol: Protocol) -> list[str]:
    """Note on the unit of a diagnosis' lengths.

    Args:
        protocol: Nominal values of the experiment.

    Returns:
        A note for cloth of another radius than the atlas'.
    """
    if protocol.cloth_radius_m == CLOTH_RADIUS:
        return []
    return [
        f"lengths are those of the atlas' cloth of {1e3 * CLOTH_RADIUS:g} mm radius; for this one, of "
        f"{1e3 * protocol.cloth_radius_m:g} mm, multiply them by {protocol.cloth_radius_m / CLOTH_RADIUS:.4g}"
    ]


def sample_statistics(captures: Captures) -> SampleStatistics:
    """Statistics of a fabric's samples; a face that is not known counts as the upper one, where that is missing.

    Args:
        captures: Its silhouettes, in the atlas' lengths.

    Returns:
        The statistics.
    """
    table = specimen_statistics(captures)
    mean = table.mean.copy()
    unknown = np.isfinite(mean[:, 2, 0]) & ~np.isfinite(mean[:, 0, 0])
    mean[unknown, 0] = mean[unknown, 2]
    several = np.maximum(table.count.max(1), 1)
    later = float(np.mean((several - 1) / several))
    return SampleStatistics(mean[:, :2], table.order_odd, later)
