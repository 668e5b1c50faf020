"""The fitted atlas as one small file, and how probabilities are calibrated on it.

emulator, calibration = load()            # the shipped one, calibrated: what fabrics are compared with
save(path, fit(*read_points(folder)), Calibration())
"""

import json
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.response import Response
from cusick_bench.diagnosis.atlas.ridge import Fit, SummedFit
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.features import SPREADS
from cusick_bench.diagnosis.measure.own_outlines import DEPTH_MISMATCH, UNDONE
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.diagnosis.options import SHIPPED
from cusick_bench.files import BadFile, parse_json, read_npz
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import registered

_LARGEST = 1 << 26  # [bytes]
_PARTS = ("gain", "mean", "spread")
_SUMS = ("base", "base_spread", "log_sd")
_MOST_FITS = 9  # largest number of fits whose sum is one function
_MOST = 1000  # largest inflation


LAW_MISMATCH = (0.3, 0.15)
"""Mismatch of laws along an effect's shift and across it, as shares of its size, where nothing was learned."""
PLATE_MISMATCH = (0.15, 0.08)
"""The same for effects of the plate: geometry has one law, only the drape that it is applied to is another."""
OUTLINE_MISMATCH = (0.1, 0.06)
"""For effects that are undone on the fabric's own outlines: cameras whose offset wanders, or whose pixels are not quite
square, differ by .03 along and .08 across; the steps of grids leave some .05."""


@dataclass(frozen=True)
class Calibration:
    """What was learned on simulated cases with known causes, other than those that a diagnosis is scored on.

    Attributes:
        inflation: Standard deviation of the whitened residual where no effect acts; 1 in theory.
        discrepancy: Share of the atlas' own discrepancy that other simulators show; 1 in theory.
        cases: How many cases without effect that rests on; 0 for theory.
        law_mismatch: How far other laws for the same effect differ from the atlas', by effect: along its shift and
            across it, as shares of the shift's size; defaults for effects that it lacks.
    """

    inflation: float = 1.0
    cases: int = 0
    law_mismatch: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    discrepancy: float = 1.0

    def mismatch(self, effect: str) -> tuple[float, float]:
        """How far other laws for an effect may differ.

        Args:
            effect: Name of the effect.

        Returns:
            Along its shift and across it, as shares of the shift's size.
        """
        if effect in UNDONE:
            return DEPTH_MISMATCH.get(effect, OUTLINE_MISMATCH)
        known = registered().get(effect)
        of_plate = known is not None and known.kind == "boundary"
        return self.law_mismatch.get(effect, PLATE_MISMATCH if of_plate else LAW_MISMATCH)

    def applied(self, emulator: Emulator) -> Emulator:
        """The atlas with that share of its discrepancy.

        Args:
            emulator: The atlas as it was fitted.

        Returns:
            The atlas that fabrics are compared with.
        """
        return replace(emulator, discrepancy=self.discrepancy * emulator.discrepancy)

    def __post_init__(self) -> None:
        object.__setattr__(self, "law_mismatch", {name: _shares(name, one) for name, one in self.law_mismatch.items()})
        value = self.inflation
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= _MOST:
            raise ValueError(f"inflation of the calibration must be a number > 0, got {value!r}")
        if isinstance(self.discrepancy, bool) or not isinstance(self.discrepancy, int | float):
            raise ValueError(f"discrepancy of the calibration must be a number, got {self.discrepancy!r}")
        if not 0 <= self.discrepancy <= 1:
            raise ValueError(f"discrepancy of the calibration must be between 0 and 1, got {self.discrepancy!r}")


def _shares(name: str, given: Any) -> tuple[float, float]:
    """Two shares, along and across, or an error that names the effect."""
    known = isinstance(given, list | tuple) and len(given) == 2
    if not known or not all(isinstance(one, int | float) and 0 <= one <= _MOST for one in given):
        raise ValueError(f"law_mismatch of {name} must be two numbers >= 0, along and across, got {given!r}")
    return float(given[0]), float(given[1])


def save(path: Path, emulator: Emulator, calibration: Calibration) -> None:
    """Writes a fitted atlas; numbers are kept to single precision.

    Args:
        path: The file; its folder is created.
        emulator: The atlas as it was fitted, without its calibration.
        calibration: Calibration of its probabilities.
    """
    arrays: dict[str, ndarray] = {"correlation": emulator.correlation, "discrepancy": emulator.discrepancy}
    fits: dict[str, Fit] = {}
    for name in _SUMS:
        summed: SummedFit = getattr(emulator, name)
        for place, (fit, columns) in enumerate(zip(summed.fits, summed.columns, strict=True)):
            fits[f"{name}/{place}"] = fit
            arrays[f"{name}/{place}/columns"] = columns.astype(np.float64)
    for name, response in emulator.responses.items():
        fits |= {f"{name}/{part}": getattr(response, part) for part in _PARTS}
    for name, fit in fits.items():
        arrays |= {f"{name}/{part}": value for part, value in vars(fit).items()}
    about = {
        "statistics": list(NAMES),
        "spreads": [name for name, _ in SPREADS],
        "responses": {name: [one.later, one.mismatch] for name, one in emulator.responses.items()},
        "calibration": asdict(calibration),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    single: dict[str, Any] = {name: value.astype(np.float32) for name, value in arrays.items()}
    content = BytesIO()
    np.savez_compressed(content, about=np.array(json.dumps(about)), **single)
    write_atomically(path, content.getvalue())


def load(path: Path = SHIPPED) -> tuple[Emulator, Calibration]:
    """Reads an atlas to compare fabrics with.

    Args:
        path: The file; by default the shipped one.

    Returns:
        The atlas with the share of its discrepancy that its calibration says, and the calibration, whose other numbers
        apply to single fabrics and effects.

    Raises:
        DiagnosisError: No file, damaged, or of other statistics than this version's.
    """
    fitted, calibration = load_uncalibrated(path)
    return calibration.applied(fitted), calibration


def load_uncalibrated(path: Path = SHIPPED) -> tuple[Emulator, Calibration]:
    """Reads an atlas as it was fitted, to calibrate it anew; `load` is for all else.

    Args:
        path: The file; by default the shipped one.

    Returns:
        The atlas with all of its discrepancy, and its last calibration. Warns of effects that nobody registers here, as
        no diagnosis can find them.

    Raises:
        DiagnosisError: No file, damaged, or of other statistics than this version's.
    """
    remedy = "make one with `cusick-bench atlas build` and `cusick-bench atlas fit`"
    try:
        arrays = read_npz(path, remedy=remedy, most_bytes=_LARGEST)
        about = parse_json(str(arrays.pop("about")), path, remedy=remedy)
        if unsound := [name for name, value in arrays.items() if value.dtype.kind != "f" or not _finite(value)]:
            raise ValueError(f"{unsound[0]} must hold finite numbers")
        arrays = {name: value.astype(np.float64) for name, value in arrays.items()}
        if about["statistics"] != list(NAMES) or about["spreads"] != [name for name, _ in SPREADS]:
            raise ValueError("it holds other statistics than this version's")

        def fit(name: str) -> Fit:
            return Fit(*(arrays[f"{name}/{part}"] for part in ("weights", "covariance", "residual")))

        def summed(name: str) -> SummedFit:
            places = [f"{name}/{place}" for place in range(_MOST_FITS) if f"{name}/{place}/columns" in arrays]
            fits = tuple(fit(place) for place in places)
            columns = tuple(arrays[f"{place}/columns"].astype(np.int64) for place in places)
            if not places:
                raise ValueError(f"it lacks {name}/0/columns")
            for place, one, own in zip(places, fits, columns, strict=True):
                if len(own) != len(one.weights) or own.min(initial=0) < 0 or own.max(initial=0) >= len(fits[0].weights):
                    raise ValueError(f"{place}/columns must number a term for each of its weights")
            return SummedFit(fits, columns)

        responses = {
            name: Response(
                name,
                gain=fit(f"{name}/gain"),
                mean=fit(f"{name}/mean"),
                spread=fit(f"{name}/spread"),
                later=bool(later),
                mismatch=None if mismatch is None else (float(mismatch[0]), float(mismatch[1])),
            )
            for name, (later, mismatch) in about["responses"].items()
        }
        calibration = Calibration(**about["calibration"])
        _check_shapes(path, arrays)
        base, base_spread, log_sd = (summed(name) for name in _SUMS)
        emulator = Emulator(base, base_spread, log_sd, arrays["correlation"], arrays["discrepancy"], responses)
    except BadFile as error:
        raise DiagnosisError(f"the atlas {path} cannot be used ({error.what}); {remedy}") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise DiagnosisError(f"the atlas {path} cannot be used ({error}); {remedy}") from error
    if unknown := [name for name in responses if name not in registered()]:
        warnings.warn(
            f"the atlas {path} has effects that are not registered here, and no diagnosis will find them: "
            f"{', '.join(unknown)}; install the package that registers them",
            RuntimeWarning,
            stacklevel=1,
        )
    return emulator, calibration


def _check_shapes(path: Path, arrays: dict[str, ndarray]) -> None:
    """Makes sure that arrays have the shapes of the shipped atlas; responses to other effects have their own."""
    if path == SHIPPED:
        return
    shipped = read_npz(SHIPPED, remedy="reinstall cusick-bench", most_bytes=_LARGEST)
    for name, value in arrays.items():
        if name in shipped and value.shape != shipped[name].shape:
            raise ValueError(f"{name} must have the shape {shipped[name].shape}, got {value.shape}")


def _finite(value: ndarray) -> bool:
    return bool(np.isfinite(value).all())
