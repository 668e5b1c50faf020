"""The vocabulary of statistics: the values of before it was one, and what its selections have in common.

`silhouette_statistics.json` holds what the scores, the diagnosis and the inference computed when each had definitions
of its own (commit 1f80c55). `python tests/datasets/test_silhouette_statistics.py` writes it anew by today's
definitions: only after a definition was changed on purpose. Those of the laboratory with a cloth of 16 cm radius have
been: what softens ratios is in proportion to the cloth.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.silhouette_statistics.definitions import LOCKED
from cusick_bench.datasets.silhouette_statistics.selections import DIAGNOSED, INFERRED, SCORED, Selection, numbered

GOLDEN = Path(__file__).with_name("silhouette_statistics.json")
SELECTIONS = {"scored": SCORED, "diagnosed": DIAGNOSED, "inferred": INFERRED}
COEFFICIENTS = np.array([0.2, 0.5, 0.8])
LAB = {"cloth_radius": 0.16, "plate_radius": 0.08}


def rings() -> np.ndarray:
    """Three profiles with 40 random harmonics, most at seven folds."""
    generator, orders = np.random.default_rng(3), np.arange(1, 41)
    size = np.where(orders <= 3, 1.5e-3, 4e-3 / (1 + ((orders - 7) / 3.0) ** 2))
    waves = np.outer(orders, np.arange(720) * 2 * np.pi / 720)
    cosines, sines = generator.standard_normal((2, 3, 40)) * size
    return 0.122 + cosines @ np.cos(waves) + sines @ np.sin(waves)


def measured() -> dict[str, dict[str, list[float]]]:
    """Every statistic of the three profiles, by selection."""
    result = {}
    for label, selection in SELECTIONS.items():
        lab = LAB if label == "diagnosed" else {}
        values = selection.measure(rings(), drape_coefficients=COEFFICIENTS, **lab)
        result[label] = dict(zip(selection.names, values.T.tolist(), strict=True))
    return result


def test_values_are_those_of_before():
    golden = json.loads(GOLDEN.read_text())
    assert {label: list(values) for label, values in golden.items()} == {
        label: list(selection.names) for label, selection in SELECTIONS.items()
    }
    for label, values in measured().items():
        for name, value in values.items():
            assert value == pytest.approx(golden[label][name], rel=1e-11, abs=1e-16), (label, name)


LENGTHS = ("mean_radius", "amplitude_high", "fold_depth", "roughness", "crest_radius", "crest_spread", "valley_gap")
LENGTHS_BY_NUMBER = (
    "radius_quantile_",
    "quantile_",
    "amplitude_",
    "harmonic_",
    "crest_1",
    "crest_2",
    "valley_1",
    "valley_2",
)


@pytest.mark.parametrize("depth", [1.0, 0.3, 0.1, 0.01])
def test_drapes_of_one_shape_have_the_same_statistics_whatever_their_size(depth):
    """What softens ratios, and the least prominence of a fold, are in proportion to the cloth."""
    shape, small = 0.122 + depth * (rings() - 0.122), 0.4
    for selection in SELECTIONS.values():
        known, found = (
            selection.measure(
                size * shape, drape_coefficients=COEFFICIENTS, cloth_radius=size * 0.15, plate_radius=size * 0.09
            )
            for size in (1.0, small)
        )
        for column, name in enumerate(selection.names):
            unit = small if name in LENGTHS or name.startswith(LENGTHS_BY_NUMBER) else 1.0
            assert found[:, column] == pytest.approx(unit * known[:, column], rel=1e-9, abs=1e-12), name


@pytest.mark.parametrize("family", LOCKED)
def test_locked_statistics_turn_with_the_drape(family):
    """By exp(i m phi), the grain by exp(-i m phi), as the comment at `LOCKED` says."""
    order, steps = 1, 40
    selection = Selection((), (f"{family}_{order}_real", f"{family}_{order}_imaginary"))
    before, after = (selection.measure(radii) @ [1, 1j] for radii in (rings(), np.roll(rings(), steps, axis=1)))
    sign = -1 if family == "grain" else 1
    assert after == pytest.approx(before * np.exp(sign * 2j * np.pi * order * steps / 720), rel=1e-9, abs=1e-15)


def test_a_name_means_the_same_in_every_selection():
    scored, diagnosed = (
        dict(zip(selection.names, selection.measure(rings(), drape_coefficients=COEFFICIENTS).T, strict=True))
        for selection in (SCORED, DIAGNOSED)
    )
    shared = set(scored) & set(diagnosed)
    assert {"mean_radius", "amplitude_7", "folds", "skewness", "harmonic_2_real"} <= shared
    for name in shared:
        np.testing.assert_array_equal(scored[name], diagnosed[name], err_msg=name)


def test_selections_have_columns_and_any_order_is_kept():
    names = ("folds", "harmonic_3_imaginary", *numbered("radius_quantile", (50, 5)), "mean_radius")
    own = Selection(names[:1] + names[2:], names[1:2])
    values = own.measure(rings())
    assert own.names == ("folds", "radius_quantile_50", "radius_quantile_05", "mean_radius", "harmonic_3_imaginary")
    assert own.columns("mean_radius", "folds") == (3, 0)
    np.testing.assert_allclose(values[:, 1], np.median(rings(), axis=1))
    np.testing.assert_allclose(values[:, 2], np.quantile(rings(), 0.05, axis=1))
    np.testing.assert_allclose(values[:, 3], rings().mean(1))
    sines = 2 * np.mean(rings() * np.sin(3 * np.arange(720) * 2 * np.pi / 720), axis=1)
    np.testing.assert_allclose(values[:, 4], sines, atol=1e-15)


def test_locked_statistics_turn_and_the_others_do_not():
    still, turned = (DIAGNOSED.measure(np.roll(rings(), steps, axis=1)) for steps in (0, 90))
    free = len(DIAGNOSED.phase_free)
    np.testing.assert_allclose(turned[:, :free], still[:, :free], rtol=1e-9, atol=1e-12)
    assert np.abs(turned[:, free:] - still[:, free:]).max() > 1e-3


@pytest.mark.parametrize("gap", [0.02, 0.003, 0.0, -0.006, -0.02])
def test_statistics_of_a_circle_beside_the_plate_are_known(gap):
    """Nearness falls by e for every fifteenth of the overhang, and no longer rises two of them inside the plate."""
    names = ("crest_radius", "crest_spread", "valley_gap", "plate_nearness", "area_dc", "fold_depth", "roughness")
    radius, reach = 0.09 + gap, 0.06 / 15
    (found,) = Selection(names, ()).measure(np.full((1, 720), radius))
    expected = [
        radius,
        0,
        gap,
        np.exp(-max(gap, -2 * reach) / reach),
        (radius**2 - 0.09**2) / (0.15**2 - 0.09**2),
        0,
        0,
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["fold", "amplitude", "amplitude_x", "harmonic_1", "harmonic_1_phase", "folds_3"])
def test_unknown_names_are_refused(name):
    with pytest.raises(DataError, match=f"unknown statistic '{name}'; use one of .*amplitude_N, harmonic_N_real"):
        Selection((name,), ()).measure(rings())


def test_profiles_that_cannot_be_measured_are_refused():
    with pytest.raises(DataError, match="at least 49 angles, got"):
        INFERRED.measure(rings()[:, ::20])
    with pytest.raises(DataError, match="must be finite"):
        INFERRED.measure(np.full((1, 720), np.nan))
    with pytest.raises(DataError, match="orders 1 to 2, got 3"):
        Selection((), ("crest_3_real",)).measure(rings())
    with pytest.raises(DataError, match="pass drape_coefficients, or ask for area_dc"):
        SCORED.measure(rings())


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(measured(), indent=1) + "\n")
