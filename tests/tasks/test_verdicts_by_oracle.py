"""Verdicts are kept oracle by oracle: an edit lets those judge whose verdicts the store lacks."""

import shutil
from collections import Counter

import pytest
from at_once import AtOnce

from vastflow.flows.request.campaign_file import campaign_keys, read_campaign
from vastflow.flows.request.configurations import distinct_configurations
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.index import Index
from vastflow.tasks.engine.instantiation import Instantiator
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.work import VERDICTS
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.remote_files import RemoteFiles
from vastflow.tasks.store.store import open_store

RUNS = 3
VAST = f"""
version: 1
metadata:
  name: oracles
configuration:
  - name: room
execution:
  scenario_file: wait.osc
  runs: {RUNS}
  timeout: 10
evaluation:
  oracles:
    - first.py:First: {{fails: [0]}}
    - second.py:Second: {{fails: [0, 1]}}
"""
WAIT = "import osc.helpers\n\nscenario wait:\n    do wait elapsed(1s)\n"
ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters as Base


class Parameters(Base):
    fails: tuple[int, ...] = ()


class NAME(Oracle[Parameters]):
    Parameters = Parameters
    metrics = {"measured": "m"}

    def judge(self, trace, situation):
        with open("LOG", "a") as log:
            log.write("NAME\\n")
        if trace.run.run_index in self.parameters.fails:
            return self.failed(trace, "as it was told", measured=1.0)
        return self.passed(trace, measured=2.0)
"""
FIRST, SECOND = "    - first.py:First: {fails: [0]}\n", "    - second.py:Second: {fails: [0, 1]}\n"
THIRD = "    - third.py:Third: {fails: [2]}\n"


class Campaign:
    """A campaign whose oracles write down that they judge, and a store."""

    def __init__(self, folder):
        self.folder = folder
        self.store = str(folder / "store")
        self.log = folder / "log"
        (folder / "wait.osc").write_text(WAIT)
        (folder / "x.vast").write_text(VAST)
        for name in ("First", "Second", "Third"):
            code = ORACLE.replace("NAME", name).replace("LOG", str(self.log))
            (folder / f"{name.lower()}.py").write_text(code)

    def edit(self, file, old, new):
        text = (self.folder / file).read_text()
        assert old in text
        (self.folder / file).write_text(text.replace(old, new))

    def index(self, place=None):
        campaign, oracles = read_campaign(self.folder / "x.vast")
        tree, store = installed_tree(), open_store(place or self.store)
        keys = campaign_keys(tree, campaign.seed, oracles)
        found = Instantiator(campaign, store, keys, tree).instantiated(lambda requests: {})
        (configuration,) = distinct_configurations(found.instantiation, campaign.runs)
        return Index(store, keys), configuration, oracles

    def judged(self, place=None, executor=AtOnce):
        """Compute the campaign, and return how often each oracle judged."""
        self.log.write_text("")
        index, configuration, oracles = self.index(place)
        engine = Engine(index, executor(), Tally(), oracles)
        next(engine.attempts())
        engine.judge([configuration], engine.observe([configuration], engine.execute([configuration]).made).made)
        assert engine.faults == ()
        return Counter(self.log.read_text().split())

    def verdicts(self, place=None):
        """Verdicts as they are stored, judgments and causes."""
        index, configuration, _ = self.index(place)
        stored = [each.verdicts for each in index.stored(configuration)]
        return [(index.store.load(verdicts, VERDICTS), verdicts.info) for verdicts in stored]


@pytest.fixture
def campaign(tmp_path):
    found = Campaign(tmp_path)
    assert found.judged() == {"First": RUNS, "Second": RUNS}
    return found


EDITS = {
    "a comment": (("first.py", "    def judge", "    # a comment\n    def judge"), {}),
    "removed": (("x.vast", SECOND, ""), {}),
    "both removed": (("x.vast", FIRST + SECOND, "    - success: {}\n"), {}),
    "swapped": (("x.vast", FIRST + SECOND, SECOND + FIRST), {}),
    "added": (("x.vast", FIRST, THIRD + FIRST), {"Third": RUNS}),
    "removed and added": (("x.vast", FIRST, THIRD), {"Third": RUNS}),
    "a parameter": (("x.vast", "fails: [0]", "fails: [2]"), {"First": RUNS}),
    "code": (("second.py", "measured=2.0", "measured=3.0"), {"Second": RUNS}),
    "another name": (("x.vast", "second.py", "./second.py"), {"Second": RUNS}),
}


@pytest.mark.parametrize(("edit", "expected"), EDITS.values(), ids=EDITS)
def test_edit_lets_only_oracles_without_verdicts_judge(campaign, edit, expected):
    campaign.edit(*edit)
    assert campaign.judged() == expected
    fresh = campaign.folder / "fresh"
    for stage in ("execute", "observe"):
        shutil.copytree(campaign.folder / "store" / stage, fresh / stage)
    campaign.judged(fresh)
    assert campaign.verdicts() == campaign.verdicts(fresh)
    assert campaign.judged() == {}


def test_edit_on_s3_copies_verdicts_and_lists_nothing_for_them(tmp_path, s3, monkeypatch):
    campaign, names, asked = Campaign(tmp_path), RemoteFiles.names, []
    campaign.store = s3
    monkeypatch.setattr(RemoteFiles, "names", lambda files, key: [asked.append(key), *names(files, key)][1:])
    assert campaign.judged() == {"First": RUNS, "Second": RUNS}
    campaign.edit("x.vast", FIRST + SECOND, SECOND + THIRD)
    assert campaign.judged() == {"Third": RUNS}
    campaign.judged(tmp_path / "fresh")
    assert campaign.verdicts() == campaign.verdicts(tmp_path / "fresh")
    assert [key for key in asked if key.startswith("judge")] == []


class WholeUnits(AtOnce):
    """Brings runs through all stages in one call, as a cluster does."""

    whole_units = True


def test_cluster_copies_verdicts_of_recorded_runs(tmp_path):
    campaign = Campaign(tmp_path)
    assert campaign.judged(executor=WholeUnits) == {"First": RUNS, "Second": RUNS}
    campaign.edit("x.vast", FIRST, THIRD + FIRST)
    assert campaign.judged(executor=WholeUnits) == {"Third": RUNS}
    campaign.judged(tmp_path / "fresh", WholeUnits)
    assert campaign.verdicts() == campaign.verdicts(tmp_path / "fresh")


def test_edit_and_its_reverse_judge_nothing_twice(campaign):
    before = campaign.verdicts()
    campaign.edit("x.vast", SECOND, THIRD)
    assert campaign.judged() == {"Third": RUNS}
    campaign.edit("x.vast", "fails: [0]", "fails: []")
    assert campaign.judged() == {"First": RUNS}
    campaign.edit("x.vast", "fails: []", "fails: [0]")
    campaign.edit("x.vast", THIRD, THIRD + SECOND)  # each oracle's verdicts are beside those of others
    assert campaign.judged() == {}
    campaign.edit("x.vast", THIRD, "")
    assert campaign.judged() == {} and campaign.verdicts() == before


def test_swapped_oracles_need_no_artifact(campaign):
    before = [verdicts.key for verdicts in stored_verdicts(campaign)]
    campaign.edit("x.vast", FIRST + SECOND, SECOND + FIRST)
    assert [verdicts.key for verdicts in stored_verdicts(campaign)] == before


def stored_verdicts(campaign):
    index, configuration, _ = campaign.index()
    return [each.verdicts for each in index.stored(configuration)]


def test_damaged_verdicts_are_judged_again_by_all_oracles(campaign):
    verdicts = stored_verdicts(campaign)[0]
    damaged = campaign.folder / "store" / verdicts.key / VERDICTS
    damaged.write_bytes(damaged.read_bytes().replace(b"pass", b"fail"))  # of the same size
    campaign.edit("x.vast", SECOND, "")
    assert campaign.judged() == {"First": len(verdicts.info["runs"])}
    assert [cause for _, info in campaign.verdicts() for cause in info["causes"]] == [[0, "unknown"]]


def test_verdicts_of_before_lack_oracles_of_their_own(campaign):
    """Artifacts that don't say whose verdicts they have are no help, and no damage."""
    index, configuration, _ = campaign.index()
    (stored, *_) = index.stored(configuration)
    key = stored.verdicts.key.rpartition("-")[0] + "-" + "0" * 32
    index.store.put(key, {VERDICTS: b"[]"}, {"runs": [], "causes": []})
    campaign.edit("x.vast", SECOND, "")
    index, _, _ = campaign.index()
    wanted = index.verdicts_key(configuration, stored.block, stored.trace.content)
    assert index.held(wanted) == {stored.verdicts.key: ["first.py:First", "success"]}
    assert index.store.find(key) is not None


def test_block_names_oracles_that_lack(campaign):
    campaign.edit("x.vast", FIRST, THIRD)
    index, configuration, _ = campaign.index()
    assert {each.lacking for each in index.stored(configuration)} == {frozenset({"third.py:Third"})}
    assert {each.verdicts for each in index.stored(configuration)} == {None}
