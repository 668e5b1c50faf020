"""Lists the packages: four top-level folders are installed inside `cusick_bench` (see `pyproject.toml`)."""

from setuptools import find_packages, setup

package_dir = {"cusick_bench": "cusick_bench"}
for folder in ("sim", "solvers", "datasets", "leaderboards"):
    package_dir[f"cusick_bench.{folder}"] = folder
    for nested in find_packages(folder):
        package_dir[f"cusick_bench.{folder}.{nested}"] = f"{folder}/{nested.replace('.', '/')}"

# Without symbolic links (a clone on Windows) the first list lacks the four folders, so both are joined.
packages = {*find_packages(include=["cusick_bench", "cusick_bench.*"]), *package_dir}
setup(packages=sorted(packages), package_dir=package_dir)
