"""Base parameters, detection and refusal, on fabrics drawn from the statistics of the atlas itself."""

from dataclasses import replace

import numpy as np
import pytest
from atlas_fabrics import THETA, drawn_fabric, fabric_of, residual_of
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, PRIOR_MEAN
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.detectability import power
from cusick_bench.diagnosis.inference.detectability.power import detectable_at, expected_features, needed
from cusick_bench.diagnosis.inference.findings.detection import detection_statistic
from cusick_bench.diagnosis.inference.residuals.feature_rows import SPREAD, faces_of
from cusick_bench.diagnosis.inference.residuals.refusal import domain_doubts
from cusick_bench.diagnosis.inference.residuals.residual import against_base
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.set_model import SetModel
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses, shifts
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.statistics import NAMES


def test_base_model_recovers_its_parameters(emulator: Emulator) -> None:
    generator = np.random.default_rng(3)
    errors = []
    for _ in range(6):
        residual = residual_of(emulator, *drawn_fabric(emulator, generator))
        errors.append((residual.theta - THETA) / np.sqrt(np.diag(residual.theta_covariance)))
    assert np.abs(np.array(errors)[:, 0]).mean() < 2.5
    assert abs(float(np.mean([e[0] for e in errors]))) < 2


@pytest.mark.slow
def test_detection_holds_its_level(emulator: Emulator) -> None:
    """Over all causes together, on fabrics whose scatter is the atlas' own."""
    generator = np.random.default_rng(4)
    fabric = fabric_of(emulator, *drawn_fabric(emulator, generator))
    model = fabric.model(fabric.against())
    limit = np.quantile(detection_statistic(model, generator.standard_normal((400, len(model.white)))), 0.95)
    alarms = 0
    for _ in range(40):
        one = fabric_of(emulator, *drawn_fabric(emulator, generator))
        model = one.model(one.against())
        alarms += detection_statistic(model, model.white[None])[0] > limit
    assert alarms <= 6  # of 40; twice the level and more would show


def test_what_a_stiffer_cloth_explains_is_not_detectable(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction that moves the drape far beyond the noise, but nearly as stiffness does, needs more than that."""
    hypothesis = next(one for one in hypotheses(emulator) if one.name == "bending-friction")
    monkeypatch.setattr(power, "hypotheses", lambda emulator: [hypothesis])  # to save time
    detectable = detectable_at(emulator, float(THETA[0]), {}, fabrics=1)
    seen = against_base(emulator, expected_features(emulator, THETA, 12), start=THETA, fixed=True)
    value = {"ratio": np.array([detectable["bending-friction"]])}
    moved = shifts(emulator, hypothesis, THETA, seen.sd, seen.drift, value).features
    means = np.linalg.norm(faces_of(moved[0]) * np.sqrt(12))
    assert means > 8 * np.linalg.norm(seen.whiten(moved))  # most of the shift is the base parameters' own


def test_an_effect_needs_the_size_that_a_test_of_its_level_finds_in_four_of_five_fabrics(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a test whose power is known: the sum of squares is noncentral chi squared for any direction."""
    rows: list[int] = []

    def squares(model: SetModel, white: np.ndarray) -> np.ndarray:
        rows.append(white.shape[1])
        return (white**2).sum(1)

    monkeypatch.setattr(power, "detection_statistic", squares)
    found = needed(emulator, Calibration(), np.random.default_rng(0), draws=1500)
    limit = chi2.ppf(0.95, rows[0])
    size = brentq(lambda size: ncx2.sf(limit, rows[0], size**2) - 0.8, 3.0, 8.0)
    assert len(found) > 10
    assert list(found.values()) == pytest.approx([size] * len(found), abs=0.3)


def test_a_density_does_not_hang_on_the_units_of_the_rows(emulator: Emulator) -> None:
    """They are those of the best base parameters, and densities of several are compared."""
    residual = residual_of(emulator, *drawn_fabric(emulator, np.random.default_rng(7)))
    rows = np.ones(len(residual.kept))
    rows[SPREAD] = 2.0  # entries of `SPREADS` are in no unit of theirs
    coarser = replace(residual, sd=2 * residual.sd, root=residual.root * (rows / 2)[residual.kept, None])
    assert coarser.log_likelihood == pytest.approx(residual.log_likelihood)


def test_creep_is_weighed_where_no_capture_is_repeated(emulator: Emulator) -> None:
    """As what acts on every capture, as friction does, which is what the note says."""
    generator = np.random.default_rng(1)
    specimens, _ = drawn_fabric(emulator, generator)
    fabric = FabricData(emulator, Calibration(), features(specimens), None, 0.0)
    assert {"creep", "bending-friction"} <= set(fabric.model(fabric.against()).points.names)


def test_an_effect_that_explains_a_cloth_at_the_end_of_the_atlas_is_no_reason_to_refuse_it(emulator: Emulator) -> None:
    """The limpest cloth, seen 4 % too large, misses its drape coefficient by 12 standard deviations between samples."""
    generator, theta = np.random.default_rng(0), PRIOR_MEAN.copy()
    theta[0] = LOW[0]
    scale = Candidate(next(one for one in hypotheses(emulator) if one.name == "camera-scale"), {"error": 0.04})
    sd, given = emulator.sd(theta), {"error": np.array([0.04])}
    shift = shifts(emulator, scale.hypothesis, theta, sd, 0.5, given).features[0]
    specimens, drift = drawn_fabric(emulator, generator)
    seen = specimens - emulator.mean(THETA) + emulator.mean(theta) + faces_of(shift) * sd
    fabric = fabric_of(emulator, seen, drift)
    at = fabric.against(start=theta, shift=shift, fixed=True)
    (note,) = domain_doubts(emulator, fabric.features, at, fabric.shift([scale], at))
    assert "bending stiffness lies at the lower end" in note
    with pytest.raises(Refused, match="limper than any"):
        domain_doubts(emulator, fabric.features, at, np.zeros_like(shift))


@pytest.mark.parametrize(
    ("bending", "coverage", "said"),
    [
        (LOW[0], -0.05, "this cloth is limper than any of the atlas"),
        (LOW[0], 0.2, "its drape coefficient is that of a stiffer one"),
        (HIGH[0], 0.2, "this cloth is stiffer than any of the atlas"),
        (HIGH[0], -0.2, "its drape coefficient is that of a limper one"),
    ],
)
def test_a_cloth_is_called_limper_than_the_atlas_only_where_it_drapes_so(
    emulator: Emulator, bending: float, coverage: float, said: str
) -> None:
    """An outline without folds may be nearest to the limpest cloth, though a middling one covers as much."""
    theta = PRIOR_MEAN.copy()
    theta[0] = bending
    specimens, drift = drawn_fabric(emulator, np.random.default_rng(0))
    seen = specimens - emulator.mean(THETA) + emulator.mean(theta)
    seen[..., NAMES.index("area_dc")] += coverage
    fabric = fabric_of(emulator, seen, drift)
    at = fabric.against(start=theta, fixed=True)
    with pytest.raises(Refused, match=said):
        domain_doubts(emulator, fabric.features, at, np.zeros(len(at.kept)))
