"""Base model and cause fitted by simulation, against a world whose answer is known: the atlas with a known error."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, PRIOR_SD, BaseModel
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.feature_rows import faces_of
from cusick_bench.diagnosis.inference.residuals.noise import scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import against_base
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.measure.captures import captures_from_profiles
from cusick_bench.diagnosis.measure.gap import Fold, fit_of
from cusick_bench.diagnosis.measure.statistics import NAMES, capture_statistics
from cusick_bench.diagnosis.simulation import closure
from cusick_bench.diagnosis.simulation.closure import Draping, closures
from cusick_bench.diagnosis.simulation.samples import Simulated, simulate
from cusick_bench.sim.setup import Setup

THETA = PRIOR_MEAN + PRIOR_SD * np.array([0.6, 0.2, 0.0, 0.0, 0.2, 0.1, 0.1, 0.0, 0.0])
NOTHING = np.zeros(len(NAMES))


def drawn(
    emulator: Emulator, theta: np.ndarray, causes: Sequence[Candidate], count: int, seed: int, error: np.ndarray
) -> np.ndarray:
    """Samples of a world that is the atlas, but for an error of its statistics [sd]."""
    root, sd = np.linalg.cholesky(emulator.correlation), emulator.sd(theta)
    noise = np.random.default_rng(seed).standard_normal((count, len(root))) @ root.T
    moved = np.tile(error, 2)
    for one in causes:
        point = {name: np.array([value]) for name, value in one.value.items()}
        moved = moved + faces_of(shifts(emulator, one.hypothesis, theta, sd, 0.5, point).features[0]).ravel()
    return emulator.mean(theta) + ((noise + moved) * np.tile(sd, 2)).reshape(count, 2, -1)


def world(emulator: Emulator, error: np.ndarray) -> Callable[..., Simulated]:
    """Its simulator."""

    def simulate(
        theta: np.ndarray, causes: Sequence[Candidate], samples: int, seed: tuple[int, ...], *,
        warp_seen_down: float, **_: object,
    ):  # fmt: skip
        turned = replace(emulator, warp_seen_down=warp_seen_down)
        return Simulated(drawn(turned, theta, causes, samples, sum(seed), error), np.zeros((samples, 2, 360)))

    return simulate


def hypothesis_of(emulator: Emulator, name: str) -> Hypothesis:
    return next(one for one in hypotheses(emulator) if one.name == name)


def fabric(emulator: Emulator, causes: Sequence[Candidate], error: np.ndarray) -> SampleStatistics:
    specimens = drawn(emulator, THETA, causes, 60, 77, error)
    return SampleStatistics(specimens, np.full((60, len(NAMES)), np.nan), 0.5)


def residual_of(emulator: Emulator, data: SampleStatistics):
    return against_base(emulator, data.features(), scatter=scatter_of(data.specimens), drift=data.later)


def test_severity_between_the_grids_points_is_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plate that slips by 11.5 mm: the grid has 9.3 and 13.9; and the closure is that of the true severity."""
    hypothesis = hypothesis_of(emulator, "plate-slip")
    truth = Candidate(hypothesis, {"slide": 0.0115}, 0.0, 0.0, 0.0)
    taken: list[float] = []
    simulate = world(emulator, NOTHING)

    def noted(theta: np.ndarray, causes: Sequence[Candidate], *rest: object, **named: object) -> Simulated:
        taken.extend(one.value["slide"] for one in causes)
        return simulate(theta, causes, *rest, **named)

    monkeypatch.setattr(closure, "simulate", noted)
    data = fabric(emulator, [truth], NOTHING)
    residual, draping = residual_of(emulator, data), Draping(60)
    kept = closures(emulator, data, residual, [(truth,)], draping, refit=False)[0].gap
    taken.clear()
    start = Candidate(hypothesis, {"slide": 0.002}, 0.0, 0.0, 0.0)
    found = closures(emulator, data, residual, [(start,)], draping)[0].gap
    assert taken[-1] == pytest.approx(0.0115, rel=0.15)
    assert found is not None
    assert kept is not None
    assert found.closure == pytest.approx(kept.closure, abs=0.1)
    assert found.closure > 0.8


@pytest.mark.parametrize("named", ["camera-scale", pytest.param("face-asymmetry", marks=pytest.mark.slow)])
def test_the_nearer_of_two_look_alikes_is_taken(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    """A picture that is too large, named, or with faces that differ named in its place."""
    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    scale = Candidate(hypothesis_of(emulator, "camera-scale"), {"error": 0.06}, 0.0, 0.0, 0.0)
    faces = Candidate(hypothesis_of(emulator, "face-asymmetry"), {"asymmetry": 0.3}, 0.0, 0.0, 0.0)
    data = fabric(emulator, [scale], NOTHING)
    residual, draping, shares = residual_of(emulator, data), Draping(60), []
    first, other = (scale, faces) if named == "camera-scale" else (faces, scale)
    alone = closures(emulator, data, residual, [(first,)], draping)[0].gap
    both = closures(emulator, data, residual, [(first,)], draping, look_alikes={named: other}, progress=shares.append)[
        0
    ].gap
    assert alone is not None
    assert both is not None
    assert both.closure > 0.8
    assert (alone.closure > 0.8) == (named == "camera-scale")
    assert (both.effect == alone.effect) == (named == "camera-scale")
    assert shares == sorted(shares)
    assert shares[-1] < 1


@pytest.mark.slow
def test_the_base_model_is_simulated_as_often_as_the_causes(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where look-alikes are tried: of more tries, the one that is chosen fits better whatever is tried."""
    simulate, without = world(emulator, NOTHING), []

    def counted(theta: np.ndarray, causes: Sequence[Candidate], samples: int, seed: tuple[int, ...], **named: object):
        without.append(not causes)
        return simulate(theta, causes, samples, seed, **named)

    monkeypatch.setattr(closure, "simulate", counted)
    scale = Candidate(hypothesis_of(emulator, "camera-scale"), {"error": 0.06}, 0.0, 0.0, 0.0)
    faces = Candidate(hypothesis_of(emulator, "face-asymmetry"), {"asymmetry": 0.3}, 0.0, 0.0, 0.0)
    data = fabric(emulator, [scale], NOTHING)
    found = residual_of(emulator, data)
    closures(emulator, data, found, [(scale,)], Draping(8), look_alikes={"camera-scale": faces})
    each = closure.CORRECTIONS + 2
    assert without == 2 * (each * [True] + each * [False])


def test_errors_of_the_atlas_are_mended(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where drapes turn out softer than the atlas promises, the base model takes a stiffer cloth, its gap shrinks."""
    sd = emulator.sd(THETA)
    softer = (emulator.mean(THETA - 0.5 * np.eye(len(THETA))[0]) - emulator.mean(THETA)) / sd
    monkeypatch.setattr(closure, "simulate", world(emulator, softer))
    data = fabric(emulator, [], NOTHING)
    residual = residual_of(emulator, data)
    gaps = []
    for rounds in (0, closure.CORRECTIONS):
        monkeypatch.setattr(closure, "CORRECTIONS", rounds)
        gap = closures(emulator, data, residual, [()], Draping(60))[0].gap
        assert gap is not None
        gaps.append(gap.base)
    assert gaps[1] < 0.5 * gaps[0]


@pytest.mark.slow
def test_alternatives_share_the_base_model(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each alternative has its closure; creep, of which the gap sees nothing, has none and adds nothing."""
    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    scale = Candidate(hypothesis_of(emulator, "camera-scale"), {"error": 0.06}, 0.0, 0.0, 0.0)
    creep = Candidate(hypothesis_of(emulator, "creep"), {"loss": 0.3}, 0.0, 0.0, 0.0)
    data = fabric(emulator, [scale], NOTHING)
    shares: list[float] = []
    alternatives = [(), (scale,), (creep,), (scale, creep)]
    alone, right, later, both = closures(
        emulator, data, residual_of(emulator, data), alternatives, Draping(60), progress=shares.append
    )
    assert alone.gap is not None
    assert right.gap is not None
    assert later.gap is not None
    assert alone.gap.base == right.gap.base == later.gap.base
    assert np.isnan(alone.gap.closure)
    assert np.isnan(later.gap.closure)
    assert alone.effect is None
    assert right.effect is not None
    assert right.gap.closure > 0.6
    assert both.gap is not None
    assert both.gap.closure == right.gap.closure
    assert shares == sorted(shares)
    assert shares[-1] <= 1


@pytest.mark.slow
def test_closure_is_the_same_however_the_cloth_is_turned_over(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A camera beside its place, of cloths turned about y and about x."""
    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    offset = Candidate(hypothesis_of(emulator, "camera-offset"), {"shift": 6e-3, "direction": 20.0}, 0.0, 0.0, 0.0)
    found = []
    for warp in (np.pi, 0.0):
        turned = replace(emulator, warp_seen_down=warp)
        data = fabric(turned, [offset], NOTHING)
        gap = closures(turned, data, residual_of(turned, data), [(offset,)], Draping(60), refit=False)[0].gap
        assert gap is not None
        found.append(gap.closure)
    assert found[0] == pytest.approx(found[1], abs=0.05)
    assert found[0] > 0.8


def test_directions_of_the_laboratory_in_simulated_drapes_of_a_cloth_turned_about_x(emulator: Emulator) -> None:
    """The warp of such a cloth points to x on either face: 20 degrees of the laboratory are -20 of the lower face."""
    lab, cloth = (one for one in hypotheses(emulator) if one.name == "camera-offset")
    assert (lab.frame, cloth.frame) == ("lab", "cloth")
    turned = Candidate(lab, {"shift": 6e-3, "direction": 20.0}, 0.0, 0.0, 0.0)
    same = Candidate(cloth, {"shift": 6e-3, "direction": 340.0}, 0.0, 0.0, 0.0)
    model = BaseModel(vertices=250)
    one, other = (
        simulate(THETA, [cause], 1, (3,), model=model, warp_seen_down=warp)
        for cause, warp in ((turned, 0.0), (same, np.pi))
    )
    assert one.specimens[:, 1] == pytest.approx(other.specimens[:, 1])
    assert one.specimens[:, 0] != pytest.approx(other.specimens[:, 0])
    assert one.radii[:, 1] == pytest.approx(other.radii[:, 1])


@pytest.mark.parametrize("samples", [2, 3])
def test_too_few_samples_have_pictures_but_no_gap(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, samples: int
) -> None:
    """All of them are fitted, so that none is left unseen."""
    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    scale = Candidate(hypothesis_of(emulator, "camera-scale"), {"error": 0.06}, 0.0, 0.0, 0.0)
    every = fabric(emulator, [scale], NOTHING)
    data = replace(every, specimens=every.specimens[:samples], drift=every.drift[:samples])
    (found,) = closures(emulator, data, residual_of(emulator, data), [(scale,)], Draping(8))
    assert found.gap is None
    assert len(found.base.specimens) == 8
    assert found.effect is not None


@pytest.mark.parametrize("down", [slice(1, None, 2), slice(6, None)])
def test_folds_have_each_face_in_whatever_order_samples_show_them(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, down: slice
) -> None:
    """Every other sample was of one face where samples show the faces in turn, and there was no gap."""
    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    every = fabric(emulator, [], NOTHING)
    specimens = every.specimens[:12].copy()
    lower = np.isin(np.arange(12), np.arange(12)[down])
    specimens[lower, 0] = specimens[~lower, 1] = np.nan
    data = replace(every, specimens=specimens, drift=every.drift[:12])
    (found,) = closures(emulator, data, residual_of(emulator, data), [()], Draping(8))
    assert found.gap is not None
    assert np.isfinite(found.gap.base)


def test_distance_to_what_is_fitted() -> None:
    generator = np.random.default_rng(1)
    near, far = generator.standard_normal((2, 14, 2, len(NAMES)))
    sd = np.ones(len(NAMES))
    both = (0, 1)
    assert abs(fit_of(near, far, sd, both)) < 0.2 < fit_of(near, far + 1.0, sd, both)
    assert fit_of(near[:1], far, sd, both) == np.inf


def test_folds_of_few_samples_are_fitted_on_both_faces(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """As they are scored, though a fold alone has too few samples to tell."""
    compared: list[tuple[int, ...]] = []

    def noted(data: np.ndarray, model: np.ndarray, sd: np.ndarray, faces: tuple[int, ...]) -> float:
        compared.append(faces)
        return fit_of(data, model, sd, faces)

    monkeypatch.setattr(closure, "simulate", world(emulator, NOTHING))
    monkeypatch.setattr(closure, "fit_of", noted)
    every = fabric(emulator, [], NOTHING)
    data = replace(every, specimens=every.specimens[:6], drift=every.drift[:6])
    closures(emulator, data, residual_of(emulator, data), [()], Draping(8))
    assert set(compared) == {(0, 1)}


def test_no_fold_is_fitted_to_the_samples_that_score_it(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each half is scored once by models of the other half; those of a fold are draped from the same random numbers."""
    fitted: list[np.ndarray] = []
    scored: list[np.ndarray] = []
    seeds: list[tuple[int, ...]] = []
    simulate = world(emulator, NOTHING)

    def drape(theta: np.ndarray, causes: Sequence[Candidate], samples: int, seed: tuple[int, ...], **named: object):
        seeds.append(seed)
        return simulate(theta, causes, samples, seed, **named)

    def noted(data: np.ndarray, *_: object) -> float:
        fitted.append(data)
        return 0.0

    def folded(folds: list[Fold], *_: object) -> None:
        scored.extend(fold.data for fold in folds)

    def at_once(*data: object, **named: object):  # which base parameters fit best is of no matter here
        return against_base(*data, **named | {"start": THETA, "fixed": True})  # pyright: ignore[reportArgumentType]

    for name, one in (("simulate", drape), ("fit_of", noted), ("gap", folded), ("against_base", at_once)):
        monkeypatch.setattr(closure, name, one)
    scale = Candidate(hypothesis_of(emulator, "camera-scale"), {"error": 0.06}, 0.0, 0.0, 0.0)
    every = fabric(emulator, [scale], NOTHING)
    data = replace(every, specimens=every.specimens[:8], drift=every.drift[:8])
    residual = at_once(emulator, data.features(), scatter=scatter_of(data.specimens), drift=data.later)
    closures(emulator, data, residual, [(scale,)], Draping(8), refit=False)
    models = 2 * (1 + closure.CORRECTIONS)  # drapes of a fold: without and with the cause
    assert (len(scored), len(fitted), len(seeds)) == (2, 2 * models, 2 * models)
    for fold, seen in enumerate(scored):
        own = fitted[fold * models : (fold + 1) * models]
        assert all((one == own[0]).all() for one in own)
        samples = [*map(np.sum, own[0]), *map(np.sum, seen)]
        assert len(set(samples)) == len(samples) == 8
    assert (scored[0] == fitted[-1]).all()
    assert len(set(seeds[:models])) == len(set(seeds[models:])) == 1
    assert seeds[0] != seeds[-1]


def test_pictures_count_by_the_share_of_later_ones(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of creep, which acts on later pictures: here as discs that have sunk a tenth of their radius."""

    def sunk(setups: Sequence[Setup], simulators: object) -> list[torch.Tensor]:
        assert [one.capture for one in setups] == ([2, 4] if setups[0].later else [1, 3])
        return [torch.as_tensor(one.mesh.flat * (0.9 if one.later else 1.0)) for one in setups]

    monkeypatch.setattr("cusick_bench.diagnosis.simulation.samples.drape_setups", sunk)
    creep = Candidate(hypothesis_of(emulator, "creep"), {"loss": 0.3}, 0.0, 0.0, 0.0)
    model, radius = BaseModel(vertices=100), NAMES.index("mean_radius")
    first, mixed, last = (
        simulate(THETA, [creep], 1, (3,), drift=drift, model=model).specimens[..., radius] for drift in (0.0, 0.25, 1.0)
    )
    assert last == pytest.approx(0.9 * first)
    assert mixed == pytest.approx((1 - 0.25 * 0.1) * first)


def test_outlines_are_in_the_cameras_frame_and_statistics_in_the_cloths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Discs that a camera sees beside the middle: as statistics of pictures like these are."""

    def beside(setups: Sequence[Setup], simulators: object) -> list[torch.Tensor]:
        return [torch.as_tensor(one.mesh.flat) + torch.tensor([4e-3, 2e-3, 0.0]) for one in setups]

    monkeypatch.setattr("cusick_bench.diagnosis.simulation.samples.drape_setups", beside)
    found = simulate(THETA, [], 2, (3,), model=BaseModel(vertices=100))
    outlines = found.radii.reshape(-1, 360)
    assert (np.abs(outlines.argmax(1) - 27) <= 20).all(), "towards 27 degrees, on either face"
    seen = captures_from_profiles(
        outlines, sample=np.repeat([1, 2], 2), side=["up", "down"] * 2, capture=np.ones(4, dtype=int)
    )
    expected = capture_statistics(seen.cloth_frame()).reshape(found.specimens.shape)
    assert found.specimens == pytest.approx(expected, abs=1e-9)
