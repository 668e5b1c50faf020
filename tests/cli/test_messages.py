"""What commands say: version, quiet and verbose, one JSON document, errors that no name can forge."""

import errno
import json
import logging
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import cusick_bench
from cusick_bench.cli import app
from cusick_bench.cli.common import command_with, user_errors
from cusick_bench.cli.verbosity import PACKAGE, messages, tell_less, tell_more
from cusick_bench.leaderboard.text import typed
from cusick_bench.runner.processes import process_pool

ESCAPE = "\x1b[2J"


def invoke(*words, **options):
    return CliRunner().invoke(app, [str(word) for word in words], **options)


def test_the_version_is_told_with_its_commit():
    told = invoke("--version").stdout
    assert told.startswith(f"cusick-bench {cusick_bench.__version__}")
    if (Path(__file__).parents[2] / ".git").exists():
        commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True)
        assert f"commit {commit.stdout[:12]}" in told


@pytest.fixture
def fit(tmp_path):
    """Words of a command that writes files and says so."""
    return ["run", "--solver", "null:disc", "--vertices", "97", "--cloth", "fabric_1", "--out", tmp_path / "runs"]


@pytest.mark.parametrize("place", [0, 1], ids=["before", "after"])
def test_quiet_leaves_results(toy_lab, fit, place):
    words = [*fit, "--data", toy_lab]
    words.insert(place, "-q")
    found = invoke(*words)
    assert found.exit_code == 0, found.stderr
    assert found.stderr == ""
    assert "null:disc" in found.stdout
    again = invoke(*fit, "--data", toy_lab)  # the level is that of one command
    assert "next: cusick-bench leaderboard" in again.stderr


@pytest.mark.parametrize("place", [0, 1], ids=["before", "after"])
def test_verbose_logs_what_is_read_and_run(make_lab, fit, place):
    toy_lab = make_lab([1e-5], samples=2)  # not in memory yet
    words = [*fit, "--data", toy_lab, "--json"]
    words.insert(place, "--verbose")
    found = invoke(*words)
    assert json.loads(found.stdout)["cells"][0]["status"] == "done"
    assert f"{toy_lab / 'fabrics.csv'}" in found.stderr
    assert "1 cells, 0 of them finished before" in found.stderr
    assert f"wrote {fit[-1]}/cells/" in found.stderr
    assert logging.getLogger("cusick_bench").handlers == []


@pytest.fixture(scope="module")
def toy_lab(make_lab):
    return make_lab([1e-5], samples=2)


def _warn_from(file: Path) -> None:
    warnings.warn_explicit("out of range", UserWarning, str(file), 3)


@pytest.mark.parametrize(("told", "own", "foreign"), [(None, 1, 0), (tell_less, 0, 0), (tell_more, 1, 1)])
def test_warnings_of_libraries_are_for_the_verbose(capsys, told, own, foreign):
    with messages():
        if told:
            told(True)
        warnings.simplefilter("always")
        for file, count in ((PACKAGE / "sim" / "drape.py", own), (Path("/usr/lib/python3/torch.py"), foreign)):
            _warn_from(file)
            assert capsys.readouterr().err.count("warning: out of range") == count


@pytest.mark.parametrize(("told", "count"), [("pass", 0), ("tell_less(True)", 0), ("tell_more(True)", 1)])
def test_logs_of_libraries_are_for_the_verbose(told, count):
    """As of matplotlib where the home folder cannot be written."""
    code = (
        "import logging; from cusick_bench.cli.verbosity import messages, tell_less, tell_more\n"
        f"with messages():\n    {told}\n    logging.getLogger('a library').warning('no cache')\n"
        "logging.getLogger('a library').warning('after the command')"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr
    assert (said.count("no cache"), said.count("after the command")) == (count, 1)


@pytest.mark.parametrize(
    "words",
    [
        ["data", "info", f"a{ESCAPE}[red]b"],
        ["run", "--out", "OUT", "--cloth", f"blue{ESCAPE}", "--solver", "null:disc"],
        ["leaderboard", f"nowhere{ESCAPE}"],
        ["diagnose", f"nowhere{ESCAPE}"],
        ["simulate", "--density", "0.2", "--bending", f"{ESCAPE}"],
    ],
    ids=lambda words: words[0],
)
def test_errors_are_harmless_and_leave_standard_output_alone(words, tmp_path):
    found = invoke(*(tmp_path / "runs" if word == "OUT" else word for word in words), "--json")
    assert found.exit_code == 2
    assert found.stdout == ""
    assert found.stderr.startswith("error: ")
    assert "\x1b" not in found.stderr
    assert r"\x1b[2J" in found.stderr


def test_hostile_names_of_a_data_set_are_harmless(tmp_path, make_lab):
    lab = make_lab([1e-5], samples=2)
    hostile = lab.with_name(f"lab{ESCAPE}[red]")
    lab.rename(hostile)
    try:
        for command in (["info"], ["stats"], ["audit"]):
            found = invoke("data", *command, hostile)
            assert found.exit_code == 0, found.stderr
            assert "\x1b" not in found.output
        assert r"lab\x1b[2J[red]" in invoke("data", "info", hostile).stdout
    finally:
        hostile.rename(lab)


def test_all_commands_print_in_ascii():
    """Help pages and tables, with an encoding that has neither boxes nor ±."""
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "COLUMNS": "200"}
    for words in (["--help"], ["run", "--help"], ["effects"], ["solvers"]):
        done = subprocess.run(
            [sys.executable, "-m", "cusick_bench", *words], capture_output=True, env=environment, check=False
        )
        assert done.returncode == 0, done.stderr.decode()
        assert done.stdout.isascii()
        assert len(done.stdout) > 500


def test_a_reader_that_leaves_early_is_no_error_of_a_folder():
    done = subprocess.run(
        f"{sys.executable} -m cusick_bench effects | head -1", shell=True, capture_output=True, text=True, check=False
    )
    assert "choose another folder" not in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_a_reader_that_has_left_ends_tables_and_json_alike(form):
    """Not as a wrong usage, with exit status 2, and without a word on it."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "cusick_bench", "effects", *form],
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def _buffered(words: list[str], stdout: int) -> subprocess.CompletedProcess[str]:
    """A command whose output leaves it when it is whole, or fills a buffer, as where nobody asks for anything else."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    words = [sys.executable, "-m", "cusick_bench", *words]
    return subprocess.run(words, stdout=stdout, stderr=subprocess.PIPE, text=True, env=environment, check=False)


@pytest.mark.parametrize("words", [["datasets", "--json"], ["data", "info", "synthetic"], ["--version"], ["--help"]])
def test_output_that_finds_no_room_is_told_in_one_line(words):
    """Also what is so short that it is written only when the program ends, and what no command prints."""
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no device that is always full")
    full = os.open("/dev/full", os.O_WRONLY)
    try:
        done = _buffered(words, full)
    finally:
        os.close(full)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: No space left on device; ")
    assert done.stderr.count("\n") == 1


def test_a_reader_that_has_left_ends_a_short_document_alike():
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = _buffered(["datasets", "--json"], writer)
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_an_error_without_a_file_names_none(capsys):
    """Writing to a file that is open already tells no name."""

    @user_errors
    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(typer.Exit):
        full()
    assert capsys.readouterr().err == "error: No space left on device; choose another folder or free some space\n"


def test_a_worker_that_is_killed_is_told_in_one_line(capsys):
    """As the system kills one that takes too much memory, in commands whose workers run no cells."""

    @user_errors
    def calibrate() -> None:
        with process_pool(1) as pool:
            pool.submit(os._exit, 9).result()

    with pytest.raises(typer.Exit) as ended:
        calibrate()
    assert ended.value.exit_code == 2
    told = capsys.readouterr().err
    assert told.startswith("error: a worker process was killed, probably out of memory")
    assert told.endswith("fewer --workers\n")


def test_a_warning_is_shown_once_a_command(capsys):
    """Whoever has a broken package installed reads of it once, though each look at the solvers finds it broken."""
    for _ in range(2):
        with messages(), warnings.catch_warnings():
            warnings.simplefilter("always")
            for text in ("one", "two", "one"):
                warnings.warn_explicit(text, RuntimeWarning, str(PACKAGE / "lazy.py"), 1)
        assert capsys.readouterr().err == "warning: one\nwarning: two\n"


def test_commands_that_are_advised_can_be_typed(toy_lab, fit, tmp_path):
    folder, baseline = tmp_path / "my runs", tmp_path / "the base.csv"
    told = invoke(*fit[:-1], folder, "--data", toy_lab).stderr
    assert f"next: cusick-bench leaderboard '{folder}'\n" in told
    told = invoke("check", folder, "--against", baseline).stderr
    assert f"`cusick-bench check '{folder}' --against '{baseline}' --write`" in told


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (["/opt/my bin/cusick-bench", "run", "--out", "my runs"], "cusick-bench run --out 'my runs'"),
        (["/opt/cusick_bench/__main__.py", "run", "--out", "runs"], "cusick-bench run --out runs"),
        (["cusick-bench", "run", "--out", "runs\udcff"], "cusick-bench run --out 'runs?'"),
        ("/opt/cusick-bench run", "cusick-bench run"),
        ([], ""),
    ],
)
def test_a_command_of_a_table_can_be_typed(command, text):
    assert typed(command) == text


def test_commands_can_be_typed_into_both_shells_of_windows(monkeypatch):
    """In cmd.exe, the command that goes on with a run began anew in a folder with quotes in its name."""
    words = ("run", "--out", r"runs\bench", "--data", r"my data\lab")
    assert command_with(*words) == r"cusick-bench run --out 'runs\bench' --data 'my data\lab'"
    monkeypatch.setattr(sys, "platform", "win32")
    assert command_with(*words) == r'cusick-bench run --out runs\bench --data "my data\lab"'


def test_a_page_of_a_folder_whose_name_is_no_text(toy_lab, fit):
    folder = fit[-1].with_name("runs\udcff")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system has names of text only")
    words = [*map(str, fit[:-1]), str(folder), "--data", str(toy_lab)]
    done = subprocess.run([sys.executable, "-m", "cusick_bench", *words], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    for words in (["report", folder], ["leaderboard", folder, "--out", folder.with_name("table.csv")]):
        found = invoke(*words)
        assert found.exit_code == 0, found.output
