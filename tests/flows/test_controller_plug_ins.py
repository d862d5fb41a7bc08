"""A campaign with a plug-in controller: its copy, its bundle, and warnings of inputs outside the key."""

import re
import shutil
from pathlib import Path

import pytest

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.tasks.engine.bundle import Packer
from vastflow.tasks.store.store import open_store

PAGE = Path(__file__).parents[2] / "docs" / "write-a-controller.md"


@pytest.fixture(params=["", "../nav2/"], ids=["beside", "elsewhere"])
def campaign_file(request, small_room):
    """The page's controller, its parameter file beside the campaign file or elsewhere."""
    home = small_room.parent
    nav2 = (home / request.param).resolve()
    nav2.mkdir(exist_ok=True)
    for name in ("my_pursuit.py", "my_pursuit.yaml"):
        (text,) = re.findall(rf"^```\w+ {re.escape(name)}\n((?:.*\n)*?)^```$", PAGE.read_text(), re.MULTILINE)
        (nav2 / name).write_text(text)
    text = small_room.read_text().replace("laserscan_gaussian_noise_std_deviation", "controller")
    text = text.replace("0.0, 0.02", "rpp, my_pursuit.py:PurePursuit")
    small_room.write_text(f"{text}  nav2_params: {request.param}my_pursuit.yaml\n")
    return small_room


def controllers(scenarios) -> list[str]:
    return [type(parameters_of(scenario.system).controller).__name__ for scenario in scenarios]


def scenarios_of(file: Path):
    campaign, _ = read_campaign(file)
    return [configuration.scenario for configuration in instantiate(campaign).configurations]


def test_campaign_refuses_unknown_controller(campaign_file):
    campaign_file.write_text(campaign_file.read_text().replace("PurePursuit", "PurePursit"))
    with pytest.raises(
        FileError, match=r"did you mean 'my_pursuit.py:PurePursuit'\? one of dwb, mppi, rpp, my_pursuit"
    ):
        read_campaign(campaign_file)


def test_campaign_directory_keeps_controller_as_read(campaign_file, tmp_path):
    campaign, oracles = read_campaign(campaign_file)
    plug_in = next(campaign_file.parent.parent.rglob("my_pursuit.py"))
    text = plug_in.read_text()
    plug_in.write_text("raise SystemExit\n")  # while it runs
    inputs_of(campaign, oracles).write(tmp_path)
    (kept,) = (tmp_path / "inputs").rglob("my_pursuit.py")
    assert kept.read_text() == text
    assert (kept.parent / "my_pursuit.yaml").is_file()


def test_remote_workers_get_controller_as_read(campaign_file, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scenarios = scenarios_of(campaign_file)
    next(campaign_file.parent.parent.rglob("my_pursuit.py")).write_text("raise SystemExit\n")
    store = open_store(tmp_path / "store")
    bundle = Packer(store).packed(scenarios)
    shutil.rmtree(campaign_file.parent)
    assert controllers(bundle.opened(store)) == ["RppParameters", "PurePursuit"]
