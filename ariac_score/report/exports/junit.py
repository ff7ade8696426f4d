"""JUnit XML: a suite for each check, a case for each finding. An undecided finding is an error, not a pass.

Source: the common subset that CI systems read (`testsuites`, `failure`, `error`, `skipped`).
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.exports.facts import (
    checks,
    cut,
    ends,
    final_findings,
    headline,
    name,
    narrowing,
    remarks,
    unofficial,
    unrecorded,
    when,
    why_none,
    why_unofficial,
)
from ariac_score.report.text import amount_text
from ariac_score.results.result import Result

__all__ = ["junit_text"]

_ELEMENTS = {Verdict.VIOLATED: "failure", Verdict.INCONCLUSIVE: "error", Verdict.NOT_APPLICABLE: "skipped"}


def junit_text(result: Result) -> str:
    """A result as JUnit XML, with a newline at its end."""
    root = Element("testsuites", name=f"ariac-score {name(result)}")
    _score(result, root)
    findings = final_findings(result)
    for check in checks(result):
        own = [(key, finding) for key, finding in findings.items() if finding.check == check]
        suite = SubElement(root, "testsuite", name=f"{result.provenance.rule_set.id}.{check}")
        for key, finding in own:
            _case(suite, f"{result.provenance.rule_set.id}.{check}", key, finding)
    for suite in root:
        _count(suite, [suite])
    _count(root, list(root))
    indent(root, " ")
    return tostring(root, encoding="unicode", xml_declaration=False).join(
        ('<?xml version="1.0" encoding="UTF-8"?>\n', "\n")
    )


def _score(result: Result, root: Element) -> None:
    """The suite of the score itself: an error where there is none."""
    suite = SubElement(root, "testsuite", name="score")
    properties = SubElement(suite, "properties")
    for key, value in _properties(result):
        SubElement(properties, "property", name=key, value=value)
    # Readers expect a time. That of scoring would make other bytes of the same result.
    case = SubElement(suite, "testcase", classname=result.provenance.rule_set.id, name="score", time="0")
    if result.final is None:
        SubElement(case, "error", type=result.status, message=why_none(result))
    SubElement(case, "system-out").text = "\n".join(
        [headline(result), *why_unofficial(result), *remarks(result), *narrowing(result), *unrecorded(result)]
    )


def _properties(result: Result) -> Iterator[tuple[str, str]]:
    yield "rule_set", result.provenance.rule_set.id
    yield "rule_set_sha256", result.provenance.rule_set.sha256
    yield "status", result.status
    if result.measured.unofficial:
        yield "unofficial", unofficial(result)
    for key, amount in (
        ("score", result.final),
        ("automatic_score", result.score),
        ("possible", result.possible),
    ):
        if amount is not None:
            yield key, amount_text(amount)
    yield from ((key, amount_text(amount)) for key, amount in ends(result).items())
    for source in result.provenance.inputs:
        yield f"sha256 of {cut(source.name, 200)}", source.sha256


def _case(suite: Element, classname: str, key: str, finding: Finding) -> None:
    case = SubElement(
        suite, "testcase", classname=classname, name=f"{key} {cut(finding.subject, 200)}", time="0"
    )
    element = _ELEMENTS.get(finding.verdict)
    if element is None:
        return
    outcome = SubElement(case, element, message=cut(finding.message))
    if element != "skipped":
        outcome.set("type", finding.verdict.value)
        outcome.text = "\n".join(_details(finding))


def _details(finding: Finding) -> Iterator[str]:
    yield cut(finding.message)
    if finding.span is not None:
        yield f"when: {when(finding)}"
    if finding.robustness is not None:
        yield f"margin: {finding.robustness:.9g} {cut(finding.unit, 40)}"
    if finding.clause:
        yield f"clause: {cut(finding.clause)}"
    for sample in finding.evidence:
        values = sample.value if isinstance(sample.value, tuple) else (sample.value,)
        numbers = ", ".join(f"{value:.9g}" for value in values)
        yield f"evidence: {cut(sample.signal, 200)} = {numbers} {sample.unit} at {sample.t_s:.3f} s"


def _count(element: Element, suites: list[Element]) -> None:
    """Set the counts, which CI systems show without counting themselves."""
    cases = [case for suite in suites for case in suite.iter("testcase")]
    element.set("tests", str(len(cases)))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        element.set(attribute, str(sum(1 for case in cases if case.find(tag) is not None)))
    if element.tag == "testsuites":  # the format has no count of skipped cases at the root
        del element.attrib["skipped"]
    element.set("time", "0")
