"""Words of commands in messages, in quotes where the system's shell needs them."""

import shlex
import subprocess
import sys


def shell_word(word: object) -> str:
    """A word of a command as it can be typed into a shell.

    Args:
        word: Such as a path.

    Returns:
        The word, in quotes where it needs any.
    """
    # cmd.exe takes single quotes for part of a name, and `shlex` writes them about every backslash.
    return subprocess.list2cmdline([str(word)]) if sys.platform == "win32" else shlex.quote(str(word))
