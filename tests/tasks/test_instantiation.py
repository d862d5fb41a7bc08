import re
from dataclasses import replace

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.instantiation import Instantiator, UnknownName, selected
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import open_store

CAMPAIGN = """
version: 1
configuration:
  - name: hall
    parameters: [goal_pose: {x: 1.0, y: 0.0}, start_pose: {x: 0.0, y: 0.0}, map_file: room.yaml]
    variations:
      - ParameterVariationList: {name: a, values: [1, 2, 2]}
      - own.py:Own: {}
  - name: yard
    parameters: [goal_pose: {x: 1.0, y: 0.0}, start_pose: {x: 0.0, y: 0.0}, map_file: room.yaml]
    variations:
      - ParameterVariationList: {name: a, values: [1, 5]}
      - own.py:Own: {}
"""
OWN = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer

class Own(Producer[Parameters]):
    Parameters = Parameters
    reads = ("a",)
    writes = {"b": None}
    def produce(self, inputs, draws):
        yield Fragment({"b": 10 * inputs["a"]})
"""


@pytest.fixture
def campaign(tmp_path):
    cells = bytes(0 if x in (0, 59) or y in (0, 59) else 254 for y in range(60) for x in range(60))
    (tmp_path / "room.pgm").write_bytes(b"P5 60 60 255\n" + cells)
    (tmp_path / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [-1, -1, 0]}")
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "x.vast").write_text(CAMPAIGN)
    return load_campaign(tmp_path / "x.vast")


@pytest.fixture
def instantiator(campaign, tmp_path):
    keys = Keys("numeric", "e", "o", "j", 0, [])
    return Instantiator(campaign, open_store(tmp_path / "store"), keys, installed_tree())


class Here:
    """Evaluates in this process and counts; breaks where an input has `a` of `breaking`."""

    def __init__(self, store, breaking=None):
        self.store = store
        self.breaking = breaking
        self.evaluated = 0

    def __call__(self, requests):
        errors = {}
        for producer, each in ((request.producer, each) for request in requests for each in request.evaluations):
            if each.inputs.get("a") == self.breaking:
                errors[each.key] = "ValueError: x"
            else:
                self.evaluated += 1
                work.evaluate(self.store, each.key, packed(producer), each.inputs)
        return errors


def test_instantiation_over_the_store_equals_that_in_one_process(campaign, instantiator):
    assert instantiator.instantiated(Here(instantiator.store, "none")).instantiation == instantiate(campaign)


DESIGNED = CAMPAIGN.replace(
    "  - name: hall\n",
    "  - name: hall\n    design: {t_way: {strength: 2}}\n    constraints: {odd: a + b != 11, long: path_length > 0.5}\n",
)


def test_sharded_designs_match_single_process(campaign, instantiator):
    campaign.path.write_text(DESIGNED)
    designed = replace(instantiator, campaign=load_campaign(campaign.path))
    found = designed.instantiated(Here(instantiator.store, "none")).instantiation
    assert found == instantiate(designed.campaign)
    assert [c.name for c in found.configurations] == ["hall-2-1", "hall-3-1", "yard-1-1", "yard-2-1"]
    assert [e.constraint for e in found.excluded] == ["odd"]


def test_input_that_two_families_share_is_evaluated_once(instantiator):
    here = Here(instantiator.store, "none")
    instantiator.instantiated(here)
    assert here.evaluated == 2 + 3  # two lists; own.py on a = 1, 2 and 5


def test_stored_instantiation_is_found(instantiator):
    assert instantiator.stored() is None
    instantiated = instantiator.instantiated(Here(instantiator.store, "none"))
    assert instantiator.stored() == instantiated


def test_damaged_evaluation_is_missing(instantiator):
    instantiator.instantiated(Here(instantiator.store, "none"))
    fragments = next((instantiator.store.local / "evaluate").rglob("fragments.json"))
    fragments.write_bytes(fragments.read_bytes()[::-1])
    assert instantiator.stored() is None


def test_raising_producer_is_reported_once(instantiator):
    instantiated = instantiator.instantiated(Here(instantiator.store, breaking=2))
    assert [c.name for c in instantiated.instantiation.configurations] == ["hall-1-1", "yard-1-1", "yard-2-1"]
    assert [(f.family, f.producer, f.error) for f in instantiated.faults] == [("hall", "Own", "ValueError: x")]


def test_family_or_a_configuration_can_be_selected(instantiator):
    whole = instantiator.instantiated(Here(instantiator.store, "none")).instantiation
    assert [c.name for c in selected(whole, ["hall-2-1", "yard"]).configurations] == [
        "hall-2-1",
        "yard-1-1",
        "yard-2-1",
    ]


def test_duplicate_of_unselected_configuration_runs(instantiator):
    whole = instantiator.instantiated(Here(instantiator.store, "none")).instantiation
    assert [c.duplicate_of for c in whole.configurations] == [None, None, "hall-2-1", "hall-1-1", None]
    assert [c.duplicate_of for c in selected(whole, ["yard"]).configurations] == [None, None]


def test_unknown_name_lists_known_ones(instantiator):
    whole = instantiator.instantiated(Here(instantiator.store, "none")).instantiation
    with pytest.raises(UnknownName, match="no family or configuration 'lawn'") as raised:
        selected(whole, ["hall", "lawn"])
    assert raised.value.known[:2] == ("hall", "hall-1-1")


def test_missing_map_is_a_fault_of_one_family(campaign, instantiator):
    yard = CAMPAIGN.replace("map_file: room.yaml", "map_file: room2.yaml").replace("room2", "room", 1)
    campaign.path.write_text(yard)
    found = replace(instantiator, campaign=load_campaign(campaign.path)).instantiated(Here(instantiator.store, "none"))
    assert {each.family for each in found.instantiation.configurations} == {"hall"}
    (fault,) = found.faults
    assert fault.family == "yard"
    assert re.fullmatch(
        r"yard: .*x\.vast:10:\d+: configuration\[1\]\.parameters\[2\]\.map_file: .*room2\.yaml: No such file. .*",
        str(fault),
    )
    assert fault.concerns("yard-1")
    assert not fault.concerns("hall")
