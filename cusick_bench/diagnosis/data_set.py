"""The fabrics of one data set: effects that they share are found first, then every fabric is diagnosed with them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.diagnose import diagnose
from cusick_bench.diagnosis.document.build import document, refused_document
from cusick_bench.diagnosis.document.laboratory import LaboratoryDocument, laboratory_document
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.laboratory.laboratory import laboratory_of
from cusick_bench.diagnosis.inference.laboratory.shared_effects import Laboratory
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.options import Options
from cusick_bench.runner.environment import version_text
from cusick_bench.runner.numerics import diagnosis_numerics
from cusick_bench.sim.setup import Simulators

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class DataSetDiagnosis:
    """Fabrics of one data set, ready to be diagnosed one by one.

    Attributes:
        captures: Silhouettes of each fabric.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        options: How to diagnose.
        laboratory: What the fabrics share; None of fewer than two.
        simulators: Simulators that are reused from fabric to fabric.
    """

    captures: Mapping[str, Captures]
    emulator: Emulator
    calibration: Calibration
    options: Options
    laboratory: Laboratory | None
    simulators: Simulators

    @cached_property
    def shared(self) -> LaboratoryDocument | None:
        """The document of what the fabrics share."""
        return None if self.laboratory is None else laboratory_document(self.laboratory, self.captures)

    def together(self, fabric: str) -> Sequence[str]:
        """Fabrics that have to be diagnosed together to get the same answer for one of them.

        Args:
            fabric: The one.

        Returns:
            All fabrics where they share an effect that is named, else this one alone.
        """
        return list(self.captures) if self.laboratory is not None and self.laboratory.named else [fabric]

    def document(
        self, fabric: str, *, command: str, progress: Progress = lambda what, share: None
    ) -> DiagnosisDocument:
        """Diagnoses one fabric.

        Args:
            fabric: One of the fabrics.
            command: Command that makes the document again.
            progress: Called with what is being done and the share that is done.

        Returns:
            The document; `refused` says why where nothing can be said about the fabric.
        """
        version = version_text(diagnosis_numerics(diagnosis=NUMERICS_VERSION))
        captures = self.captures[fabric]
        try:
            found = diagnose(
                captures, self.emulator, self.calibration, self.options,
                shared=self.laboratory.shared if self.laboratory else None,
                simulators=self.simulators, progress=progress,
            )  # fmt: skip
        except Refused as refusal:
            return refused_document(fabric, str(refusal), command=command, version=version)
        return document(found, captures, self.emulator, command=command, version=version)


def data_set_diagnosis(
    captures: Mapping[str, Captures],
    emulator: Emulator,
    calibration: Calibration,
    options: Options,
    progress: Progress = lambda what, share: None,
) -> DataSetDiagnosis:
    """Finds the effects that the fabrics of a data set share.

    Args:
        captures: Silhouettes of each fabric.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        options: How to diagnose.
        progress: Called with what is being done and the share that is done.

    Returns:
        The fabrics, ready to be diagnosed.
    """
    shared = laboratory_of(
        list(captures.values()), emulator, calibration, np.random.default_rng(options.seed), without=options.without,
        progress=progress,
    )  # fmt: skip
    return DataSetDiagnosis(captures, emulator, calibration, options, shared, Simulators(most=20))
