"""Fields of `identify.json`, its writer and its reader.

A number that is not known is None, in JSON null, and never NaN; where a part of a fabric's answer is missing, a
sentence says why. Paths are relative to the folder of the document where they lie in it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cusick_bench.files import BadFile, read_text
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.runner.store import write_atomically

_MOST_BYTES = 64 << 20

Positive = Annotated[float, Field(gt=0)]


class Part(BaseModel):
    """A part of the document: immutable, and every value has the type that its field states."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False, extra="forbid")


class Spread(Part):
    """A number measured on several drapes.

    Attributes:
        value: Mean over units, a unit being one face of one sample.
        sd: Standard deviation between units; None of a single one.
    """

    value: float
    sd: float | None = None


class Drapes(Part):
    """Measurements of a fabric's silhouettes, without any simulation.

    Attributes:
        samples: Number of cut pieces with a usable picture.
        silhouettes: Number of pictures.
        units: Faces of samples that were measured.
        unusable: Pictures that cannot be read or have a wrong scale.
        drape_coefficient: Share of the overhang that the drape covers, ISO 9073-9 [1]; None where no picture is usable.
        folds: Number of folds.
        down_minus_up: Difference of the drape coefficient between the faces; None where not both were seen.
    """

    samples: int
    silhouettes: int
    units: int
    unusable: int = 0
    drape_coefficient: Spread | None = None
    folds: Spread | None = None
    down_minus_up: float | None = None


class Stiffness(Part):
    """A stiffness with its interval.

    Attributes:
        value: Median of the posterior.
        ci90: Its 5 % and 95 % quantiles; None of a solver without posterior.
    """

    value: Positive
    ci90: tuple[Positive, Positive] | None = None


class Fit(Part):
    """Fit of a typical drape, which may also have learned from other samples.

    Attributes:
        image: The silhouette, a path in the data set.
        sample: Number of its sample.
        samples: Samples that the stiffness was learned from, that one and others.
        faces: Faces of them that it was learned from, 1 or 2.
        turned: How many of these samples it was learned from with the other face up, too.
        drape_coefficient: Its drape coefficient.
        simulated_drape_coefficient: That of the fitted drape.
        mse: Mean squared error of the fitted silhouette.
        finished: Whether the solver came to its end within the budget.
        stiffness: Bending stiffness of warp, weft and bias [N m].
        stretch: Membrane stiffness of warp, weft and shear [N/m].
        solver: Who fitted it.
        drapes: What that cost, in simulated drapes.
        path: Folder of the result.
    """

    image: str
    sample: int
    samples: int = 1
    faces: int = 1
    turned: int = 0
    drape_coefficient: float | None = None
    simulated_drape_coefficient: float | None = None
    mse: float | None = None
    finished: bool = True
    stiffness: dict[str, Stiffness]
    stretch: dict[str, Stiffness]
    solver: str
    drapes: float
    path: str


class Diagnosed(Part):
    """The outcome of a diagnosis; all of it stands in its own document and page.

    Attributes:
        verdict: As in `diagnosis.json`; `refused` where nothing can be said.
        headline: The same in a sentence.
        effects: Named effects, the likeliest first.
        p: p-value of the base model.
        closure: Share of the gap that they close; None where there is no gap, or nothing was simulated.
        bending: Bending stiffness of the base model that fits all samples best, the geometric mean of warp and weft
            [N m]; it has no interval, and is None where the weight is not known.
        path: `diagnosis.json`.
        page: Its page.
    """

    verdict: Literal["none", "effect", "several", "ambiguous", "unknown", "refused"]
    headline: str
    effects: tuple[str, ...] = ()
    p: float | None = None
    closure: float | None = None
    bending: Positive | None = None
    path: str
    page: str


class Rank(Part):
    """Rank of a number among measured fabrics.

    Attributes:
        percent: Share of the fabrics that have less [%]; 1 may be less, and 99 more.
        ci90: That share at the ends of the number's interval; None without one.
    """

    percent: float
    ci90: tuple[float, float] | None = None


class Compared(Part):
    """One number of a fabric among those of measured fabrics.

    Attributes:
        quantity: Bending stiffness or bending length.
        direction: Warp, weft or bias of the fitted drape; the mean of warp and weft of all samples.
        value: The number [N m or m].
        ci90: Its interval; None where there is none.
        among_all: Its rank among all measured fabrics.
        among_similar: Its rank among those of similar weight.
    """

    quantity: Literal["bending", "bending_length"]
    direction: Literal["warp", "weft", "bias", "mean"]
    value: Positive
    ci90: tuple[Positive, Positive] | None = None
    among_all: Rank
    among_similar: Rank


class Comparison(Part):
    """A fabric among measured ones.

    Attributes:
        fabrics: Number of measured fabrics.
        similar_fabrics: Those of similar weight.
        similar_kg_m2: Weights from which and below which that is [kg/m2]; None instead of infinity.
        numbers: Bending stiffness and bending length by direction.
        summary: How stiff the fabric is for its weight, in words.
    """

    fabrics: int
    similar_fabrics: int
    similar_kg_m2: tuple[float, float | None]
    numbers: tuple[Compared, ...]
    summary: str


class FabricIdentity(Part):
    """All that was found of one fabric.

    Attributes:
        fabric: Its name in the data set.
        areal_density: Mass per area [kg/m2]; None if unknown.
        drapes: What its silhouettes show.
        fit: Its stiffness; None where `fit_missing` says why.
        fit_missing: Why there is no stiffness; "" where there is one.
        comparison: Its stiffness among measured fabrics; None where there is none.
        diagnosis: What the simulator leaves out; None where `diagnosis_missing` says why.
        diagnosis_missing: Why there is no diagnosis; "" where there is one.
        notes: What is in doubt.
        next: What to do next, the most urgent first.
    """

    fabric: str
    areal_density: Positive | None = None
    drapes: Drapes
    fit: Fit | None = None
    fit_missing: str = ""
    comparison: Comparison | None = None
    diagnosis: Diagnosed | None = None
    diagnosis_missing: str = ""
    notes: tuple[str, ...] = ()
    next: tuple[str, ...] = ()


class Refused(Part):
    """A photograph whose outline was not sure enough to be used.

    Attributes:
        path: The photograph.
        fabric: Number of the fabric that it shows.
        confidence: Score from 0 to 1 of how likely its outline is right.
        why: Reasons against it.
    """

    path: str
    fabric: int
    confidence: float
    why: tuple[str, ...] = ()


class Preparation(Part):
    """How photographs became a data set.

    Attributes:
        photographs: Number of photographs of drapes.
        refused: Those that were not used.
        calibration: What the camera was calibrated from.
        scale_sd: Relative standard deviation of the scale.
        camera_height_m: Height of the camera above the plate [m]; None if unknown.
    """

    photographs: int
    refused: tuple[Refused, ...] = ()
    calibration: str = ""
    scale_sd: float | None = None
    camera_height_m: float | None = None


class Made(Part):
    """Version, command and atlas that made the document.

    Attributes:
        command: Command that makes it again.
        version: Version of the code.
        options: How it was asked to identify.
    """

    command: str
    version: str
    options: dict[str, Any] = Field(default_factory=dict)


class IdentifyDocument(Part):
    """The content of `identify.json`.

    Attributes:
        folder: Photographs or data set that were given.
        data: Folder of the data set that was used.
        dataset_hash: Hash of its content.
        preparation: How photographs became that data set; None where a data set was given.
        cloth_radius_m: Radius of the flat cloth [m].
        plate_radius_m: Radius of the plate [m].
        fabrics: What was found, fabric by fabric.
        next: What to do next about the laboratory as a whole.
        made: What made the document.
    """

    folder: str
    data: str
    dataset_hash: str
    preparation: Preparation | None = None
    cloth_radius_m: Positive
    plate_radius_m: Positive
    fabrics: tuple[FabricIdentity, ...]
    next: tuple[str, ...] = ()
    made: Made

    @property
    def faults(self) -> int:
        """Photographs that were refused, and fits that failed though the data allow one."""
        failed = sum(one.fit_missing.startswith(FAILED) for one in self.fabrics)
        return failed + (len(self.preparation.refused) if self.preparation else 0)

    def content(self) -> dict[str, Any]:
        """The document as JSON values."""
        return self.model_dump(mode="json")

    def write(self, path: Path) -> None:
        """Writes the document as a JSON file, which appears whole or not at all.

        Args:
            path: The file; its folder must be there.
        """
        write_atomically(path, (json.dumps(self.content(), indent=1, allow_nan=False) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Reads a file that `write` has written.

        Args:
            path: The file.

        Returns:
            The document.

        Raises:
            IdentifyError: There is no such file, or a value is missing or wrong; the message names its place.
        """
        remedy = "make it anew with `cusick-bench identify`"
        try:
            return cls.model_validate_json(read_text(path, most_bytes=_MOST_BYTES, remedy=remedy))
        except BadFile as error:
            raise IdentifyError(str(error)) from error
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False)[0]
            place = ".".join(str(key) for key in first["loc"]) or "document"
            raise IdentifyError(f"{path} is no valid identification: {place}: {first['msg']}; {remedy}") from error


FAILED = "the fit failed"
"""How the reason begins where a fit was tried and failed."""
UNWEIGHED = "its weight is not known"
"""How it begins where no fit was tried for want of a weight."""
UNUSABLE = "none of its pictures can be used"
"""How it begins where no fit was tried for want of a picture."""
NO_PHYSICS = "has no physics and finds no stiffness"
"""What it says where the solver finds none."""
