"""Fields of a diagnosis document, its writer and its reader.

`DiagnosisDocument` is the content of `diagnosis.json`. It is immutable. A number that is not known is None, in JSON
null, and never NaN. Reading checks every value and says where a wrong one stands; a missing part is read as unknown,
keys that no field has are passed over.
"""

import json
from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from cusick_bench.diagnosis.document.answer import Baseline, Closure, Location, NextMeasurement, StatedGap
from cusick_bench.diagnosis.document.part import Interval, Part, Probability
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.verdict import Verdict
from cusick_bench.files import BadFile, parse_json, read_text
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS

_MOST_BYTES = 16 << 20


class ParameterValue(Part):
    """Estimated parameter of a cause.

    Attributes:
        value: Best estimate, in `unit`.
        unit: Its unit; "" for a pure number.
    """

    value: float | None = None
    unit: str = ""


class Cause(Part):
    """A cause as the document describes it.

    Attributes:
        effect: Name of a registered effect, `none` or `unknown`.
        stage: Class of the effect: material, history, boundary, contact or imaging; "" for `none` and `unknown`. The
            file's key is `class`.
        probability: That this is the cause; that of a pair stands with its likelier half.
        parameters: Best estimates by name.
        summary: What the effect does, in a sentence.
        pair_with: The other half, where two causes are named together.
    """

    effect: str
    stage: str = Field(default="", validation_alias="class", serialization_alias="class")
    probability: Probability
    parameters: dict[str, ParameterValue] = Field(default_factory=dict)
    summary: str = ""
    pair_with: str | None = None


class GroupGap(Part):
    """The gap in one group of statistics.

    Attributes:
        gap: Between data and base model [1].
        floor: Between two halves of the data [1].
    """

    gap: float | None = None
    floor: float | None = None


class Gap(StatedGap):
    """The gap as the document describes it.

    Attributes:
        effect: Between data and base model with the named cause [1]; None without one.
        groups: The gap by group of statistics.
    """

    effect: float | None = None
    groups: dict[str, GroupGap] = Field(default_factory=dict)


class StepCause(Part):
    """A cause that was taken off the difference between data and base model.

    Attributes:
        effect: Its name.
        parameters: Best estimates by name, in the units of the effect's registered parameters.
        log_evidence: ln of its evidence over that of no further cause.
        misfit_left: Mean square of the whitened difference that is left; 1 where all is explained.
    """

    effect: str
    parameters: dict[str, float] = Field(default_factory=dict)
    log_evidence: float | None = None
    misfit_left: float | None = None


class Steps(Part):
    """Causes taken off one after the other until no further one shows.

    Attributes:
        causes: In the order in which they were taken off.
        misfit: Mean square of the whitened difference before the first one.
        closure: Share of the gap that all of them together close; None where that was not simulated.
        ci90: Its 90 % interval over samples.
    """

    causes: tuple[StepCause, ...] = ()
    misfit: float | None = None
    closure: float | None = None
    ci90: Interval | None = None


class BaseParameters(Part):
    """The best base model; lengths in cloth radii R, stiffness in units of weight, as in `atlas.base_model`.

    Attributes:
        bending: ln of B / (rho g R^3), B the geometric mean of the bending stiffness in warp and weft.
        anisotropy: ln of B_warp / B_weft.
        bias: ln of B at 45 degrees over B.
        growth: ln of B at a curvature of 40 /m over B at 0.
        shear: ln of shear stiffness / (rho g R).
        laying: ln of the height in which the cloth is laid down, standard deviation over 1 mm.
        rest: ln of the rest shape's height over 0.3 mm.
    """

    bending: float | None = None
    anisotropy: float | None = None
    bias: float | None = None
    growth: float | None = None
    shear: float | None = None
    laying: float | None = None
    rest: float | None = None


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
        base: Mean of the base model.
        effect: Mean of the base model with the named cause.
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
    """Outline of one drape, as the camera sees it.

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
        effect: The same with the named cause.
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
    """What made the document.

    Attributes:
        version: Version of the code.
        command: Command that makes it again.
        atlas: What the atlas holds.
    """

    version: str = ""
    command: str = ""
    atlas: str = ""


class DiagnosisDocument(Part):
    """The content of `diagnosis.json`.

    Attributes:
        fabric: Name of the fabric.
        headline: The verdict in a sentence.
        verdict: What is found: no effect, one, one of several, or something that is not on the list.
        gap: How far the simulation is from the data.
        causes: The likeliest first; of those above 0.5 %.
        set90: The fewest causes that hold 90 % of the probability.
        where: Where the cause acts.
        closure: How far the named cause closes the gap.
        next: What to measure next, the most informative first.
        baselines: Answers of simpler methods, by their names.
        steps: Causes taken off one after the other.
        base: The best base model.
        data: How much data there is.
        statistics: Statistics of data and models.
        profiles: Outlines of data and models.
        indistinguishable: Likely causes that no silhouette tells apart.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        provenance: What made the document. The file's key is `made`.
    """

    fabric: str
    headline: str = ""
    verdict: Verdict
    gap: Gap = Gap()
    causes: tuple[Cause, ...] = ()
    set90: tuple[str, ...] = ()
    where: Location = Location()
    closure: Closure = Closure()
    next: tuple[NextMeasurement, ...] = ()
    baselines: dict[str, Baseline] = Field(default_factory=dict)
    steps: Steps = Steps()
    base: BaseParameters = BaseParameters()
    data: DataCounts = DataCounts()
    statistics: tuple[StatisticRow, ...] = ()
    profiles: Profiles = Profiles()
    indistinguishable: tuple[Indistinguishable, ...] = ()
    notes: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    provenance: Provenance = Field(default=Provenance(), validation_alias="made", serialization_alias="made")

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
