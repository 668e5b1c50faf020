"""Which files belong into an installed package: tracked modules, and data that they read.

python tests/support/package_files.py WHEEL     # exit status 1 and a list where the wheel lacks some
"""

import subprocess
import sys
import zipfile
from pathlib import Path

TOP = ("sim", "solvers", "datasets", "leaderboards")  # installed inside cusick_bench
FOR_READERS = (".json", ".png")  # of leaderboards: records and pictures stay in the repository


def tracked(root: Path) -> list[Path]:
    """Files of the repository.

    Args:
        root: The checkout.

    Returns:
        Paths relative to it; symbolic links are left out.

    Raises:
        CalledProcessError: It is no checkout.
    """
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True, check=True)
    paths = [Path(name) for name in listed.stdout.split("\0") if name]
    return [path for path in paths if (root / path).is_file() and not (root / path).is_symlink()]


def package_files(root: Path) -> set[str]:
    """Files that a wheel must hold.

    Args:
        root: The checkout.

    Returns:
        Their paths inside the wheel.
    """
    code = [path for path in tracked(root) if path.parts[0] in (*TOP, "cusick_bench")]
    kept = [path for path in code if not (path.parts[0] == "leaderboards" and path.suffix in FOR_READERS)]
    return {path.as_posix() if path.parts[0] == "cusick_bench" else f"cusick_bench/{path.as_posix()}" for path in kept}


if __name__ == "__main__":
    with zipfile.ZipFile(sys.argv[1]) as archive:
        lacking = package_files(Path(__file__).resolve().parents[2]) - set(archive.namelist())
    print("\n".join(sorted(lacking)), end="\n" if lacking else "")
    sys.exit(bool(lacking))
