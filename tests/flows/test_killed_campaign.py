"""Processes of a campaign that are killed: the short form of tests/proofs/killed.py, and what Prefect shows of them afterwards."""

import random
import subprocess
import sys
from pathlib import Path

import killed as proof
import killed_life
import killed_points
import pytest
from prefect import Flow
from prefect.settings import temporary_settings
from prefect.states import Running

from vastflow.tasks.prefect.orphans import mark_orphans, process_tags

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

SEED = 3
CONFIGURATIONS = 13


@pytest.fixture(scope="module")
def killed():
    """The proof as a module, with fewer configurations."""
    with pytest.MonkeyPatch.context() as patch:
        fewer = killed_life.CAMPAIGN.replace("[1, 2, 3, 4, 5]", "[1, 2]").replace("[21, 22]", "[21]")
        patch.setattr(killed_life, "CAMPAIGN", fewer)
        for module in (proof, killed_life, killed_points):
            patch.setattr(module, "CONFIGURATIONS", CONFIGURATIONS)
        patch.setattr(proof, "ORPHANS_S", 60.0)  # of a machine that may stand still for a while
        yield proof


@pytest.fixture(scope="module")
def lab(killed, tmp_path_factory):
    return killed.Lab.made(tmp_path_factory.mktemp("killed"), copied=False)


@pytest.fixture(scope="module")
def alone(killed, lab):
    """The campaign's results without a kill, and the times at which each process exists."""
    return killed.undisturbed(lab, twice=False)


def test_proof_runs_its_own_copy_of_the_code(killed, tmp_path):
    lab = killed.Lab.made(tmp_path)
    packages = ("", ".deployments", ".flows", ".oracles", ".producers", ".sim", ".tasks")
    names = [f"vastflow{name}" for name in packages]
    look = f"from importlib.util import find_spec; print(*(find_spec(name).origin for name in {names}), sep='\\n')"
    environment = killed.Place(lab, "first").environment()
    found = subprocess.check_output([sys.executable, "-c", look], env=environment, text=True, timeout=60).split()
    copies = [tmp_path / "code" / Path(*name.split("."), "__init__.py") for name in names]
    assert [Path(file) for file in found] == copies


@pytest.mark.parametrize("victim", ["flow", "worker", "server"])
def test_killed_process_loses_only_runs_in_flight(killed, lab, alone, victim):
    whole, there = alone
    (point,) = killed.points(SEED, 1, [("embedded", victim)], {"embedded": there})
    killed.killed(lab, point, random.Random(f"{SEED} {victim}"), whole, api=None)
    assert point.violations == []


@pytest.fixture(scope="module")
def api(started_api, lab, alone, tmp_path_factory):
    with started_api(lab.home, tmp_path_factory.mktemp("api") / "server.log") as client:
        yield client


def test_flow_run_killed_before_first_line_is_marked_crashed(api):
    host, own = process_tags()
    dead, lives = (
        api.create_flow_run(Flow(lambda: None, name="begins"), tags=[host, process], state=Running())
        for process in ("process:1@1", own)
    )
    with temporary_settings({"api.url": str(api.api_url)}):
        mark_orphans()
    assert api.read_flow_run(dead.id).state.is_crashed()
    assert api.read_flow_run(lives.id).state.is_running()
    api.delete_flow_run(lives.id)


def test_missing_server_is_reported_in_one_sentence(killed, lab, alone):
    place = killed.Place(lab, "nowhere", api="http://127.0.0.1:9/api")
    life = place.begin()
    assert life.end() == 3
    assert "Prefect's API at http://127.0.0.1:9/api failed" in life.words()
    assert "Start it (`prefect server start`), or unset PREFECT_API_URL `vastflow run" in life.words()
    assert "Traceback" not in life.words()
    assert place.directories() == []
