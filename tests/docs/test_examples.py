"""Every example of README, CONTRIBUTING and docs/ works: Python blocks and commands, in the order of each page."""

import os
from pathlib import Path

import pytest
from doc_examples import LANGUAGES, TREATMENTS, Example, ExampleError, check_command, examples, pages, run_example

ROOT = Path(__file__).resolve().parents[2]
PAGES = [page for page in pages(ROOT) if examples(page)]

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page_work(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    release = os.environ.get("CUSICK_DATA", "")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CUSICK_DATA", release or "no-release-here")
    names: dict[str, object] = {"__name__": "__example__"}
    for example in examples(page):
        if example.language not in LANGUAGES or example.treatment == "shown":
            continue
        if example.treatment == "run" or (example.treatment == "real data" and release):
            run_example(example, names)
        elif example.language == "sh":
            for words in example.commands():
                check_command(example, words)


def test_every_page_that_shows_a_command_is_tried():
    assert {ROOT / "README.md", ROOT / "docs" / "first-run.md"} <= set(PAGES)


def test_treatments_are_spelled_as_the_tests_know_them():
    for page in PAGES:
        for example in examples(page):
            assert example.treatment in TREATMENTS, f"{page}:{example.line}: {example.treatment!r}"


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("python", "assert 1 == 2"),
        ("sh", "cusick-bench data info no-such-set"),
        ("sh", "cusick-bench run --no-such-option 3"),
        ("sh", "make no-such-target"),
        ("sh", "pip install -e '.[no-such-extra]'"),
        ("sh", "rm -rf elsewhere"),
    ],
)
def test_examples_that_do_not_work_are_noticed(language: str, text: str, tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n```{language}\n{text}\n```\n")
    (example,) = examples(page)
    with pytest.raises(AssertionError):
        run_example(example, {})


@pytest.mark.parametrize(
    "text", ["cusick-bench withheld guess CASES", "cusick-bench run --wit 3", "cusick-bench simulate --draws many"]
)
def test_commands_that_are_only_parsed_are_checked_too(text: str, tmp_path: Path):
    example = Example(tmp_path / "page.md", 1, "sh", "parsed", text)
    with pytest.raises(ExampleError):
        check_command(example, example.commands()[0])
