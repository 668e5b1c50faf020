"""Diagnoses of one fabric, with and without everything that is planted in it."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from math import nan

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import DataError
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.calibrate import parallel_map
from cusick_bench.diagnosis.controls.judgement import Judgement, judge, largest_shift
from cusick_bench.diagnosis.controls.known_answers import LEAST_SAMPLES, Control, FabricUnderControl, controls_of
from cusick_bench.diagnosis.controls.reading import Reading, read, refused
from cusick_bench.diagnosis.diagnose import diagnose
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.diagnosis.measure.statistics import specimen_statistics
from cusick_bench.diagnosis.options import Options

_MOSTLY = 0.5  # a set with at least this share of another set's pictures is not a fabric of its own


@dataclass(frozen=True, eq=False)
class _Diagnosed:
    """What a diagnosis says, and the statistics of the pictures that it saw; None where these cannot be read."""

    reading: Reading
    statistics: Float[ndarray, "samples faces statistics"] | None


def fabrics_to_control(dataset: DrapeDataset) -> list[str]:
    """Fabrics with enough samples, without the named sets that repeat other fabrics' pictures.

    Args:
        dataset: The data.

    Returns:
        Their names, in the table's order.
    """
    chosen = []
    for name, rows in dataset.table.groupby("cloth", sort=False):
        samples, sources = (rows[column].to_numpy() for column in ("sample", "same_as"))
        if len(np.unique(samples)) >= LEAST_SAMPLES and np.mean(sources != "") < _MOSTLY:
            chosen.append(str(name))
    return chosen


def fabric_under_control(
    dataset: DrapeDataset, fabric: str, *, halves: int = 2, seed: int = 0, force: bool = False
) -> FabricUnderControl:
    """A fabric of a data set.

    Args:
        dataset: The data.
        fabric: Name of the fabric.
        halves: How often each of its faces is divided into random halves.
        seed: Seed of permutations and halves.
        force: Whether to use silhouettes that no cloth on the plate can show.

    Returns:
        The fabric.

    Raises:
        DataError: No such fabric, or without `force` a silhouette that no cloth on the plate can show.
        DiagnosisError: No image of it can be used.
    """
    captures = read_captures(dataset, fabric, force=force)
    return FabricUnderControl(dataset.select(cloth=fabric), captures, halves, seed)


def controlled(
    fabric: FabricUnderControl,
    emulator: Emulator,
    calibration: Calibration,
    options: Options | None = None,
    *,
    names: Collection[str] = (),
    workers: int = 1,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> list[Judgement]:
    """Diagnoses a fabric with and without everything that is planted in it.

    Args:
        fabric: The fabric.
        emulator: The atlas.
        calibration: Calibration of the probabilities.
        options: How to diagnose; nothing is simulated.
        names: Which controls; by default all.
        workers: Number of processes.
        progress: Called with what is being done and the share that is done.

    Returns:
        A judgement for each control.
    """
    controls, references = controls_of(fabric, names)
    chosen = Options(0, False, options.without if options else (), options.seed if options else 0)
    own = {
        number: control
        for number, control in enumerate(controls)
        if control.data is not references.get(control.reference)  # otherwise it has the diagnosis of its reference
    }
    data = [*references.values(), *(control.data for control in own.values())]
    words = [*references, *(f"{control.name}, {control.level}" for control in own.values())]
    diagnosed: list[_Diagnosed] = []
    with parallel_map(workers) as over:
        job = partial(_diagnosed, fabric=fabric.name, emulator=emulator, calibration=calibration, options=chosen)
        for one in over(job, data):
            diagnosed.append(one)
            progress(words[min(len(diagnosed), len(words) - 1)], len(diagnosed) / len(data))
    before = dict(zip(references, diagnosed, strict=False))
    after = dict(zip(own, diagnosed[len(references) :], strict=True))
    return [_judged(control, before, after.get(number)) for number, control in enumerate(controls)]


def _judged(control: Control, references: dict[str, _Diagnosed], own: _Diagnosed | None) -> Judgement:
    after = own or references[control.reference]
    before = references.get(control.reference, after)
    shift = nan
    if control.reference and own is not None and before.statistics is not None and own.statistics is not None:
        shift = largest_shift(before.statistics, own.statistics)
    return judge(control, before.reading, after.reading, shift)


def _diagnosed(
    data: DrapeDataset, *, fabric: str, emulator: Emulator, calibration: Calibration, options: Options
) -> _Diagnosed:
    """One diagnosis; changed pictures are not checked for whether a cloth can show them."""
    statistics = None
    try:
        captures = read_captures(data, fabric, force=True)
        statistics = specimen_statistics(captures).mean
        result = diagnose(captures, emulator, calibration, options)
    except (DataError, DiagnosisError) as error:
        return _Diagnosed(refused(str(error)), statistics)
    return _Diagnosed(read(result), statistics)
