"""Fields of a diagnosis document, its writer and its reader.

`DiagnosisDocument` is the content of `diagnosis.json`. It is immutable. A number that is not known is None, in JSON
null, and never NaN. Reading checks every value and says where a wrong one stands; a missing part is read as unknown,
keys that no field has are passed over.
"""

import json
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field

from cusick_bench.diagnosis.document.answer import (
    Baseline,
    BudgetShare,
    Closure,
    Location,
    NextMeasurement,
    StatedGap,
    Unexplained,
)
from cusick_bench.diagnosis.document.part import Interval, Map, Part, Probability
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.findings.verdict import Verdict
from cusick_bench.files import BadFile, parse_json, read_text
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS

_MOST_BYTES = 16 << 20


class ParameterValue(Part):
    """Estimated parameter of a cause.

    Attributes:
        value: Best estimate, in `unit`.
        unit: Its unit; "1" for a pure number, "" where the effect is not registered here.
        ci90: The shortest interval that holds it and has 90 % of the probability, given that the effect acts; of a
            direction the upper end may exceed 360.
    """

    value: float | None = None
    unit: str = ""
    ci90: Interval | None = None


class Cause(Part):
    """A cause as the document describes it.

    Attributes:
        effect: Name of a registered effect, `none` or `unknown`.
        stage: Class of the effect: material, history, boundary, contact or imaging; "" for `none` and `unknown`. The
            file's key is `class`.
        probability: That it accounts for most; those of all causes add up to 1.
        acting: That it acts, alone or with others; None for `none` and `unknown`.
        parameters: Best estimates by name.
        summary: What the effect does, in a sentence.
        named: Whether it is in the named set.
        shared: Whether it is the laboratory's, shown by all fabrics of the data set.
        turns_with_cloth: Whether its direction, by its nature the laboratory's, was found to turn over with the cloth.
    """

    effect: str
    stage: str = Field(default="", validation_alias="class", serialization_alias="class")
    probability: Probability
    acting: Probability | None = None
    parameters: dict[str, ParameterValue] = Field(default_factory=dict)
    summary: str = ""
    named: bool = False
    shared: bool = False
    turns_with_cloth: bool = False

    @property
    def likelihood_of_acting(self) -> float:
        """Probability that it acts; for `none`, `unknown` and older files, that it accounts for most."""
        return self.probability if self.acting is None else self.acting


class GroupGap(Part):
    """The gap in one group of statistics.

    Attributes:
        gap: Between data and base model [1].
        floor: What chance alone exceeds in one of twenty cases [1].
    """

    gap: float | None = None
    floor: float | None = None


class Gap(StatedGap):
    """The gap as the document describes it.

    Attributes:
        effect: Between data and base model with the named effects [1]; None without one.
        groups: The gap by group of statistics.
    """

    effect: float | None = None
    groups: dict[str, GroupGap] = Field(default_factory=dict)


class EffectSet(Part):
    """A set of effects that may act together.

    Attributes:
        effects: Their names.
        probability: That these act and no others.
    """

    effects: tuple[str, ...] = ()
    probability: Probability


class Fit(Part):
    """Goodness of fit of base model and effects, in units of noise.

    Attributes:
        base: Mean square of the whitened difference between data and base model; 1 where the base model holds.
        novelty_p: Probability that the likeliest set leaves so much, in statistics that no base model may get wrong,
            where nothing else acts.
        misfit: Size of what the base model gets wrong in the others [standard deviations of noise].
    """

    base: float | None = None
    novelty_p: Annotated[float, Field(ge=0, le=1)] | None = None
    misfit: float | None = None


class BaseParameters(Part):
    """The best base model; lengths in cloth radii R, stiffness in units of weight, as in `atlas.base_model`.

    Where any effect is said to act it is the best one together with the likeliest set of them.

    Attributes:
        bending: ln of B / (rho g R^3), B the geometric mean of the bending stiffness in warp and weft.
        anisotropy: ln of B_weft / B_warp.
        bias: ln of B at 45 degrees over B.
        growth: ln of B at a curvature of 40 /m over B at 0.
        shear: ln of shear stiffness / (rho g R).
        laying: ln of the height in which the cloth is laid down, standard deviation over 1 mm.
        rest: ln of the rest shape's height over 0.3 mm.
        length: ln of the length of the waves in which the cloth is laid down over 20 mm.
        between: ln of the standard deviation of ln B between samples over 0.1.
    """

    bending: float | None = None
    anisotropy: float | None = None
    bias: float | None = None
    growth: float | None = None
    shear: float | None = None
    laying: float | None = None
    rest: float | None = None
    length: float | None = None
    between: float | None = None


class DataCounts(Part):
    """The data that were diagnosed.

    Attributes:
        samples: Number of cut pieces.
        captures: Number of silhouettes.
        up: Those of the upper face.
        down: Those of the lower face.
        later: Those that are not the first of their sample and face.
        areal_density_kg_m2: Mass per area [kg/m2].
        cloth_radius_m: Radius of the flat cloth [m]; the document's lengths are those of a cloth of 150 mm.
        plate_radius_m: Radius of the plate [m].
        gravity_m_s2: Gravity [m/s2].
    """

    samples: int | None = None
    captures: int | None = None
    up: int | None = None
    down: int | None = None
    later: int | None = None
    areal_density_kg_m2: float | None = None
    cloth_radius_m: float = CLOTH_RADIUS
    plate_radius_m: float = PLATE_RADIUS
    gravity_m_s2: float = GRAVITY


class StatisticRow(Part):
    """A statistic of the silhouettes, in data and models.

    Attributes:
        name: As in `measure.statistics`.
        group: Group of statistics that it belongs to.
        unit: Unit of `up`, `down`, `base` and `effect`: `m`, `m/rad` or `1`.
        up: Mean over the data's samples, upper face.
        down: The same, lower face.
        base: Mean of the base model, over the faces that the data show.
        effect: The same of the base model with the named effects.
        z: Difference between data and base model in standard errors, of the face that differs more.
    """

    name: str
    group: str = ""
    unit: str = ""
    up: float | None = None
    down: float | None = None
    base: float | None = None
    effect: float | None = None
    z: float | None = None


class Profile(Part):
    """Outline of one drape, as the camera sees it; of a cloth that lies face down, as if it was turned over about y.

    Attributes:
        sample: Number of the sample.
        side: Face that lies up: `up`, `down`, or "" where it is not known.
        radii_m: Radii at equidistant angles counter-clockwise from the camera's x axis [m].
    """

    sample: int | None = None
    side: Literal["up", "down", ""] = ""
    radii_m: tuple[float, ...]


class Profiles(Part):
    """Outlines of data and models.

    Attributes:
        data: Profiles of the data.
        base: Profiles of simulated drapes of the base model.
        effect: The same with the named effects.
    """

    data: tuple[Profile, ...] = ()
    base: tuple[Profile, ...] = ()
    effect: tuple[Profile, ...] = ()


class Indistinguishable(Part):
    """Causes that no silhouette tells apart.

    Attributes:
        effects: Their names.
        why: What they share.
    """

    effects: tuple[str, ...]
    why: str = ""


class Provenance(Part):
    """Version, command and atlas that made the document.

    Attributes:
        version: Version of the code.
        command: Command that makes it again.
        atlas: What the atlas holds.
    """

    version: str = ""
    command: str = ""
    atlas: str = ""


class Resolution(Part):
    """How wide the region of the named patch is under fresh noise, in the median of many noises.

    Attributes:
        angle_deg: Its angle [deg].
        radius_m: From its inner to its outer radius, of the atlas' cloth [m].
    """

    angle_deg: float | None = None
    radius_m: float | None = None


class MappedLocation(Location):
    """Where the cause acts, beside what the map would be without a cause.

    Attributes:
        null_map: Mean of the maps of noise alone; None where the map is none of a patch.
        null_p: p of noise alone: share of its maps whose likeliest place is at least as likely as that of `map`.
        resolution: How finely the place of the named patch can be told; None where none is named.
    """

    null_map: Map | None = None
    null_p: Probability | None = None
    resolution: Resolution | None = None


class DiagnosisDocument(Part):
    """The content of `diagnosis.json`.

    Attributes:
        fabric: Name of the fabric.
        headline: The verdict in a sentence.
        verdict: What is found: no effect, one, several, one of some, or something that is not on the list.
        effects: The named set, the likeliest first.
        groups: Look-alikes of which one acts beside the named set.
        budget: Which share of the gap each effect takes: the named ones, and the likeliest of each group.
        unexplained: What they leave.
        gap: How far the simulation is from the data.
        causes: Those that are named, act with 2 % or account for most with 0.5 %; by the latter, the likeliest first.
        set90: The fewest causes that hold 90 % of the probability.
        where: Where the cause acts.
        closure: How far the named effects close the gap.
        next: What to measure next, the most informative first.
        baselines: Answers of simpler methods, by their names.
        sets: Sets of effects, the likeliest first; of those above 0.5 %.
        fit: How well base model and effects fit.
        with_effect: Arguments of `--with-effect` that simulate the causes together, in the lengths of the data's cloth.
        base: The best base model.
        data: How much data there is.
        statistics: Statistics of data and models.
        profiles: Outlines of data and models.
        indistinguishable: Likely causes that no silhouette tells apart.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        refused: Why there is no diagnosis, where there is none.
        provenance: What made the document. The file's key is `made`.
    """

    fabric: str
    headline: str = ""
    verdict: Verdict
    effects: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    budget: tuple[BudgetShare, ...] = ()
    unexplained: Unexplained = Unexplained()
    gap: Gap = Gap()
    causes: tuple[Cause, ...] = ()
    set90: tuple[str, ...] = ()
    where: MappedLocation = MappedLocation()
    closure: Closure = Closure()
    next: tuple[NextMeasurement, ...] = ()
    baselines: dict[str, Baseline] = Field(default_factory=dict)
    sets: tuple[EffectSet, ...] = ()
    fit: Fit = Fit()
    with_effect: tuple[str, ...] = ()
    base: BaseParameters = BaseParameters()
    data: DataCounts = DataCounts()
    statistics: tuple[StatisticRow, ...] = ()
    profiles: Profiles = Profiles()
    indistinguishable: tuple[Indistinguishable, ...] = ()
    notes: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    refused: str | None = None
    provenance: Provenance = Field(default=Provenance(), validation_alias="made", serialization_alias="made")

    @property
    def ranked_causes(self) -> list[Cause]:
        """The causes as readers want them: those that the verdict names first, each part the likeliest to act first."""
        named = set(self.effects)
        return sorted(self.causes, key=lambda cause: (cause.effect not in named, -cause.likelihood_of_acting))

    @property
    def share_left(self) -> float | None:
        """What effects leave of the gap; None where none takes a share, since all of it would be no finding."""
        return self.unexplained.share if self.budget else None

    @property
    def held_together(self) -> tuple[str, ...]:
        """Effects that `with_effect` simulates together, the largest shift first."""
        return tuple(argument.partition(":")[0] for argument in self.with_effect)

    def write(self, path: Path) -> None:
        """Writes the document as a JSON file, which appears whole or not at all.

        Args:
            path: The file; its folder must be there.
        """
        write_atomically(path, json.dumps(self.content(), allow_nan=False).encode())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Reads a file that `write` has written.

        Args:
            path: The file.

        Returns:
            The document.

        Raises:
            DiagnosisError: There is no such file, it is not JSON, or a value is missing or wrong; the message names
                its place.
        """
        try:
            content = read_text(path, most_bytes=_MOST_BYTES, remedy="give a diagnosis.json")
            parse_json(content, path, remedy="make it anew with `cusick-bench diagnose`")  # no key twice, none too deep
        except BadFile as error:
            raise DiagnosisError(str(error)) from error
        return cls.parse(content, str(path))
