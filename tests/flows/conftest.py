"""A small campaign for the tests of flows: a room of 6 m, one family, and what its run leaves."""

import itertools
from datetime import timedelta
from pathlib import Path

import pytest
from room import SMALL_ROOM, drawn_room
from whole_directory import CREATED, ConfigurationResult, write_results

from vastflow.flows.plan import plan as plans
from vastflow.flows.request.campaign_file import campaign_keys, read_campaign
from vastflow.flows.run import prepared, stages
from vastflow.oracles.judgment.verdict import Verdict, write_verdicts
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.reading.checked import checked_digest
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.instantiation import Instantiator
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import open_store


@pytest.fixture(scope="session")
def tree():
    """A source tree that ignores edits of the checkout during the tests."""
    return installed_tree()


@pytest.fixture(scope="module")
def flow_folder(tmp_path_factory, one_server, tree):
    """A folder for the campaigns of a module, which share an embedded API and the source tree."""
    folder = tmp_path_factory.mktemp("flow")
    with one_server(folder / "prefect"), pytest.MonkeyPatch.context() as patch:
        for module in (plans, prepared, stages):
            patch.setattr(module, "installed_tree", lambda: tree)
        yield folder


@pytest.fixture
def no_prefect(monkeypatch):
    monkeypatch.setattr("vastflow.flows.run.flow_call.FlowCall.run", lambda *_: pytest.fail("Prefect was started"))


@pytest.fixture
def small_room(tmp_path: Path) -> Path:
    folder = tmp_path / "campaign"
    drawn_room(folder)
    (folder / "room.vast").write_text(SMALL_ROOM)
    return folder / "room.vast"


@pytest.fixture
def ran(small_room, tmp_path, tree):
    """Gives the directory of an edited campaign and leaves its store, as `vastflow run` would of two short runs."""
    store, hours = open_store(tmp_path / "store"), itertools.count(1)
    runs = [Recording(Run(k, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0), {}) for k in range(2)]
    block = write_recordings(runs)
    verdicts = write_verdicts([Verdict("success", k, "pass") for k in range(2)])

    def run(old="", new=""):
        small_room.write_text(small_room.read_text().replace(old, new))
        campaign, oracles = read_campaign(small_room)
        keys = campaign_keys(tree, campaign.seed, oracles)

        def evaluate(requests):
            for request in requests:
                for each in request.evaluations:
                    work.evaluate(store, each.key, packed(request.producer), each.inputs)
            return {}

        instantiation = Instantiator(campaign, store, keys, tree).instantiated(evaluate).instantiation
        for configuration in instantiation.configurations:
            scenario = checked_digest(configuration.scenario)
            recordings = store.put(
                f"{keys.recordings(scenario)}/0-2", {"recordings.parquet": block}, {"runs": [[0, 9.0], [1, 9.0]]}
            )
            trace = store.put(keys.trace(scenario, recordings.content), {"traces.parquet": b"trace"})
            key = keys.verdicts(scenario, recordings.content, trace.content)
            store.put(key, {"verdicts.json": verdicts}, {"runs": [[0, "pass"], [1, "pass"]], "causes": []})
        named = {"created": CREATED + timedelta(hours=next(hours)), "instantiation": instantiation, "tree": tree}
        return write_results(small_room, tmp_path / "results", ConfigurationResult([block]), **named).directory

    return run
