"""JUnit reports: what CI systems count, and XML that any parser reads."""

from xml.etree import ElementTree

from hypothesis import example, given
from hypothesis import strategies as st

from vastflow.flows.export.junit import Case, Flaw, Suite, campaign_report, suite_report

PASSED = Case("room/0", "c.room", 0.25, 1_700_000_000.125, {"outcome": "succeeded"})
FAILED = Case("room/1", "c.room", 0.5, 1_700_000_001.0, {}, Flaw("failure", "success: too late", "the whole\nstory"))
BROKEN = Case("room/2", "c.room", 0.0, None, {}, Flaw("error", "fault"))
UNJUDGED = Case("room/3", "c.room", 1.0, None, {}, Flaw("skipped", "no path"))
ROOM = Suite("room", [PASSED, FAILED, BROKEN, UNJUDGED])


def totals(element):
    return [element.get(key) for key in ("tests", "failures", "errors", "skipped", "time")]


def test_suite_counts_each_kind_of_flaw_and_begins_with_its_first_case():
    root = ElementTree.fromstring(suite_report(ROOM))
    assert (root.tag, root.get("name"), root.get("timestamp")) == ("testsuite", "room", "2023-11-14T22:13:20")
    assert totals(root) == ["4", "1", "1", "1", "1.750000"]
    assert "timestamp" not in ElementTree.fromstring(suite_report(Suite("s", [BROKEN]))).attrib


def test_report_of_campaign_adds_up_its_suites():
    root = ElementTree.fromstring(campaign_report("c", [ROOM, Suite("hall", [PASSED])]))
    assert (root.tag, root.get("name")) == ("testsuites", "c")
    assert totals(root) == ["5", "1", "1", "1", "2.000000"]
    assert [suite.get("name") for suite in root] == ["room", "hall"]


def test_case_has_times_properties_and_its_flaw():
    cases = ElementTree.fromstring(suite_report(ROOM))
    assert cases[0].attrib == {"classname": "c.room", "name": "room/0", "time": "0.250000"}
    stated = [(p.get("name"), p.get("value")) for p in cases[0].iter("property")]
    assert stated == [("start_time", "1700000000.125000"), ("outcome", "succeeded")]
    flaws = [[child.tag for child in case if child.tag != "properties"] for case in cases]
    assert flaws == [[], ["failure"], ["error"], ["skipped"]]
    failure = cases[1].find("failure")
    assert (failure.get("message"), failure.text) == ("success: too late", "the whole\nstory")


def test_report_is_utf8():
    content = suite_report(Suite("größe", []))
    assert content.startswith(b"<?xml version='1.0' encoding='utf-8'?>")
    assert "größe".encode() in content


@example("\x1b[31mred\x1b[0m")
@example("\x00")
@example("half \ud800 a pair")
@example("\ufffe")
@given(st.text(st.characters(exclude_categories=())))
def test_report_of_any_text_is_xml(text):
    case = Case(text, text, 0.0, None, {text: text}, Flaw("error", text, text))
    root = ElementTree.fromstring(campaign_report(text, [Suite(text, [case])]))
    assert root.find("testsuite/testcase/error") is not None
    assert ("\ufffd" in root.get("name")) >= (text in ("\x00", "\ufffe"))
