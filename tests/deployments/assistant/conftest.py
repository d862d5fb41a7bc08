"""Campaign directories, and answers on them."""

import asyncio
from pathlib import Path

import pytest
from explored import write_explored
from mcp import Client
from synthetic import walled_room, write_map

from vastflow.deployments.assistant.answers import Answers
from vastflow.deployments.assistant.drafts import Drafts
from vastflow.deployments.assistant.server import server_of
from vastflow.deployments.explorer.directories import Directories

ENDS_S = 120


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Path:
    """A folder with two campaigns of twelve runs in three configurations of two families."""
    folder = tmp_path_factory.mktemp("assistant")
    room = write_map(folder / "room", walled_room(6.0, 4.0))
    (folder / "results").mkdir()
    write_explored(folder / "results", room, 27, {"room": [0, 1], "other": [4]})
    write_explored(folder / "results", room, 28, {"room": [1, 2], "other": [4]})
    return folder / "results"


@pytest.fixture(scope="session")
def ids(results) -> list[str]:
    """The ids of the campaigns, the newest first."""
    return [each.id for each in Directories([results]).all()]


@pytest.fixture
def answers(results) -> Answers:
    return Answers(Directories([results]))


@pytest.fixture
def drafts(answers):
    """Drafts without a workspace, of which none is run."""
    found = Drafts(answers.directory, None, None)
    yield found
    found.close()


@pytest.fixture
def call(answers, drafts):
    """Calls a tool of a server in this process; returns its error, or what it answers."""
    server = server_of(answers, drafts, allow_run=False)

    async def called(name, arguments):
        async with Client(server) as client:
            return await client.call_tool(name, arguments)

    def result(tool, **arguments):
        found = asyncio.run(asyncio.wait_for(called(tool, arguments), ENDS_S))
        return found.content[0].text if found.is_error else found.structured_content or found.content

    return result
