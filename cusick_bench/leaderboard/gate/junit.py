"""The verdict of a check as JUnit XML, which continuous integration shows as tests: one a solver and metric.

References:
    The format: https://github.com/testmoapp/junitxml (there is no official one).
"""

import re
from math import isfinite
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from cusick_bench.leaderboard.gate.check import Finding, Outcome

_NOT_IN_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(outcome: Outcome) -> bytes:
    """Writes a verdict as JUnit XML.

    Args:
        outcome: Of `check`.

    Returns:
        Content of the file: a regression is a failure; what could not be decided, or is new, is skipped.
    """
    tests = str(len(outcome.findings))
    skipped = str(sum(finding.verdict in ("undecided", "new") for finding in outcome.findings))
    counts = {
        "name": "cusick-bench check",
        "tests": tests,
        "failures": str(len(outcome.regressions)),
        "errors": "0",
        "skipped": skipped,
    }
    root = Element("testsuites", counts)
    suite = SubElement(root, "testsuite", counts)
    for finding in outcome.findings:
        _add(suite, finding)
    if outcome.notes:
        SubElement(suite, "system-out").text = _allowed("\n".join(outcome.notes))
    indent(root)
    return tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _add(suite: Element, finding: Finding) -> None:
    case = SubElement(suite, "testcase", classname=_allowed(finding.solver), name=_allowed(finding.metric), time="0")
    said = _allowed(_said(finding))
    if finding.verdict == "regression":
        SubElement(case, "failure", type="regression", message=said).text = said
    elif finding.verdict in ("undecided", "new"):
        SubElement(case, "skipped", message=f"{finding.verdict}: {said}")


def _said(finding: Finding) -> str:
    """The numbers of a finding in a line."""
    words = [finding.detail] if finding.detail else []
    if isfinite(finding.before) and isfinite(finding.after):
        words.append(f"{finding.before:.5f} before, {finding.after:.5f} now")
    if finding.comparison is not None and isfinite(finding.comparison.ratio.value):
        words.append(f"ratio {finding.comparison.ratio.value:.3g}")
    if isfinite(finding.p):
        words.append(f"p = {finding.p:.3g} (Holm)")
    return "; ".join(words)


def _allowed(text: str) -> str:
    """Text without the characters that XML cannot hold."""
    return _NOT_IN_XML.sub("\ufffd", text)
