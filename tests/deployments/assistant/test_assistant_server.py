"""The server: its tools, over pipes and sockets of real processes, and what it refuses."""

import asyncio
import http.client
import json
import os
import re
import subprocess
import sys
from contextlib import contextmanager

import pytest
from command_line import called, refused
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client
from table import each_row

from vastflow.deployments.assistant.server import server_of

MOST_TOKENS = 6_000
CHARACTERS_A_TOKEN = 3
"""Fewer than English prose has, as JSON is dense."""
ENDS_S = 120
TOKEN = "a-token-of-the-tests-only"
COMMAND = ["-P", "-m", "vastflow.flows.cli", "mcp"]
ACCEPTS = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
HELLO = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/list", "params": {}})


async def asked(client):
    """Ask as an assistant does, and return the answers."""
    tools = (await client.list_tools()).tools
    newest = (await client.call_tool("campaigns", {})).structured_content["campaigns"][0]["campaign"]
    rates = await client.call_tool("rates", {"campaign": newest, "by": "family"})
    rows = await client.call_tool("sql", {"query": "SELECT count(*) FROM runs", "campaign": newest})
    picture = await client.call_tool("draw_map", {"configuration": "room-1", "campaign": newest})
    nonsense = await client.call_tool("rates", {"campaign": "nothing"})
    return tools, rates, rows, picture, nonsense


def check(answers):
    tools, rates, rows, picture, nonsense = answers
    assert [each.name for each in tools][:4] == ["campaigns", "tables", "sql", "rates"]
    assert [each["family"] for each in rates.structured_content["rates"]] == ["room", "other"]
    assert rows.structured_content["rows"] == [[12]]
    assert [each.type for each in picture.content] == ["image", "text"]
    assert nonsense.is_error
    assert nonsense.content[0].text.count("\n") == 0


@pytest.mark.timeout(ENDS_S)
def test_session_over_standard_input_and_output(results):
    server = StdioServerParameters(
        command=sys.executable, args=[*COMMAND, str(results)], env={"HOME": os.environ["HOME"]}
    )

    async def session():
        async with Client(stdio_client(server)) as client:
            return await asked(client)

    check(asyncio.run(asyncio.wait_for(session(), ENDS_S)))


@pytest.mark.timeout(ENDS_S)
def test_standard_output_has_nothing_but_the_protocol(results):
    hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "x", "version": "1"}}
    lines = [
        {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello},
        {"jsonrpc": "2.0", "method": "notifications/initialized"},
        {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": {"name": "campaigns", "arguments": {}}},
    ]
    with subprocess.Popen(
        [sys.executable, *COMMAND, str(results)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        for line in lines:
            process.stdin.write(json.dumps(line) + "\n")
        process.stdin.flush()
        said = [json.loads(process.stdout.readline()) for _ in range(2)]
        process.stdin.close()
        assert process.stdout.read() == ""
        assert process.wait(ENDS_S) == 0
    assert [each["id"] for each in said] == [1, 2]
    assert "campaigns" in said[1]["result"]["structuredContent"]


@contextmanager
def served(results, **environment):
    """Serve over HTTP; yield the port, and what was said on standard error."""
    process = subprocess.Popen(
        [sys.executable, *COMMAND, str(results), "--http", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    try:
        said = [process.stderr.readline() for _ in range(2)]
        yield int(re.search(r"127\.0\.0\.1:(\d+)/mcp", said[0])[1]), said
    finally:
        process.terminate()
        assert process.communicate(timeout=ENDS_S)[0] == ""


@pytest.fixture(scope="module")
def port(results):
    with served(results, VASTFLOW_MCP_TOKEN=TOKEN) as (port, said):
        assert TOKEN not in "".join(said)
        yield port


def answer(port, *, path="/mcp", body=HELLO, **headers):
    """Return status and text of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=ENDS_S)
    try:
        connection.request("POST", path, body, {**ACCEPTS, **headers})
        reply = connection.getresponse()
        return reply.status, reply.read().decode()
    finally:
        connection.close()


@pytest.mark.timeout(ENDS_S)
def test_session_over_http(port):
    async def session():
        http = create_mcp_http_client({"Authorization": f"Bearer {TOKEN}"})
        async with http, Client(streamable_http_client(f"http://127.0.0.1:{port}/mcp", http_client=http)) as client:
            return await asked(client)

    check(asyncio.run(asyncio.wait_for(session(), ENDS_S)))


@pytest.mark.timeout(ENDS_S)
@each_row(
    "status, headers, path",
    [
        (401, {}, "/mcp"),
        (401, {}, f"/mcp?token={TOKEN}"),
        (401, {"Authorization": f"Bearer {TOKEN}x"}, "/mcp"),
        (401, {"Authorization": f"Basic {TOKEN}"}, "/mcp"),
        (401, {"Authorization": "Bearer "}, "/mcp"),
        (401, {"Cookie": f"token={TOKEN}"}, "/anything"),
        (421, {"Authorization": f"Bearer {TOKEN}", "Host": "example.org"}, "/mcp"),
        (421, {"Authorization": f"Bearer {TOKEN}", "Host": "127.0.0.1.example.org:80"}, "/mcp"),
        (403, {"Authorization": f"Bearer {TOKEN}", "Origin": "https://example.org"}, "/mcp"),
        (403, {"Authorization": f"Bearer {TOKEN}", "Origin": "null"}, "/mcp"),
    ],
)
def test_request_without_right_token_host_and_origin_is_refused(port, status, headers, path):
    found, text = answer(port, path=path, **headers)
    assert found == status
    assert text.startswith('{"error"' if status == 401 else "Invalid ")
    assert "campaigns" not in text


@pytest.mark.timeout(ENDS_S)
def test_server_refuses_large_body(port):
    assert answer(port, body=json.dumps("x" * 2**21), Authorization=f"Bearer {TOKEN}")[0] == 413


@pytest.mark.timeout(ENDS_S)
def test_token_is_printed_once_on_standard_error_and_admits(results):
    with served(results, VASTFLOW_MCP_TOKEN="") as (port, said):
        token = said[1].removeprefix("token: ").strip()
        assert len(token) >= 32
        assert token not in said[0]
        assert answer(port, Authorization=f"Bearer {token}")[0] not in (401, 403, 421)


@each_row(
    "words, tool, arguments",
    [
        ("expected a tool, one of campaigns, tables", "nothing", {}),
        ("rates: expected arguments of campaign, by", "rates", {"campaign_id": "x"}),
        ("rates: limit: Input should be a valid integer", "rates", {"limit": "many"}),
        ("rates: limit: Input should be less than or equal to 200", "rates", {"limit": 10**9}),
        ("describe_run: configuration: Field required", "describe_run", {"run_index": 0}),
        ("campaign: expected one of", "failures", {"campaign": "../../etc"}),
        ("campaign: 2 are known, got ''", "failures", {}),
        ("by: did you mean 'noise'?", "rates", {"campaign": 0, "by": "noize"}),
        ("oracle: expected", "rates", {"campaign": 0, "by": "family", "oracle": "judge"}),
        ("configuration: did you mean 'room-1'?", "draw_map", {"campaign": 0, "configuration": "room-11"}),
        (
            "run_index: expected one of 0, 1, 2, 3, got '9'",
            "draw_map",
            {"campaign": 0, "configuration": "room-1", "run_index": [9]},
        ),
        (
            "expected the number of a run, 0 to 3, got 9",
            "describe_run",
            {"campaign": 0, "configuration": "room-1", "run_index": 9},
        ),
        ("No oracle 'x' judged both campaigns.", "compare", {"before": 0, "after": 0, "oracle": "x"}),
        ('syntax error at or near "tell"', "sql", {"query": "tell me all"}),
    ],
)
def test_nonsense_gets_one_sentence(call, ids, words, tool, arguments):
    names = {
        key: ids[0] if value == 0 and key in ("campaign", "before", "after") else value
        for key, value in arguments.items()
    }
    said = call(tool, **names)
    assert words in said
    assert said.count("\n") == 0
    assert len(said) < 800


def test_fault_of_vastflow_is_a_sentence_and_its_trace_in_the_log(call, monkeypatch, capsys, answers):
    monkeypatch.setattr(answers._directories, "all", lambda: 1 / 0)
    assert call("campaigns").endswith("vastflow failed: ZeroDivisionError. The log of the server says more.")
    assert "ZeroDivisionError: division by zero" in capsys.readouterr().err


def test_large_answer_becomes_one_sentence(call, monkeypatch):
    monkeypatch.setattr("vastflow.deployments.assistant.answers.robot_text", lambda _: "x" * 10**6)
    assert "at most 200,000 characters, got 2,00" in call("campaigns")


def test_schemas_of_all_tools_stay_below_the_ceiling(answers, drafts):
    server = server_of(answers, drafts, allow_run=True)
    tools = [each.model_dump(by_alias=True, exclude_none=True) for each in asyncio.run(server.list_tools())]
    assert len(json.dumps(tools)) / CHARACTERS_A_TOKEN < MOST_TOKENS
    for tool in tools:
        assert tool["description"]
        for name, about in tool["inputSchema"]["properties"].items():
            assert about["description"], f"{tool['name']}: {name}"


def test_tools_have_one_name_for_each_argument(answers, drafts):
    tools = asyncio.run(server_of(answers, drafts, allow_run=True).list_tools())
    names = {name for tool in tools for name in tool.input_schema["properties"]}
    own = {"by", "query", "oracle", "margin", "before", "after", "text", "files_of", "runs"}
    assert names == {"campaign", "configuration", "run_index", "limit", "offset", *own}


def test_tools_that_run_are_there_with_permission_alone(answers, drafts):
    names = [
        [e.name for e in asyncio.run(server_of(answers, drafts, allow_run=allowed).list_tools())]
        for allowed in (False, True)
    ]
    assert {*names[1]} - {*names[0]} == {"run_campaign"}


def test_command_is_listed_without_importing_the_protocol():
    code = "import sys; sys.argv = ['vastflow', '--help']\nfrom vastflow.flows.cli.__main__ import main\n"
    code += "try:\n    main()\nfinally:\n    print({'mcp', 'duckdb', 'starlette', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=ENDS_S, check=False)
    listed = done.stdout.strip().splitlines()
    assert any(
        line.split(maxsplit=1) == ["mcp", "Answer an assistant's questions on campaigns (MCP)."] for line in listed
    )
    assert listed[-1] == "set()"


def test_command_shows_its_options():
    assert {"--http", "--allow-run", "--workspace"} <= {*called("mcp", "--help").stdout.split()}


def test_command_refuses_in_a_sentence(tmp_path, monkeypatch, results):
    assert "expected a folder, got nothing there" in refused("mcp", tmp_path / "nothing")
    assert "--workspace" in refused("mcp", tmp_path, "--workspace", tmp_path / "nothing")
    assert "expected a folder of campaign directories" in refused("mcp", max(results.iterdir()), "--allow-run")
    monkeypatch.setenv("VASTFLOW_MCP_TOKEN", "short")
    assert "VASTFLOW_MCP_TOKEN: expected at least 16 characters, got 5" in refused("mcp", tmp_path, "--http", "0")
    monkeypatch.setitem(sys.modules, "duckdb", None)
    assert "Call pip install 'vastflow[mcp]'." in refused("mcp", tmp_path)
