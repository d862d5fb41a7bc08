"""JUnit reports: what CI systems count, and XML that any parser reads."""

from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.flows.export.junit import Case, Flaw, Suite, campaign_report, suite_report

PASSED = Case("room/0", "c.room", 0.25, 1_700_000_000.125, {"outcome": "succeeded"})
FAILED = Case("room/1", "c.room", 0.5, 1_700_000_001.0, {}, Flaw("failure", "success: too late", "the whole\nstory"))
BROKEN = Case("room/2", "c.room", 0.0, None, {}, Flaw("error", "fault"))
UNJUDGED = Case("room/3", "c.room", 1.0, None, {}, Flaw("skipped", "no path"))
ROOM = Suite("room", [PASSED, FAILED, BROKEN, UNJUDGED])
HALL = Suite("hall", [PASSED])


def totals(element):
    return {key: element.get(key) for key in ("tests", "failures", "errors", "skipped", "time")}


def test_suite_counts_each_kind_of_flaw_on_its_own():
    root = ElementTree.fromstring(suite_report(ROOM))
    assert (root.tag, root.get("name")) == ("testsuite", "room")
    assert totals(root) == {"tests": "4", "failures": "1", "errors": "1", "skipped": "1", "time": "1.750000"}


def test_suite_began_with_its_first_case_that_says_when_in_utc():
    assert ElementTree.fromstring(suite_report(ROOM)).get("timestamp") == "2023-11-14T22:13:20"
    assert "timestamp" not in ElementTree.fromstring(suite_report(Suite("s", [BROKEN]))).attrib


def test_campaign_adds_its_suites_up():
    root = ElementTree.fromstring(campaign_report("c", [ROOM, HALL]))
    assert (root.tag, root.get("name")) == ("testsuites", "c")
    assert totals(root) == {"tests": "5", "failures": "1", "errors": "1", "skipped": "1", "time": "2.000000"}
    assert [suite.get("name") for suite in root] == ["room", "hall"]


def test_case_has_its_wall_time_and_its_start_with_microseconds():
    case = ElementTree.fromstring(suite_report(ROOM))[0]
    assert case.attrib == {"classname": "c.room", "name": "room/0", "time": "0.250000"}
    assert [(p.get("name"), p.get("value")) for p in case.iter("property")] == [
        ("start_time", "1700000000.125000"),
        ("outcome", "succeeded"),
    ]


def test_case_that_passed_has_no_flaw_and_any_other_has_one():
    cases = ElementTree.fromstring(suite_report(ROOM))
    flaws = [[child.tag for child in case if child.tag != "properties"] for case in cases]
    assert flaws == [[], ["failure"], ["error"], ["skipped"]]
    failure = cases[1].find("failure")
    assert (failure.get("message"), failure.text) == ("success: too late", "the whole\nstory")


def test_file_says_that_it_is_utf8():
    content = suite_report(Suite("größe", []))
    assert content.startswith(b"<?xml version='1.0' encoding='utf-8'?>")
    assert "größe".encode() in content


@each_row("text", ["\x1b[31mred\x1b[0m", "\x00", "half \ud800 a pair", "\ufffe"])
def test_what_no_xml_may_hold_is_replaced(text):
    case = Case(text, "c", 0.0, None, {"p": text}, Flaw("failure", text, text))
    (read,) = ElementTree.fromstring(suite_report(Suite("s", [case])))
    assert "\ufffd" in read.get("name") and "\ufffd" in read.find("failure").text


@given(st.text(st.characters(exclude_categories=())))
def test_any_text_gives_a_file_that_can_be_read(text):
    case = Case(text, text, 0.0, None, {text: text}, Flaw("error", text, text))
    root = ElementTree.fromstring(campaign_report(text, [Suite(text, [case])]))
    assert root.find("testsuite/testcase/error") is not None
