"""JUnit reports: suites of test cases as XML for CI systems."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Final, Literal, TypeAlias
from xml.etree import ElementTree

FlawKind: TypeAlias = Literal["failure", "error", "skipped"]

_COUNTED: Final[Mapping[str, FlawKind]] = {"failures": "failure", "errors": "error", "skipped": "skipped"}
_NO_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML does not allow, even escaped."""


@dataclass(frozen=True, slots=True)
class Flaw:
    """The reason why a case did not pass.

    Attributes:
        kind: `failure` of the system under test, `error` of the test, or `skipped` if it was not judged.
        message, text: The reason in one line, and its details.
    """

    kind: FlawKind
    message: str
    text: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One test, with its start `started_s` (s since 1970, UTC) if known, and a failure unless it passed."""

    name: str
    classname: str
    time_s: float
    started_s: float | None = None
    properties: Mapping[str, str] = field(default_factory=dict)
    flaw: Flaw | None = None


@dataclass(frozen=True, slots=True)
class Suite:
    """A group of tests."""

    name: str
    cases: Sequence[Case]

    def count(self, kind: FlawKind) -> int:
        """Return the number of cases with a flaw of this kind."""
        return sum(case.flaw is not None and case.flaw.kind == kind for case in self.cases)

    @property
    def time_s(self) -> float:
        """The sum of all durations."""
        return sum(case.time_s for case in self.cases)


def suite_report(suite: Suite) -> bytes:
    """Return a file with one suite as its root."""
    return _file(_suite(suite))


def campaign_report(name: str, suites: Sequence[Suite], headline: str = "") -> bytes:
    """Return a file with several suites, and a campaign's headline as a property of all."""
    root = ElementTree.Element("testsuites", {"name": _xml(name), **_totals(suites)})
    if headline:
        properties = ElementTree.SubElement(root, "properties")
        ElementTree.SubElement(properties, "property", {"name": "headline", "value": _xml(headline)})
    root.extend(_suite(suite) for suite in suites)
    return _file(root)


def _suite(suite: Suite) -> ElementTree.Element:
    started_s = min((case.started_s for case in suite.cases if case.started_s is not None), default=None)
    # The format's times have no zone; UTC is what its schema asks for.
    element = ElementTree.Element("testsuite", {"name": _xml(suite.name), **_totals([suite])})
    if started_s is not None:
        element.set("timestamp", f"{datetime.fromtimestamp(started_s, UTC):%Y-%m-%dT%H:%M:%S}")
    element.extend(map(_case, suite.cases))
    return element


def _totals(suites: Sequence[Suite]) -> dict[str, str]:
    return {
        "tests": str(sum(len(suite.cases) for suite in suites)),
        **{name: str(sum(suite.count(kind) for suite in suites)) for name, kind in _COUNTED.items()},
        "time": f"{sum(suite.time_s for suite in suites):.6f}",
    }


def _case(case: Case) -> ElementTree.Element:
    attributes = {"classname": _xml(case.classname), "name": _xml(case.name), "time": f"{case.time_s:.6f}"}
    element = ElementTree.Element("testcase", attributes)
    started = {} if case.started_s is None else {"start_time": f"{case.started_s:.6f}"}
    if stated := {**started, **case.properties}:
        properties = ElementTree.SubElement(element, "properties")
        for name, value in stated.items():
            ElementTree.SubElement(properties, "property", {"name": _xml(name), "value": _xml(value)})
    if case.flaw is not None:
        flaw = ElementTree.SubElement(element, case.flaw.kind, {"message": _xml(case.flaw.message)})
        if case.flaw.kind != "skipped":
            flaw.set("type", case.flaw.kind)
        flaw.text = _xml(case.flaw.text) or None
    return element


def _file(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


def _xml(text: str) -> str:
    return _NO_XML.sub("\ufffd", text)
