"""The request of a run: one model behind the command line, Python, deployments and schedules."""

import inspect

import pytest
from prefect.exceptions import ParameterTypeError
from table import each_row
from typer.testing import CliRunner

from vastflow.flows import run_campaign
from vastflow.flows.__main__ import app
from vastflow.flows.campaign import campaign
from vastflow.flows.request.run_request import NAMES, RunRequest, request_of
from vastflow.flows.request.work_pool import WorkPool


def test_request_goes_through_json_unchanged(tmp_path):
    request = request_of(tmp_path / "x.vast", {"runs": 3, "only": "hall", "pool": WorkPool("lab", 4)})
    assert RunRequest.model_validate_json(request.model_dump_json()) == request
    assert (request.only, request.pool, request.shards) == (("hall",), "lab", 4)


def test_fields_have_a_description():
    assert [name for name, about in RunRequest.model_fields.items() if not about.description] == []


def test_command_has_an_option_for_each_field_with_the_words_of_the_field():
    said = " ".join(CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": "400"}).output.split())
    for name in NAMES:
        if name != "reports":
            flag = "--pool-wait" if name == "pool_wait_s" else f"--{name.replace('_', '-')}"
            assert f"{flag} " in said
            assert RunRequest.model_fields[name].description in said


def test_python_call_takes_what_the_request_has():
    assert [*inspect.signature(run_campaign).parameters] == ["campaign", "observer", *NAMES]


def test_flow_takes_the_request_and_nothing_else():
    assert [*campaign.parameters.properties] == ["request"]
    with pytest.raises(ParameterTypeError, match=r"request\.runs_each: Extra inputs are not permitted"):
        campaign.validate_parameters({"request": {"campaign": "x.vast", "runs_each": 3}})


@each_row(
    ("options", "words"),
    [
        ({"runs": 0}, "^runs is at least 1, got 0$"),
        ({"shards": 2}, "^--shards: only with --pool, whose shards it is about$"),
        ({"pool": ""}, "^--pool: expected the name of a work pool, got an empty name$"),
    ],
)
def test_option_out_of_bounds_is_told_with_what_was_found(options, words):
    with pytest.raises(ValueError, match=words):
        request_of("x.vast", options)


def test_option_that_there_is_not_is_told_with_those_there_are():
    with pytest.raises(TypeError, match=r"expected an option of runs, results, store.*, got 'run'"):
        request_of("x.vast", {"run": 2})
