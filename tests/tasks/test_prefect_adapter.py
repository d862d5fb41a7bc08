"""Undocumented parts of Prefect are used in one module, and exist in the installed release.

`python tests/proofs/installed.py prefect` runs this with the oldest and the newest release allowed.
"""

import logging
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from vastflow.sim.model.faults import UserError
from vastflow.tasks.prefect import adapter

ROOT = Path(__file__).parents[2]
UNDOCUMENTED = re.compile(
    r"""
    from\ prefect[\w.]*\ import\ [^\n]*\b_\w               # a private name
    | (?<!tasks\.)\bprefect\.(context|events\.worker|logging\.handlers|main|server|utilities|workers)\b
    | \bPREFECT__
    | \.request\(\s*"(GET|POST|PATCH|PUT|DELETE)"          # a route
    | \b_instances\b | \._queue\b
    """,
    re.VERBOSE,
)


def test_undocumented_parts_of_prefect_are_used_in_one_module():
    modules = [file for folder in ("flows", "tasks", "deployments") for file in (ROOT / folder).rglob("*.py")]
    assert len(modules) > 100
    found = [
        f"{file.relative_to(ROOT)}: {match.group()}"
        for file in modules
        if file.name != "adapter.py"
        for match in UNDOCUMENTED.finditer(file.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_application_of_the_api_is_where_uvicorn_is_sent():
    module, _, name = adapter.SERVER_APPLICATION.partition(":")
    assert callable(getattr(__import__(module, fromlist=[name]), name))


def test_prefect_knows_every_setting_of_an_embedded_server():
    from prefect.settings import Settings
    from prefect.settings.legacy import _get_valid_setting_names

    named = {name for name in adapter.SERVER_SETTINGS if not name.startswith("PREFECT__")}
    assert named - {"PREFECT_UI_ENABLED"} - set(_get_valid_setting_names(Settings)) == set()


@pytest.fixture(scope="module")
def client(started_api, tmp_path_factory):
    """A client of an API that was started as vastflow starts one."""
    folder = tmp_path_factory.mktemp("api")
    with started_api(folder / "prefect", folder / "server.log") as client:
        yield client


@pytest.mark.slow
@pytest.mark.timeout(280)
def test_documented_routes_exist(client):
    assert adapter.post(client, "/task_runs/count", {}) == 0


@pytest.mark.timeout(280)
def test_exact_tags_replace_others(client):
    from prefect import flow, tags

    @flow
    def marked():
        return sorted(adapter.current_tags())

    with tags("one", "two"):
        assert adapter.current_tags() == {"one", "two"}
        with adapter.exact_tags(frozenset({"one"})):
            assert adapter.current_tags() == {"one"}
            state = marked(return_state=True)
    assert client.read_flow_run(state.state_details.flow_run_id).tags == ["one"]


@pytest.mark.slow
@pytest.mark.timeout(280)
def test_started_services_end_and_restart(client):
    from prefect import flow

    for _ in range(2):
        flow(lambda: None, name="nothing")()
        assert adapter.unsent() >= 0
        adapter.end_services(5.0)
    assert adapter.unsent() == 0


def test_prefects_console_handlers_are_found_and_others_are_not():
    from prefect.logging.handlers import PrefectConsoleHandler

    logger, own = logging.getLogger("vastflow.test_adapter"), logging.NullHandler()
    logger.addHandler(own)
    logger.addHandler(PrefectConsoleHandler())
    assert [type(each) for each in adapter.console_handlers(logger)] == [PrefectConsoleHandler]
    logger.handlers.clear()


def test_log_filter_is_removed_at_exit():
    from prefect.logging.handlers import APILogHandler

    logger, handler = logging.getLogger("prefect.task_runs"), APILogHandler()
    logger.addHandler(handler)
    try:
        with adapter.sent_only("prefect.task_runs", lambda record: False):
            assert len(handler.filters) == 1
        assert handler.filters == []
    finally:
        logger.removeHandler(handler)


def test_prefect_provides_flow_schema_and_pool_template():
    from vastflow.flows.campaign import campaign

    assert adapter.flow_schema(campaign)["required"] == ["request"]
    assert {"job_configuration", "variables"} <= adapter.process_pool_template().keys()


def test_default_database_is_of_sqlite():
    assert (adapter.database_url() or "sqlite+aiosqlite:///").startswith("sqlite+aiosqlite:///")


def said_in_a_terminal(script, home):
    """Output of Python in a terminal and a home without Prefect."""
    ours, theirs = pty.openpty()
    tracked = {
        name: value for name, value in os.environ.items() if name not in ("CI", "DO_NOT_TRACK", "GITHUB_ACTIONS")
    }
    environment = {**tracked, "PREFECT_HOME": str(home)}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=theirs, stdout=theirs, stderr=theirs, env=environment
    ) as run:
        os.close(theirs)
        said = b""
        try:
            while part := os.read(ours, 4096):
                said += part
        except OSError:  # how Linux says that nobody has the terminal open any more
            pass
        assert run.wait(120) == 0
    os.close(ours)
    return said.decode()


@pytest.mark.timeout(300)
def test_prefect_telemetry_is_disabled(tmp_path):
    script = "from vastflow.tasks.prefect.adapter import import_prefect; import_prefect()"
    assert said_in_a_terminal(script, tmp_path / "home") == ""
    assert not (tmp_path / "home" / ".sdk_telemetry").exists()


def test_generated_flow_run_names_are_recognized():
    from prefect.utilities.names import generate_slug

    assert all(adapter.is_generated_name(generate_slug(2)) for _ in range(200))
    assert not any(map(adapter.is_generated_name, ("nightly", "my-campaign", "amber-otter-2", "a name", "")))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("prefect.toml", ""),
        ("pyproject.toml", "tool.prefect.api.url = 'http://127.0.0.1:1/api'"),
        ("pyproject.toml", "[tool"),
        (".env", "export Prefect_LOGGING_SETTINGS_PATH=evil.yml"),
    ],
)
def test_prefect_is_not_imported_where_a_folder_would_configure_it(tmp_path, monkeypatch, name, text):
    monkeypatch.chdir(tmp_path)
    adapter.check_working_directory()
    (tmp_path / name).write_text(text)
    monkeypatch.delitem(sys.modules, "prefect.main", raising=False)
    with pytest.raises(UserError, match=r"got settings of Prefect in the working directory\. Expected them in the env"):
        adapter.import_prefect()


def test_folder_with_settings_of_others_is_accepted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".env").write_text("AWS_PROFILE=mine\n")
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'mine'\ndependencies = ['prefect_aws']\n")
    adapter.check_working_directory()
