"""Damaged campaign directories: a sentence with the file, never a traceback."""

import json
from datetime import datetime

import pytest
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.request.asked import Asked
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.found import ConfigurationResult
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.results import write_results
from vastflow.flows.results.summary import Work
from vastflow.oracles.verdict import Verdict
from vastflow.producers.instantiate import instantiate
from vastflow.tasks.keys import Keys


@pytest.fixture
def directory(small_room, tmp_path):
    """A campaign directory without recordings."""
    campaign, oracles = read_campaign(small_room)
    results = write_results(
        tmp_path / "results",
        campaign,
        inputs_of(campaign, oracles),
        instantiate(campaign),
        lambda configuration: ConfigurationResult(verdicts=[Verdict("success", k, "pass") for k in range(2)]),
        runs=2,
        oracles=["success"],
        keys=Keys("x86_64; glibc 2.36; ; ", "e" * 64, "o" * 64, "j" * 64, 0, []),
        record={"asked": Asked("room.vast", 2).as_json()},
        created=datetime(2026, 11, 21, 6, 5, 4),
        work=lambda: Work(4, 0, 30.0, 2.0, 1.5),
        report=lambda place: None,
    )
    return results.directory


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


DAMAGES = {
    "a list": b"[]",
    "an empty map": b"{}",
    "null": b"null",
    "no JSON": b"{",
    "counts that are none": json.dumps({"name": "n", "created": "now", "counts": 4, "asked": 5}).encode(),
}


@pytest.mark.parametrize("content", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("command", ["show", "export", "compare", "explain"])
def test_metadata_that_is_none_is_said_in_a_sentence(directory, tmp_path, monkeypatch, command, content):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (directory / "metadata.json").write_bytes(content)
    more = {"export": [tmp_path / "out"], "compare": [directory], "explain": ["room-1"]}
    result = called(command, directory, *more.get(command, []))
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{directory}: damaged campaign directory" in result.stderr


def test_an_export_does_without_what_the_campaign_file_says_of_its_scenario(directory, tmp_path):
    (directory / "campaign.vast").write_bytes(b"")
    assert called("export", directory, tmp_path / "out").exit_code == 0


def test_explain_says_why_it_can_not_tell_what_a_run_would_do(directory, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (directory / "campaign.vast").unlink()
    result = called("explain", directory, "room-1")
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "what a run of it would do today can't be told" in said and "campaign.vast" in said
