"""Eleven faults that tests must catch: each is planted into a copy of the checkout, where the tests named must fail.

python tests/faults/planted_faults.py [NAME ...]     # exit status 1 where a fault is not caught; minutes

The same tests must pass in the copy before anything is planted. No fault lies in a compiled kernel: what calls it would
be compiled anew, which takes a minute more.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS_FAILED = 1  # pytest's exit status; others mean that the tests did not run


@dataclass(frozen=True)
class Fault:
    """A fault as a change of text.

    Attributes:
        name: What kind of fault it is.
        meaning: What goes wrong.
        file: Changed file, relative to the checkout.
        old: Text that stands in it exactly once.
        new: What takes its place.
        test: Test that must fail, as pytest names it.
    """

    name: str
    meaning: str
    file: str
    old: str
    new: str
    test: str

    def planted(self, text: str) -> str:
        """The file's text with the fault.

        Args:
            text: Without it.

        Returns:
            With it.

        Raises:
            ValueError: The old text does not stand there exactly once.
        """
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: its old text stands {text.count(self.old)} times in {self.file}, not once")
        return text.replace(self.old, self.new)


FAULTS = (
    Fault(
        "sign of a force",
        "gravity pulls the cloth up",
        "sim/engine/triangles/system.py",
        "force[..., 2] -= system.gravity * self.p.mass",
        "force[..., 2] += system.gravity * self.p.mass",
        "tests/sim/test_drape.py::test_cloth_stays_on_its_plate_and_hangs_around_it",
    ),
    Fault(
        "wrong clamp",
        "the cloth on the plate's edge hangs free",
        "sim/drape.py",
        "radius <= s.plate_radius + edge, np.zeros",
        "radius < s.plate_radius - edge, np.zeros",
        "tests/sim/test_drape.py::test_cloth_on_the_edge_of_the_plate_is_held",
    ),
    Fault(
        "swapped faces",
        "the rest shape is that of the other face",
        "sim/setup.py",
        'return angle if self.side == "up" else -angle',
        'return -angle if self.side == "up" else angle',
        "tests/sim/effects/test_effects_material.py::test_a_strip_without_weight_curls_to_its_radius_towards_its_face",
    ),
    Fault(
        "unseeded draw",
        "the laid-down shape is another one each time",
        "sim/drape.py",
        "generator = np.random.default_rng([seed, 0])",
        "generator = np.random.default_rng()",
        "tests/sim/test_drape.py::test_the_same_drape_twice_is_bitwise_the_same",
    ),
    Fault(
        "off-by-one fold",
        "the highest harmonic that belongs to folds is left out",
        "sim/cloth/folds.py",
        "spectrum[harmonics + 1 :] = 0",
        "spectrum[harmonics:] = 0",
        "tests/datasets/test_datasets_profile.py::test_folds_are_the_peaks_of_that_prominence",
    ),
    Fault(
        "ignored protocol",
        "fits are simulated under the standard's gravity, whatever the data's protocol says",
        "cusick_bench/runner/cell_problem.py",
        ", plate_radius=protocol.plate_radius_m, gravity=protocol.gravity_m_s2)",
        ", plate_radius=protocol.plate_radius_m)",
        "tests/runner/test_run_protocol.py::test_a_fit_follows_the_protocol_of_its_data",
    ),
    Fault(
        "forgotten scale",
        "pictures are scored as if they had the release's scale, centre and sizes",
        "cusick_bench/runner/cell.py",
        "repeat_pairs=pairs, protocol=dataset.protocol)",
        "repeat_pairs=pairs)",
        "tests/protocol/test_other_labs.py::test_a_small_cloth_is_fitted_and_scored_in_its_own_size",
    ),
    Fault(
        "dropped capture",
        "a diagnosis does not see a fabric's first picture",
        "cusick_bench/diagnosis/measure/captures.py",
        "for row in range(len(chosen)):",
        "for row in range(1, len(chosen)):",
        "tests/diagnosis/measure/test_diagnosis_captures.py::test_captures_are_read_with_their_labels",
    ),
    Fault(
        "stale cache",
        "a picture read by another protocol keeps the measures of the first",
        "datasets/files/measure.py",
        'key = f"image-{content_hash(path)}-{name}"',
        'key = f"image-{content_hash(path)}"',
        "tests/datasets/test_measure_cache.py::test_another_protocol_measures_the_same_picture_again",
    ),
    Fault(
        "wrong unit",
        "degrees are taken for radians",
        "sim/effects/directions.py",
        "angle = torch.as_tensor(degrees, dtype=torch.float64) * (math.pi / 180)",
        "angle = torch.as_tensor(degrees, dtype=torch.float64)",
        "tests/sim/effects/test_effects_boundary.py::test_a_tilted_plate_rests_under_turned_gravity",
    ),
    Fault(
        "swallowed error",
        "a solver that fails counts as done",
        "cusick_bench/runner/cell.py",
        "        raise_stop(error)\n        outcome = _failed(error)\n",
        '        raise_stop(error)\n        outcome = _failed(error) | {"status": "done"}\n',
        "tests/runner/test_cells.py::TestCells::test_one_failure_stays_alone_and_is_tried_again",
    ),
)


def copy_checkout(target: Path, root: Path = ROOT) -> None:
    """Copies the tracked files as they are now, with symbolic links.

    Args:
        target: New folder.
        root: The checkout.
    """
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        source, place = root / name, target / name
        if source.is_symlink() or source.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, place, follow_symlinks=False)


def run_tests(checkout: Path, tests: list[str]) -> subprocess.CompletedProcess[str]:
    """Runs tests of a copy against its own code.

    Args:
        checkout: The copy.
        tests: Names of tests.

    Returns:
        pytest's exit status and output.
    """
    environment = os.environ | {"PYTHONPATH": str(checkout), "CUSICK_BENCH_CACHE": str(checkout / "cache")}
    where = "import cusick_bench, sys; sys.exit(not cusick_bench.__file__.startswith(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", where, str(checkout)], env=environment, cwd=checkout, check=True)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    return subprocess.run(command, env=environment, cwd=checkout, capture_output=True, text=True)


def main(names: list[str]) -> int:
    """Plants the faults one after the other and says which are caught.

    Args:
        names: Of faults; all by default.

    Returns:
        0 if each is caught.
    """
    chosen = [fault for fault in FAULTS if not names or fault.name in names]
    with tempfile.TemporaryDirectory(prefix="planted-faults-") as folder:
        checkout = Path(folder).resolve() / "checkout"
        copy_checkout(checkout)
        sound = run_tests(checkout, sorted({fault.test for fault in chosen}))
        if sound.returncode:
            print(f"tests fail without any fault:\n{sound.stdout[-3000:]}{sound.stderr[-1000:]}")
            return 1
        missed = 0
        for fault in chosen:
            path = checkout / fault.file
            before, status = path.read_bytes(), path.stat()
            path.write_text(fault.planted(before.decode("utf-8")), encoding="utf-8")
            caught = run_tests(checkout, [fault.test]).returncode == TESTS_FAILED
            path.write_bytes(before)
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
            missed += not caught
            print(f"{'caught' if caught else 'NOT CAUGHT'}: {fault.name} ({fault.meaning}) by {fault.test}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
