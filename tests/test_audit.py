"""`.ci/audit`: what it makes of what pip-audit finds, without asking anybody."""

import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def audit() -> Any:
    loader = SourceFileLoader("ci_audit", str(ROOT / ".ci" / "audit"))
    spec = spec_from_loader("ci_audit", loader)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules["ci_audit"] = module
    loader.exec_module(module)
    return module


FOUND = {"id": "PYSEC-1", "aliases": ["CVE-1"], "fix_versions": ["2.0"]}
CLEAN = {"name": "clean", "version": "1.0", "vulns": []}
UNKNOWN = {"name": "unknown", "skip_reason": "Dependency not found"}


def _document(*packages: dict) -> dict:
    return {"dependencies": list(packages)}


def test_nothing_found_passes(audit):
    assert audit.judge(_document(CLEAN), {}) == audit.Verdict(["1 packages audited, nothing unexplained"], False)


def test_a_vulnerability_fails_and_says_where_it_is_mended(audit):
    verdict = audit.judge(_document({"name": "odd", "version": "1.0", "vulns": [FOUND]}), {})
    assert verdict.failed
    assert verdict.lines[0] == "odd 1.0: PYSEC-1, mended in 2.0; raise the pin, or explain it"


def test_an_explained_one_passes_by_any_of_its_names(audit):
    verdict = audit.judge(_document({"name": "odd", "version": "1.0", "vulns": [FOUND]}), {"CVE-1": "not called"})
    assert not verdict.failed
    assert verdict.lines[0].endswith("explained: not called")


def test_an_explanation_that_nothing_needs_fails(audit):
    verdict = audit.judge(_document(CLEAN), {"CVE-1": "not called"})
    assert verdict.failed
    assert "take it out: CVE-1" in verdict.lines[0]


@pytest.mark.parametrize("document", [None, _document(UNKNOWN)])
def test_what_nobody_could_audit_is_not_called_clean(audit, document):
    verdict = audit.judge(document, {"CVE-1": "not called"})
    assert not verdict.failed
    assert verdict.lines[-1].startswith("NOT AUDITED")


def test_packages_that_the_database_does_not_know_are_named(audit):
    assert "unknown" in audit.judge(_document(CLEAN, UNKNOWN), {"CVE-1": "not called"}).lines[0]


def test_pins_are_read_and_local_versions_are_those_of_the_index(audit):
    assert audit.pins("# a\nTorch==2.13.0+cpu\nlinear_operator==0.6.1\n") == {
        "torch": "2.13.0", "linear-operator": "0.6.1"
    }  # fmt: skip


def test_every_explanation_is_a_sentence(audit):
    audit.explanations((ROOT / ".ci" / "known-vulnerabilities.toml").read_text(encoding="utf-8"))
    with pytest.raises(ValueError, match="must be a sentence"):
        audit.explanations('CVE-1 = ""')
