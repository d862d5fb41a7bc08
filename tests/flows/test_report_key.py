"""The digest of a campaign directory: another one for each thing that its files would show otherwise."""

import importlib.metadata
from dataclasses import replace

import pytest

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.run_request import SEQUENTIAL
from vastflow.flows.results import current_report
from vastflow.flows.results.current_report import report_key
from vastflow.flows.results.inputs import inputs_of
from vastflow.oracles.judgment.registry import oracle_of
from vastflow.tasks.keys.keys import Keys

KEYS = Keys("x86_64; glibc 2.36; avx2 fma; ", "e" * 64, "o" * 64, "j" * 64, 0, [])
METADATA = {
    "name": "n",
    "created": "2026-11-21T06:05:01",
    "vastflow": "1",
    "versions": {"numpy": "2.0"},
    "host": {"name": "here", "cpus": 2},
    "notes": ["room.vast:1:1: a word"],
    "robots": [{"families": ["room"], "robot": ["assumed, as a TurtleBot 4 has it: mass 3.3 kg"]}],
    "asked": {"only": [], "runs": 2},
}


@pytest.fixture
def asked(small_room):
    campaign, oracles = read_campaign(small_room)
    return {
        "keys": KEYS,
        "inputs": inputs_of(campaign, oracles),
        "metadata": METADATA,
        "oracles": oracles,
        "place": "/store",
    }


def of_metadata(**changes):
    return lambda asked: {"metadata": {**asked["metadata"], **changes}}


CHANGES = {
    "a comment in the campaign file, which the report shows": lambda asked: {
        "inputs": replace(asked["inputs"], campaign=asked["inputs"].campaign + b"# a\n")
    },
    "a comment in a file that it names": lambda asked: {
        "inputs": replace(asked["inputs"], files={**asked["inputs"].files, "notes.yaml": b"# a\n"})
    },
    "the campaign's name": of_metadata(name="m"),
    "the version of vastflow": of_metadata(vastflow="2"),
    "the version of a library": of_metadata(versions={"numpy": "2.1"}),
    "a note on the campaign file": of_metadata(notes=[]),
    "a robot": of_metadata(robots=[]),
    "a selection": of_metadata(asked={"only": ["room"], "runs": 2}),
    "a rule by which runs ended": of_metadata(**{SEQUENTIAL: {"min": 5, "max": 20}}),
    "another rule": of_metadata(**{SEQUENTIAL: {"min": 6, "max": 20}}),
    "an oracle": lambda asked: {"oracles": [*asked["oracles"], oracle_of("safety", {})]},
    "the machine": lambda asked: {"keys": replace(asked["keys"], numeric="aarch64; glibc 2.36; ; ")},
    "a sample": of_metadata(asked={"only": [], "runs": 2, "sample": 9}),
    "the store": lambda asked: {"place": "s3://bucket/store"},
}


def test_report_key_changes_with_everything_shown(asked):
    keys = {"nothing": report_key(**asked)} | {
        what: report_key(**{**asked, **change(asked)}) for what, change in CHANGES.items()
    }
    alike = [(a, b) for a in keys for b in keys if a < b and keys[a] == keys[b]]
    assert alike == []


@pytest.mark.parametrize("facts", [{"created": "2027-01-01T00:00:00"}, {"host": {"name": "there"}}])
def test_facts_of_a_call_are_in_no_key(asked, facts):
    assert report_key(**{**asked, "metadata": {**METADATA, **facts}}) == report_key(**asked)


def test_report_key_has_description_of_oracles_and_libraries_of_report(asked, monkeypatch):
    before, version = report_key(**asked), importlib.metadata.version
    with monkeypatch.context() as patch:
        patch.setattr(type(asked["oracles"][0]), "__doc__", "Another sentence.")
        assert report_key(**asked) != before
    for library in ("jinja2", "markupsafe", "matplotlib"):
        with monkeypatch.context() as patch:
            patch.setattr(
                importlib.metadata, "version", lambda name, own=library: "0" if name == own else version(name)
            )
            assert report_key(**asked) != before


@pytest.mark.parametrize("name", ["tables.py", "report.html.j2", "report.css", "report.js"])
def test_code_and_templates_are_in_the_key(asked, tmp_path, monkeypatch, name):
    (tmp_path / "page").mkdir()
    monkeypatch.setattr(current_report, "written_by", lambda: (tmp_path,))
    before = report_key(**asked)
    (tmp_path / "page" / "tables.pyc").write_text("compiled")
    assert report_key(**asked) == before
    (tmp_path / "page" / name).write_text("edited")
    assert report_key(**asked) != before
