"""What keeps a diagnosis honest: noise and trust learned from known cases, what cannot be seen, what is in no list."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load as load_data
from cusick_bench.diagnosis import calibrate as module
from cusick_bench.diagnosis.atlas.base_model import LOW, PRIOR_MEAN, BaseModel
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.calibrate import (
    DISCREPANCIES,
    INFLATIONS,
    calibrate,
    inflation_at_level,
    log_likelihoods_of,
    looks,
    parallel_map,
)
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.detectability.power import expected_features
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.inference.sets.fabric_data import fabric_data
from cusick_bench.diagnosis.inference.single_effects.evidence import LEAST_SIZE, NONE, detectable_grids, grid_at
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.diagnosis.measure.statistics import NAMES
from cusick_bench.diagnosis.options import SHIPPED


def fabric(emulator: Emulator, bending: float) -> Residual:
    """A fabric that is what the atlas expects."""
    theta = PRIOR_MEAN.copy()
    theta[0] = bending
    return against_base(emulator, expected_features(emulator, theta, 12), start=theta, fixed=True)


def test_calibration_finds_the_noise_and_the_power_that_suit_the_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the discrepancy is likeliest, three nulls in ten need more noise."""
    truths = [NONE if number % 2 else "creep" for number in range(400)]
    nulls = [number for number, truth in enumerate(truths) if truth == NONE]
    limits = {number: 1.25 if place < 0.3 * len(nulls) else 1.0 for place, number in enumerate(nulls)}

    fitted = Calibration(law_mismatch={"creep": (0.5, 0.2)})

    def p_value(captures: int, emulator: None, calibration: Calibration) -> float:
        assert calibration.law_mismatch == fitted.law_mismatch
        assert calibration.discrepancy == pytest.approx(0.1)
        return 0.5 if calibration.inflation > limits[captures] - 1e-9 else 0.01

    def likelihoods(captures: int, emulator: None, known: Calibration) -> list[float]:
        assert truths[captures] == NONE
        return [-abs(share - 0.1) for share in DISCREPANCIES]

    monkeypatch.setattr(module, "log_likelihoods_of", likelihoods)
    monkeypatch.setattr(module, "p_value_of", p_value)
    told: list[None] = []
    found = calibrate(list(enumerate(truths)), None, fitted, step=lambda: told.append(None))  # pyright: ignore[reportArgumentType]
    assert len(told) == looks(truths) == 400
    assert found.inflation == pytest.approx(1.25)
    assert found.discrepancy == pytest.approx(0.1)
    assert found.cases == 200
    assert found.law_mismatch == fitted.law_mismatch


def test_only_a_calibration_sees_the_atlas_as_it_was_fitted() -> None:
    """Whoever compares fabrics with the atlas gets it calibrated, and nobody calibrates it twice."""
    package = Path(module.__file__).parents[1]
    texts = {path.relative_to(package).as_posix(): path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    assert {name for name, text in texts.items() if "load_uncalibrated" in text or ".applied(" in text} == {
        "cli/diagnose/atlas.py", "diagnosis/atlas/store.py", "diagnosis/calibrate.py",
    }  # fmt: skip
    assert texts["cli/diagnose/atlas.py"].count("load_uncalibrated(") == 1, "atlas calibrate alone"


@pytest.mark.slow
def test_likelihoods_are_those_of_each_share_of_the_discrepancy(emulator: Emulator) -> None:
    data, known = load_data("synthetic"), Calibration(inflation=1.3)
    captures = read_captures(data, data.cloths[0])
    found = log_likelihoods_of(captures, emulator, known)
    for share in (DISCREPANCIES[0], DISCREPANCIES[-1]):
        one = replace(known, discrepancy=share, inflation=1.0)
        _, fabric, _ = fabric_data(captures, one.applied(emulator), one)
        assert found[DISCREPANCIES.index(share)] == fabric.against().log_likelihood
    assert len(set(found)) == len(DISCREPANCIES)


@pytest.mark.parametrize(("detected", "place"), [(0, 0), (11, 0), (12, 1), (20, 1)])
def test_the_level_holds_as_likely_as_not(detected: int, place: int) -> None:
    """Of 240 nulls 12 are the level; 11 are the most of which the median of the true share lies below it."""
    needed = [1] * detected + [0] * (240 - detected)
    assert inflation_at_level(needed) == INFLATIONS[place]


def test_nulls_that_no_noise_explains_are_refused() -> None:
    with pytest.raises(DiagnosisError, match="60 of 240 cases without effect"):
        inflation_at_level([len(INFLATIONS)] * 60 + [0] * 180)


@pytest.mark.parametrize("workers", [1, 2])
def test_processes_give_the_same_in_the_same_order(workers: int) -> None:
    with parallel_map(workers) as over:
        assert list(over(abs, range(-9, 9))) == [abs(number) for number in range(-9, 9)]


def test_cases_without_their_labels_are_refused(tmp_path: Path) -> None:
    copy = tmp_path / "atlas.npz"
    copy.write_bytes(SHIPPED.read_bytes())  # no command changes the one that is installed
    found = CliRunner().invoke(app, ["atlas", "calibrate", "cases", "labels.json", "others", "--atlas", str(copy)])
    assert found.exit_code == 2
    assert "got 3 paths" in found.output


def test_calibration_without_nulls_is_refused() -> None:
    with pytest.raises(DiagnosisError, match="cases without effect, got 0"):
        calibrate([], None)  # pyright: ignore[reportArgumentType]


def test_effects_too_weak_to_see_take_no_part(emulator: Emulator) -> None:
    """A limp cloth hides the turn of its grain, which it does not have; a stiff one shows more of everything."""
    limp, stiff = (detectable_grids(emulator, fabric(emulator, level)) for level in (-9.0, -4.8))
    names = [{grid.hypothesis.name for grid in made} for made in (limp, stiff)]
    assert len(names[0]) < len(names[1])
    for grid in (*limp, *stiff):
        size = np.linalg.norm(grid.shift, axis=1)
        assert np.isneginf(grid.log_prior[size < LEAST_SIZE]).all()
        assert 0 < np.exp(grid.log_prior).sum() < grid.hypothesis.prior


def test_a_known_cause_can_be_refitted_where_it_is_weak(emulator: Emulator) -> None:
    residual = fabric(emulator, LOW[0])
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "grain-skew")
    assert np.isneginf(grid_at(emulator, hypothesis, residual, least=1e3).log_prior).all()
    assert np.isfinite(grid_at(emulator, hypothesis, residual, least=0.0).log_prior).all()


def test_discrepancy_depends_on_how_limp_the_cloth_is(emulator: Emulator) -> None:
    limp, stiff = (emulator.wrong(np.array([level, 0, 0, 0, 5, 0, 0, 0, 0])) for level in (-9.8, -4.5))
    folds = NAMES.index("fold_centroid")
    assert limp[folds, folds] > 1.5 * stiff[folds, folds], "a coarse mesh gets the folds of limp cloth wrong"
    for covariance in (limp, stiff):
        assert np.linalg.eigvalsh(covariance).min() > -1e-9


def test_other_laws_keep_bending_at_rest_and_shear() -> None:
    plain, other = (BaseModel(120, other_laws=laws).samples(PRIOR_MEAN, 1, (5, 5))[0] for laws in (False, True))
    assert np.allclose(other.material.bending[:, 0], plain.material.bending[:, 0])
    assert np.allclose(other.material.bending[:, -1], plain.material.bending[:, -1])
    assert np.isclose(other.material.stretch[0, 3], plain.material.stretch[0, 3])
    assert (other.material.stretch[1:, 0] >= 0.8 * other.material.stretch[0, 0]).all()
    assert not np.allclose(other.material.stretch, plain.material.stretch)
