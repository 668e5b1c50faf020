"""Words and numbers of the page of a diagnosis: causes, statistics, probabilities, rounding."""

import numpy as np
import pytest
from made_up_diagnosis import statistic

from cusick_bench.diagnosis.atlas.base_model import DENSITY, NAMES, cloth
from cusick_bench.diagnosis.document.model import BaseParameters, DataCounts, DiagnosisDocument, StatisticRow
from cusick_bench.diagnosis.measure.statistics import NAMES as STATISTICS
from cusick_bench.report.diagnosis.sections.statistics import ShownStatistic, statistic_table
from cusick_bench.report.diagnosis.wording.effect_words import physics, signature
from cusick_bench.report.diagnosis.wording.number_format import measure, percent, plain
from cusick_bench.report.diagnosis.wording.words import (
    cloth_in_words,
    data_in_words,
    entropy_of,
    statistic_name,
    worth,
)
from cusick_bench.sim.effects import registered
from cusick_bench.sim.laws.plate import curvature_shares, plate_stiffness


def test_cloth_in_words_is_the_base_models_cloth():
    theta = np.array([-6.5, 0.4, 0.1, 0.2, 4.0, 0.2, -0.3, 0.1, -0.2])
    rows = cloth_in_words(
        BaseParameters(**dict(zip(NAMES, theta.tolist(), strict=True))), DataCounts(areal_density_kg_m2=DENSITY)
    )
    values = {meaning: value for _, value, meaning in rows}
    material = cloth(theta)
    mean = float(material.bending[0, 0] * material.bending[2, 0]) ** 0.5
    assert values["at 150 g/m²"] == f"{1e6 * mean:.2g} µN m"
    ratio = float(material.bending[0, 0] / material.bending[2, 0])
    assert values["factor between the bending stiffness of the two"] == f"× {ratio:.2f}"
    assert len(cloth_in_words(BaseParameters(bending=-6.5), DataCounts())) == 1


@pytest.mark.parametrize(("micro", "shown"), [(8.04, "8.0"), (73.4, "73"), (99.8, "100"), (124.3, "124")])
def test_stiffness_is_written_without_exponent(micro, shown):
    data = DataCounts(areal_density_kg_m2=0.4)
    weight = 0.4 * data.gravity_m_s2 * data.cloth_radius_m**3
    rows = cloth_in_words(BaseParameters(bending=np.log(1e-6 * micro / weight)), data)
    assert rows[1] == ("", f"{shown} µN m", "at 400 g/m²")


@pytest.mark.parametrize(
    ("up", "down", "faces"),
    [
        (24, 24, "(24 face up and 24 face down)"),
        (48, 0, "(48 face up and 0 face down)"),
        (0, 0, "(48 whose face is not known)"),
        (24, 0, "(24 face up and 24 whose face is not known)"),
    ],
)
def test_pictures_whose_face_is_not_known_are_counted(up, down, faces):
    counts = DataCounts(samples=12, captures=48, up=up, down=down, later=24)
    assert data_in_words(counts).startswith(f"12 samples, 48 pictures {faces}, 24 repeats")


def test_the_ratio_of_stiffness_is_that_of_weft_to_warp():
    """D11 is the stiffness of bending along x, the warp."""
    theta = np.zeros(len(NAMES))
    theta[NAMES.index("anisotropy")] = np.log(2)
    material, shares, d = cloth(theta), np.zeros((3, 5)), np.zeros((3, 4))
    curvature_shares(0.0, shares)
    plate_stiffness(material.bending.numpy(), float(material.poisson), shares, d)
    values = {name: value for name, value, _ in cloth_in_words(BaseParameters(anisotropy=np.log(2)), DataCounts())}
    assert d[0, 1] / d[0, 0] == pytest.approx(2)
    assert values["weft to warp"] == "× 2.00"


@pytest.mark.parametrize(
    ("name", "sign"),
    [
        ("creep", "later pictures of a drape only"),
        ("rest-curvature", "opposite way when the sample lies on its other face"),
        ("plate-tilt", "Keeps its direction on the bench"),
        ("camera-scale", "Changes the picture"),
        ("local-mass-patch", "Stays at its place"),
        ("rim-stiffening", "alike on both faces"),
    ],
)
def test_a_cause_is_known_by_what_it_would_show(name, sign):
    assert sign in signature(name)
    assert signature("no-such-effect") == ""


def test_an_effect_of_the_bench_that_turns_with_the_cloth_is_not_said_to_keep_its_direction():
    assert "Keeps its direction" not in signature("off-centre", True)
    assert "Turns over with the cloth" in signature("off-centre", True)


def test_every_statistic_and_effect_has_words():
    words = [statistic_name(name) for name in STATISTICS]
    assert len(set(words)) == len(words)
    assert not any("_" in word for word in words)
    assert {name for name in registered() if not signature(name)} <= {"plate-slip"}
    assert "`" not in "".join(physics(name) for name in registered())


def shown(*statistics: dict) -> list[ShownStatistic]:
    rows = tuple(StatisticRow(**one) for one in statistics)
    return statistic_table(DiagnosisDocument(fabric="", verdict="effect", statistics=rows)).rows


def test_rounding_errors_are_shown_as_nothing():
    rounded = statistic("harmonic_1_real", "harmonics", "m", (-0.0021, -0.0019, 0.0, 2.2e-19), -5.5)
    tiny = statistic("harmonic_1_real", "harmonics", "m", (2.2e-19, 1e-19, 0.0, 1e-19), 5.5)
    assert shown(rounded)[0].effect == "0"
    assert shown(tiny)[0].up == "2.20e-16"


def test_scores_point_the_way_the_data_lie():
    below = statistic("area_dc", "size", "1", (0.40, 0.46, 0.45, 0.41), 3.0)
    above = statistic("mean_radius", "size", "m", (0.12, 0.14, 0.121, 0.125), 2.0)
    signed = statistic("folds", "number", "1", (7.0, 7.0, 6.0, 6.5), -1.0)
    rows = shown(above, below)
    assert [(row.name, row.z) for row in rows] == [("drape coefficient", "−3.0"), ("mean radius", "+2.0")]
    assert (rows[1].up, rows[1].unit) == ("120", "mm")
    assert [row.z for row in shown(signed, below)] == ["+3.0", "−1.0"], "one sign is enough for all to be as written"


def test_bits_are_read_against_the_doubt_that_is_left():
    doubt = entropy_of([0.5, 0.25, 0.25])
    assert doubt == pytest.approx(1.5)
    assert "nearly all" in worth(1.4, doubt)
    assert "about half" in worth(0.75, doubt)
    assert "little" in worth(0.05, doubt)
    assert "little doubt is left" in worth(0.01, entropy_of([0.999]))


def test_numbers_are_rounded_without_lying():
    assert [percent(share) for share in (0.0, 0.001, 0.5, 0.999, 1.0, None)] == [
        "0\u00a0%", "<\u00a01\u00a0%", "50\u00a0%", ">\u00a099\u00a0%", "100\u00a0%", "–",
    ]  # fmt: skip
    assert [percent(0.005), percent(0.995)] == ["<\u00a01\u00a0%", ">\u00a099\u00a0%"], "not 0 % and 100 %"
    assert [plain(value) for value in (0.0874, -0.0021, 12345.0, 0.0)] == ["0.087", "−0.0021", "12345", "0"]
    assert measure(0.0021, "m") == "2.1\u00a0mm"
    assert measure(40.0, "deg") == "40°"
    assert measure(0.2, "1") == measure(0.2, "") == "0.20"
