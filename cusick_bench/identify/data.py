"""The data set of a folder: the folder itself, or a data set made from its photographs."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path

from PIL import Image, UnidentifiedImageError
from pydantic import ValidationError

from cusick_bench.datasets import REGISTRY
from cusick_bench.datasets.files.entry import is_image_folder
from cusick_bench.datasets.files.fabrics import FILE as FABRICS
from cusick_bench.datasets.files.layout import scan
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL
from cusick_bench.files import BadFile, read_json_object
from cusick_bench.files.digest import digests_below
from cusick_bench.files.first_names import first_names
from cusick_bench.files.hidden import is_hidden_file
from cusick_bench.identify.document import Preparation, Refused
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.workspace import Workspace, edited, fingerprint, keep, kept, recorded
from cusick_bench.photographs import NUMERICS_VERSION
from cusick_bench.photographs.preparation.pictures import Pictures, find_pictures
from cusick_bench.photographs.preparation.prepare import Preparation as Prepared
from cusick_bench.photographs.preparation.prepare import Setting, prepare, require_free
from cusick_bench.photographs.preparation.setting_text import SettingText, setting_of
from cusick_bench.photographs.reading import SUFFIXES, UNREAD_SUFFIXES

_RULERS = ("board", "plate")  # beginnings of names of pictures that calibrate a camera
_MARKS = (PROTOCOL, FABRICS)
_NEW = ".data"  # the data set that takes the place of the earlier one as soon as it is whole


def require_same_folder(given: str, workspace: Workspace) -> None:
    """Refuses a workspace with the answer about another folder, which would be lost.

    One about a folder that is not there any more, since it was moved or renamed, gives way.

    Args:
        given: Folder, or name of a data set.
        workspace: Where its answer is to lie.

    Raises:
        IdentifyError: The workspace holds the answer about another folder or data set.
    """
    try:
        document = read_json_object(workspace.document, remedy="")
    except BadFile:  # there is none, or a damaged one, which is written anew
        return
    folder, data = str(document.get("folder", "")), str(document.get("data", ""))
    there = folder in REGISTRY or (bool(folder) and Path(folder).exists())
    if there and place_of(given) not in (place_of(folder), place_of(data)):
        raise IdentifyError(
            f"--out {workspace.out} holds the identification of {folder}, which that of {given} would replace; give "
            f"another --out, or remove {workspace.document}"
        )


def place_of(given: str) -> str | Path:
    """Where a folder lies, from wherever it was given.

    Args:
        given: Folder, or name of a data set.

    Returns:
        The whole path; of a data set its name.
    """
    return given if given in REGISTRY else Path(given).resolve()


def holds_photographs(folder: Path) -> bool:
    """Whether a folder holds photographs to be prepared, rather than a data set.

    A data set has a protocol.json, a fabrics.csv or a folder of silhouettes; photographs have a ruler (board*.jpg or
    plate.jpg). Where neither is there, silhouettes are square pictures, and photographs are not.

    Args:
        folder: The folder.

    Returns:
        Whether it does.

    Raises:
        IdentifyError: It is no folder, or holds no pictures at all.
    """
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise IdentifyError(f"{folder}: {what}; give a folder of photographs, or a data set: {', '.join(REGISTRY)}")
    marked = any((place / name).exists() for place in (folder, folder / "data") for name in _MARKS)
    if marked or any(is_image_folder(path.name) and path.is_dir() for path in folder.glob("**/[sS][iI][lL]*")):
        return False
    files = [
        path for path in sorted(folder.rglob("*")) if path.is_file() and not is_hidden_file(path.relative_to(folder))
    ]
    pictures = [path for path in files if path.suffix.lower() in SUFFIXES]
    if not pictures and any(path.suffix.lower() in UNREAD_SUFFIXES for path in files):
        return True  # to be refused as such
    if not pictures:
        raise IdentifyError(
            f"{folder} holds no pictures; give photographs such as Fabric_1_Sample_2_Capture_1.jpg with "
            "board-plane.jpg or plate.jpg as ruler, or a data set with fabrics.csv and folders `Fabric N/silhouettes`; "
            "see docs/drape-meter.md"
        )
    if any(path.stem.lower().startswith(_RULERS) for path in pictures):
        return True
    return not _is_square(pictures[0])


def _is_square(path: Path) -> bool:
    try:
        with Image.open(path) as image:
            return image.width == image.height
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError):
        return False


def as_data_set(
    given: str,
    workspace: Workspace,
    text: SettingText,
    image_size: int,
    begin: Callable[[int], None] = lambda count: None,
    done: Callable[[str], None] = lambda name: None,
) -> tuple[str, Preparation | None]:
    """The data set behind a folder.

    Args:
        given: Folder, or name of a data set.
        workspace: Where the data set of photographs is kept.
        text: What one tells of the photographs.
        image_size: Width of the silhouettes that photographs become [px].
        begin: Called with the number of photographs, where some are going to be read.
        done: Called with the name of each that is finished.

    Returns:
        Name or folder of the data set, and how it was made of photographs, None where it was not.

    Raises:
        IdentifyError: The folder is neither, options do not suit it, or no photograph can be used.
        BadPhotograph: Anything about the photographs that one has to mend first.
        DataError: Nothing in the folder is named as the layout names it.
    """
    if given in REGISTRY or not holds_photographs(Path(given)):
        told = [name for name, value in asdict(text).items() if value != getattr(SettingText(), name)]
        told += ["image_size"] if image_size != Setting.image_size else []
        if told:
            options = ", ".join(f"--{name.replace('_', '-')}" for name in told)
            raise IdentifyError(
                f"{given} is a data set, and {options} {'is' if len(told) == 1 else 'are'} about photographs; write "
                "weights into fabrics.csv and sizes into protocol.json beside the data"
            )
        if given not in REGISTRY:
            scan(given)
        return given, None
    return str(workspace.data), _prepared(Path(given), workspace, text, image_size, begin, done)


def _prepared(
    folder: Path,
    workspace: Workspace,
    text: SettingText,
    image_size: int,
    begin: Callable[[int], None],
    done: Callable[[str], None],
) -> Preparation:
    """Photographs as a data set in the workspace, made anew only where they, options or the code have changed."""
    found = find_pictures(folder)
    _require_text(_files(found))
    setting = replace(setting_of(text, folder, sorted({one.fabric for one in found.drapes})), image_size=image_size)
    workspace.prepare()
    shown = [one.name for one in found.drapes]  # which a folder's name may say, and not the file's
    decided = {"folder": folder.resolve(), "setting": asdict(setting), "drapes": shown, "numerics": NUMERICS_VERSION}
    key = fingerprint(decided, _files(found))
    record = workspace.data_record
    if workspace.data.is_dir() and (earlier := kept(record, key)) is not None:
        try:
            return _usable(Preparation.model_validate_json(str(earlier["preparation"])), workspace)
        except (KeyError, ValidationError):
            pass
    if record.exists() and not recorded(record):
        raise IdentifyError(f"{record} was not written by an identification; choose another --out, or move it away")
    written = recorded(record).get("files")
    if workspace.data.is_dir() and isinstance(written, dict):
        _require_unedited(workspace, written)
    else:  # what no record tells the files of is not ours to remove
        _require_empty(folder, workspace.data)
    begin(len(found.drapes))
    new, old = workspace.out / _NEW, workspace.out / f"{_NEW}.old"
    for left in (new, old):  # by a crash
        shutil.rmtree(left, ignore_errors=True)
    preparation = _described(prepare(folder, new, setting, done))
    files = digests_below(new)
    if workspace.data.exists():
        workspace.data.rename(old)  # of other photographs or options
    keep(record, "", {"files": files})
    new.rename(workspace.data)
    keep(record, key, {"preparation": preparation.model_dump_json(), "files": files})
    shutil.rmtree(old, ignore_errors=True)
    return _usable(preparation, workspace)


def _require_text(paths: list[Path]) -> None:
    """Refuses names with bytes that are no UTF-8, such as those of an old archive: no record can hold them."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError as error:
            raise IdentifyError(f"{path}: names of photographs and their folders must be UTF-8; rename it") from error


def _require_empty(photographs: Path, folder: Path) -> None:
    """Refuses a folder that holds anything, also the table of weights that `data prepare` leaves where it is."""
    require_free(photographs, folder)
    if folder.is_dir() and (there := sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))):
        raise IdentifyError(
            f"{folder} holds {first_names(there)}, and the data set of the photographs is made in its place; move it "
            "away (--weights takes a table from anywhere), or choose another --out"
        )


def _require_unedited(workspace: Workspace, written: Mapping[str, str]) -> None:
    """Refuses to remove what somebody has changed in the data set."""
    if changed := edited(workspace.data, written):
        raise IdentifyError(
            f"{workspace.data} has to be made again, since photographs, options or this program have changed, and was "
            f"edited after it had been made ({first_names(changed)}); move it away to keep what you changed, or delete "
            "it, and repeat the command"
        )


def _files(found: Pictures) -> list[Path]:
    rulers = [path for path in (found.board_on_plate, found.plate) if path is not None]
    return [one.path for one in found.drapes] + [*found.boards_held, *rulers]


def _described(prepared: Prepared) -> Preparation:
    view = prepared.view
    return Preparation(
        photographs=len(prepared.pictures),
        refused=tuple(
            Refused(path=str(one.picture.path), fabric=one.picture.fabric, confidence=one.confidence, why=one.doubts)
            for one in prepared.doubtful
        ),
        calibration=view.source,
        scale_sd=float(view.uncertainty.scale),
        camera_height_m=float(view.eye[2]) if view.knows_height else None,
    )


def _usable(preparation: Preparation, workspace: Workspace) -> Preparation:
    if len(preparation.refused) == preparation.photographs:
        reasons = "; ".join(dict.fromkeys(why for one in preparation.refused for why in one.why)) or "low confidence"
        raise IdentifyError(
            f"none of {preparation.photographs} photographs has a sure outline ({reasons}); look at "
            f"{workspace.data / 'check'}, and take them again on another ground or in softer light"
        )
    return preparation
