"""Features of a fabric with the atlas, and the joint probability of sets of effects at given base parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.residuals.noise import Scatter, scatter_of
from cusick_bench.diagnosis.inference.residuals.refusal import doubts, require_enough
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base, inflated
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics, sample_statistics, to_atlas
from cusick_bench.diagnosis.inference.sets.effect_points import effect_points, finer_points, law_variance
from cusick_bench.diagnosis.inference.sets.misfit import Misfit, misfit_of
from cusick_bench.diagnosis.inference.sets.set_model import SetModel, SharedShift
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid, detectable_grids
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.own_outlines import OwnOutlines


@dataclass(frozen=True, eq=False)
class FabricData:
    """Features of a fabric, with the atlas and calibration by which they are judged.

    Attributes:
        emulator: The atlas, with the fabric's own outlines.
        calibration: Calibration of its probabilities.
        features: Features of the fabric.
        scatter: How its samples scatter; None for the model's own scatter.
        drift: Share of each face's captures that are later ones.
        without: Effects that are not considered.
    """

    emulator: Emulator
    calibration: Calibration
    features: Features
    scatter: Scatter | None
    drift: float
    without: tuple[str, ...] = ()

    def against(self, *, start: ndarray | None = None, shift: ndarray | None = None, fixed: bool = False) -> Residual:
        """Residual of the best base model.

        Args:
            start: Base parameters to start from.
            shift: Shift of the features that is subtracted first [sd].
            fixed: Whether to linearise at `start`.

        Returns:
            The residual, in units of calibrated noise.
        """
        plain = against_base(
            self.emulator, self.features, scatter=self.scatter, drift=self.drift, start=start, shift=shift, fixed=fixed
        )
        return inflated(plain, self.calibration.inflation)

    def shift(self, causes: Sequence[Candidate], residual: Residual) -> ndarray:
        """Shift of the features by several effects.

        Args:
            causes: The effects with their parameters.
            residual: Where the base parameters are.

        Returns:
            The shift of all entries of `feature_vector` [sd].
        """
        total = np.zeros(len(residual.kept))
        for one in causes:
            point = {name: np.array([value]) for name, value in one.value.items()}
            moved = shifts(self.emulator, one.hypothesis, residual.theta, residual.sd, self.drift, point)
            total += moved.features[0]
        return total

    def grids(self, residual: Residual) -> list[Grid]:
        """Hypotheses that can be detected.

        Args:
            residual: Where the base parameters are.

        Returns:
            Their grids, without those that are not considered.
        """
        return [g for g in detectable_grids(self.emulator, residual) if g.hypothesis.name not in self.without]

    def model(self, residual: Residual, *, without: Sequence[str] = ()) -> SetModel:
        """Joint probability of sets at some base parameters.

        Args:
            residual: What the base model leaves there.
            without: Further effects that are not considered.

        Returns:
            The model.
        """
        misfit = misfit_of(self.emulator, residual)
        grids = [grid for grid in self.grids(residual) if grid.hypothesis.name not in without]
        listed = {one.name for one in hypotheses(self.emulator)} - {*self.without, *without}
        return SetModel(
            misfit.turned(residual.white),
            misfit,
            effect_points(grids, misfit, self.calibration.mismatch),
            len(listed),
            residual.freedom,
        )

    def finer(self, model: SetModel, residual: Residual, chosen: Sequence[int]) -> SetModel:
        """Joint probability of sets, with finer grids about some points.

        Args:
            model: The model at some base parameters.
            residual: What the base model leaves there.
            chosen: Points of the model.

        Returns:
            The model with more points.
        """
        mismatch = self.calibration.mismatch
        return replace(
            model, points=finer_points(model.points, chosen, self.emulator, residual, model.misfit, mismatch)
        )

    def shared_shift(self, causes: Sequence[Candidate], residual: Residual, misfit: Misfit) -> SharedShift | None:
        """Shift by effects that are known, in the turned rows.

        Args:
            causes: The effects.
            residual: Where the base parameters are.
            misfit: The rows.

        Returns:
            The shift; None without effects.
        """
        if not causes:
            return None
        turned = [misfit.turned(residual.whiten(self.shift([one], residual)[None]))[0] for one in causes]
        variance = np.zeros(len(turned[0]))
        for one, shift in zip(causes, turned, strict=True):
            variance += law_variance(misfit, self.calibration.mismatch(one.hypothesis.name), shift)
        return SharedShift(np.sum(turned, axis=0), variance)


def fabric_data(
    captures: Captures, emulator: Emulator, calibration: Calibration, without: Sequence[str] = ()
) -> tuple[SampleStatistics, FabricData, list[str]]:
    """Statistics and features of one fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas, calibrated.
        calibration: Calibration of its probabilities.
        without: Effects that are not to be considered.

    Returns:
        Statistics of its samples, the features, and notes.

    Raises:
        Refused: Another geometry than the atlas', or too few samples.
    """
    scaled, notes = to_atlas(captures)
    require_enough(captures)
    samples = sample_statistics(scaled)
    own = replace(emulator, outlines=OwnOutlines(scaled), warp_seen_down=scaled.warp_seen_down)
    scatter = scatter_of(samples.specimens)
    data = FabricData(own, calibration, samples.features(), scatter, samples.later, tuple(without))
    return samples, data, notes + doubts(captures, data.features)
