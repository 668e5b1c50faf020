"""Every control of a fabric: what is planted in its pictures or known of them, and the right answer.

Planted, at two strengths. The larger is the one that a goal is about; the smaller is half of it.

    shift       the whole picture towards 30 deg: `camera-offset`. The release's own pictures lie off centre towards
                about 120 deg, so that a shift across that neither hides in it nor adds to it.
    scale       about the plate's axis: `camera-scale`
    turn        of the cloth on the plate, clockwise for those that lie face down: `grain-skew`
    blur-cut    blurred by 2 px and cut at another grey level: `threshold`
    pinhole     the shipped meshes through an eye 1.4 and 0.7 m over the plate, as in the published scripts, against
                the same meshes in parallel projection: `perspective`. The scale in the plate's plane stays.
    mirror      pictures of the lower face mirrored left to right, for every second sample and for all. No listed effect
                does that, so none may be named for it.
    shuffle     order of the pictures within each face permuted at random, or order and face together. Then nothing
                depends on order (`creep`), or on order and face.
    halves      one face alone, its samples divided at random into two halves that are called its faces: no effect that
                turns over with the cloth may be named.

Known from the real data, by paired tests of the drape coefficient over samples, which do not use the diagnosis:

    faces       if they differ (p <= .01), an effect that turns over with the cloth; if they agree (p >= .2), none
    drift       if the drape changes from the first capture to the last, `creep`; without drift, not creep
    observations  1 against 2, and 1 against the last of a series over time, in which a drape sinks: `creep`
    slip        two pictures of the release that do not show a drape of their fabric and must be left out

What silhouettes cannot tell from an effect (`single_effects.equivalents`) is as right as the effect itself. A permuted
order or face is not caused by any effect, but equivalents of `creep` may act in the fabric all the same.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal
from zlib import crc32

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.controls.pictures import (
    GrainTurn,
    Magnification,
    MirroredFace,
    OtherCut,
    PictureChange,
    Shift,
)
from cusick_bench.diagnosis.controls.planted_data import (
    captures_shuffled,
    halves_as_faces,
    one_face,
    planted,
    rendered,
    two_observations,
)
from cusick_bench.diagnosis.inference.single_effects.equivalents import EQUIVALENTS
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.resampling import sign_flip_test
from cusick_bench.diagnosis.measure.statistics import columns, specimen_statistics
from cusick_bench.sim.effects import registered

Kind = Literal["planted", "real", "absent", "outside", "null", "slip"]
"""An effect that was planted; one known to be there; effects that cannot be there; a change that is no listed effect;
halves of one face; a picture to leave out."""
Strength = Literal["smaller", "larger", ""]

SHIFT_DIRECTION = 30.0  # [deg]
SHIFTS, SCALES, TURNS, CUTS = (1.5, 3.0), (0.015, 0.03), (2.5, 5.0), (1.0, 2.0)  # [px], [1], [deg], [px]
INVERSE_HEIGHTS = (1 / 1.4, 1 / 0.7)  # [1/m], the second that of the published scripts
LEAST_SAMPLES = 6  # of a fabric under control: a half still has the three that its scatter needs
DIFFERENT, ALIKE = 0.01, 0.2  # p-values up to which faces or captures differ, and from which they agree
_STRENGTHS: Final = ("smaller", "larger")
_SERIES_SHARE = 0.8  # share of the samples that the last observation of a series must have

AS_IT_IS: Final = "as it is"
_PARALLEL: Final = "meshes in parallel projection"


@dataclass(frozen=True)
class Amount:
    """Planted amount of an effect, as its parameters.

    Attributes:
        effect: Name of the effect.
        severity: Value of its severity, in the unit of its parameter; lengths, like those of the estimates, are scaled
            to the atlas' cloth.
        direction: Its direction [deg]; None for an effect without one.
    """

    effect: str
    severity: float
    direction: float | None = None


@dataclass(frozen=True)
class Control:
    """One control of one fabric.

    Attributes:
        fabric: Name of the fabric.
        name: Name of the control, such as `shift`.
        level: How strong, or which part of the data, in words.
        kind: What its right answer is about.
        effects: The right answers, any of which will do; of kinds `absent` and `null` the wrong ones.
        data: The pictures to be diagnosed.
        reference: Name of the data of the same fabric without what was planted; "" if there are none.
        strength: Strength of the planted effect.
        amount: What was planted.
        note: Of kind `slip`: what a note must say.
    """

    fabric: str
    name: str
    level: str
    kind: Kind
    effects: frozenset[str]
    data: DrapeDataset
    reference: str = ""
    strength: Strength = ""
    amount: Amount | None = None
    note: tuple[str, ...] = ()


_SLIPS = (
    ("fabric_1_observations", "Sample_4_Observation_5.jpg", "shrunken-image"),  # its scale is .843
    ("fabric_3", "Sample_7_Capture_3.jpg", "off-centre"),  # by 11 px
)
"""Pictures of the public release that are no drape of their fabric: fabric, end of the file's name, fault."""
_RELEASE = "cusick"


@dataclass(frozen=True)
class FabricUnderControl:
    """A fabric whose diagnosis is to be tried.

    Attributes:
        data: Its pictures alone.
        captures: The same, read.
        halves: How often each of its faces is divided into random halves.
        seed: Seed of permutations and halves.
    """

    data: DrapeDataset
    captures: Captures
    halves: int = 2
    seed: int = 0

    @property
    def name(self) -> str:
        """Name of the fabric."""
        return self.captures.fabric

    def generator(self, control: str, number: int = 0) -> np.random.Generator:
        """Random generator of one control.

        Args:
            control: Name of the control.
            number: Number of the generator, where a control needs several.

        Returns:
            A generator that belongs to fabric, control and number alone.
        """
        return np.random.default_rng([self.seed, crc32(f"{self.name} {control}".encode()), number])

    @cached_property
    def faces(self) -> list[str]:
        """Faces with enough samples to be divided into halves."""
        sides, samples = (self.data.table[name].to_numpy() for name in ("side", "sample"))
        return [side for side in ("up", "down") if len(np.unique(samples[sides == side])) >= LEAST_SAMPLES]

    @cached_property
    def has_meshes(self) -> bool:
        """Whether there are meshes to draw pictures from."""
        return any(self.data.table["mesh"])

    @cached_property
    def repeated(self) -> bool:
        """Whether any face of a sample was photographed more than once."""
        return bool(self.data.table.duplicated(["sample", "side"]).any())


def controls_of(
    fabric: FabricUnderControl, names: Collection[str] = ()
) -> tuple[list[Control], dict[str, DrapeDataset]]:
    """The controls that a fabric's data allow.

    Args:
        fabric: The fabric.
        names: Which of `CONTROLS`; by default all.

    Returns:
        The controls; and the data without what they plant, by name.
    """
    references = {AS_IT_IS: fabric.data}
    if fabric.has_meshes:
        references[_PARALLEL] = rendered(fabric.data, 0.0)
    references |= {_face(side): one_face(fabric.data, side) for side in fabric.faces}
    made = [control for name, make in CONTROLS.items() if name in (names or CONTROLS) for control in make(fabric)]
    used = {control.reference for control in made}
    return made, {name: data for name, data in references.items() if name in used}


def alike(effect: str) -> frozenset[str]:
    """An effect and those that silhouettes do not tell from it.

    Args:
        effect: Name of the effect.

    Returns:
        Their names.
    """
    return frozenset({effect}).union(*(group.effects for group in EQUIVALENTS if effect in group.effects))


def turning_over() -> frozenset[str]:
    """Effects that act the other way round when the cloth is turned over."""
    return frozenset(name for name, effect in registered().items() if effect.face_odd)


def _face(side: str) -> str:
    return f"face {side} alone"


def _planted_controls(
    fabric: FabricUnderControl, name: str, levels: Mapping[str, tuple[PictureChange, Amount]]
) -> Iterator[Control]:
    for strength, (level, (change, amount)) in zip(_STRENGTHS, levels.items(), strict=True):
        yield Control(
            fabric.name, name, level, "planted", alike(amount.effect), planted(fabric.data, change), AS_IT_IS,
            strength, amount,
        )  # fmt: skip


def _pixels_per_metre(protocol: Protocol) -> float:
    """Pixels to a metre of the atlas' cloth."""
    return protocol.px_per_m * protocol.cloth_scale


def _shift(fabric: FabricUnderControl) -> Iterator[Control]:
    per_metre = _pixels_per_metre(fabric.data.protocol)
    yield from _planted_controls(
        fabric,
        "shift",
        {
            f"{distance:g} px": (
                Shift(distance, SHIFT_DIRECTION),
                Amount("camera-offset", distance / per_metre, SHIFT_DIRECTION),
            )
            for distance in SHIFTS
        },
    )


def _scale(fabric: FabricUnderControl) -> Iterator[Control]:
    levels = {f"{100 * error:g} %": (Magnification(error), Amount("camera-scale", error)) for error in SCALES}
    yield from _planted_controls(fabric, "scale", levels)


def _turn(fabric: FabricUnderControl) -> Iterator[Control]:
    levels = {f"{angle:g} deg": (GrainTurn(angle), Amount("grain-skew", angle)) for angle in TURNS}
    yield from _planted_controls(fabric, "turn", levels)


def _blur_cut(fabric: FabricUnderControl) -> Iterator[Control]:
    per_metre = _pixels_per_metre(fabric.data.protocol)
    levels = {f"{out:g} px outwards": (OtherCut(out), Amount("threshold", out / per_metre)) for out in CUTS}
    yield from _planted_controls(fabric, "blur-cut", levels)


def _pinhole(fabric: FabricUnderControl) -> Iterator[Control]:
    if not fabric.has_meshes or fabric.data.protocol.projection != "parallel":
        return
    for strength, inverse in zip(_STRENGTHS, INVERSE_HEIGHTS, strict=True):
        amount = Amount("perspective", inverse * fabric.data.protocol.cloth_scale)
        yield Control(
            fabric.name, "pinhole", f"eye at {1 / inverse:g} m", "planted", alike("perspective"),
            rendered(fabric.data, inverse), _PARALLEL, strength, amount,
        )  # fmt: skip


def _mirror(fabric: FabricUnderControl) -> Iterator[Control]:
    if len(fabric.faces) < 2:
        return
    numbers = np.unique(fabric.data.table["sample"].to_numpy())
    mixed = len(np.unique(numbers % 2)) > 1  # otherwise every second number would be all of them, or none
    counted = () if mixed else tuple(numbers.tolist())
    for strength, every, level in (("smaller", 2, "every second sample"), ("larger", 1, "every sample")):
        data = planted(fabric.data, MirroredFace(every, counted))
        yield Control(fabric.name, "mirror", level, "outside", frozenset(), data, AS_IT_IS, strength)  # pyright: ignore[reportArgumentType]


def _shuffle(fabric: FabricUnderControl) -> Iterator[Control]:
    if not fabric.repeated:
        return
    levels = [("order", False, frozenset({"creep"}))]
    if len(fabric.faces) == 2:
        levels.append(("order and face", True, frozenset({"creep"}) | turning_over()))
    for strength, (level, across, wrong) in zip(_STRENGTHS, levels, strict=False):
        data = captures_shuffled(fabric.data, fabric.generator(f"shuffle {level}"), across_faces=across)
        yield Control(fabric.name, "shuffle", level, "absent", wrong, data, AS_IT_IS, strength)


def _halves(fabric: FabricUnderControl) -> Iterator[Control]:
    for side in fabric.faces:
        for number in range(fabric.halves):
            data = halves_as_faces(fabric.data, side, fabric.generator(f"halves {side}", number))
            level = f"face {side}, {number + 1}"
            yield Control(fabric.name, "halves", level, "null", turning_over(), data, _face(side))


@dataclass(frozen=True)
class _Contrast:
    """A contrast of the data, and which effects are right or wrong answers after its test.

    Attributes:
        name: Name of the control.
        words: What is compared.
        effects: Right answers where the drape coefficient differs.
        wrong: Wrong answers where it does not.
    """

    name: str
    words: str
    effects: frozenset[str]
    wrong: frozenset[str]


def _contrast_control(
    fabric: FabricUnderControl, contrast: _Contrast, values: Float[ndarray, "samples statistics"]
) -> Iterator[Control]:
    """A control of the data as they are, if a paired test of the drape coefficient says what is right."""
    known = values[np.isfinite(values).all(1)][:, list(columns("area_dc"))]
    if len(known) < LEAST_SAMPLES:
        return
    p = sign_flip_test(known, fabric.generator(contrast.name)).p
    if p <= DIFFERENT:
        level = f"{contrast.words} {100 * known.mean():+.1f} points"
        yield Control(fabric.name, contrast.name, level, "real", contrast.effects, fabric.data, AS_IT_IS)
    elif p >= ALIKE:
        yield Control(fabric.name, contrast.name, "alike", "absent", contrast.wrong, fabric.data, AS_IT_IS)


def _faces(fabric: FabricUnderControl) -> Iterator[Control]:
    odd, contrasts = turning_over(), specimen_statistics(fabric.captures).face_odd
    yield from _contrast_control(fabric, _Contrast("faces", "down minus up", odd, odd), 2 * contrasts)


def _drift(fabric: FabricUnderControl) -> Iterator[Control]:
    contrasts = specimen_statistics(fabric.captures).order_odd
    creep = _Contrast("drift", "last minus first", alike("creep"), frozenset({"creep"}))
    yield from _contrast_control(fabric, creep, contrasts)


def _observations(fabric: FabricUnderControl) -> Iterator[Control]:
    numbers, samples = (fabric.data.table[name].to_numpy() for name in ("observation", "sample"))
    enough = _SERIES_SHARE * len(np.unique(samples))
    series = [int(one) for one in np.unique(numbers[numbers > 0]) if len(np.unique(samples[numbers == one])) >= enough]
    if len(series) < 3:
        return
    for strength, second in zip(_STRENGTHS, (series[1], series[-1]), strict=True):
        data = two_observations(fabric.data, series[0], second)
        level = f"{series[0]} against {second}"
        yield Control(fabric.name, "observations", level, "real", alike("creep"), data, strength=strength)


def _slip(fabric: FabricUnderControl) -> Iterator[Control]:
    for cloth, file, fault in _SLIPS:
        if (fabric.data.name, fabric.name) == (_RELEASE, cloth):
            yield Control(
                fabric.name, "slip", file, "slip", frozenset(), fabric.data, AS_IT_IS, note=("left out", file, fault)
            )


CONTROLS: dict[str, Callable[[FabricUnderControl], Iterator[Control]]] = {
    "shift": _shift,
    "scale": _scale,
    "turn": _turn,
    "blur-cut": _blur_cut,
    "pinhole": _pinhole,
    "mirror": _mirror,
    "shuffle": _shuffle,
    "halves": _halves,
    "faces": _faces,
    "drift": _drift,
    "observations": _observations,
    "slip": _slip,
}
"""What makes each control of a fabric."""
