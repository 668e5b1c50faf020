"""Files and folders that belong to no data: hidden ones, and those that archives, disks and file managers add."""

from pathlib import PurePath

_ADDED = ("thumbs.db", "desktop.ini")  # by Windows, into folders of pictures


def is_hidden(folder: str) -> bool:
    """Whether nothing in a folder belongs to the data: hidden ones, `__MACOSX`, and thumbnails of a Synology disk.

    Args:
        folder: Its name.

    Returns:
        True for such a folder.
    """
    return folder.startswith((".", "__")) or folder == "@eaDir"


def is_hidden_file(path: PurePath) -> bool:
    """Whether a file belongs to no data, such as ._NAME, which macOS puts beside NAME.

    Args:
        path: Its path, relative to the folder of the data.

    Returns:
        True for such a file, and for all files in hidden folders.
    """
    return path.name.startswith(".") or path.name.lower() in _ADDED or any(map(is_hidden, path.parts[:-1]))
