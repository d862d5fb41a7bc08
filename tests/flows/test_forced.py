"""Forced stages: what is computed again although the store has it, and what is kept."""

import json
import shutil

import pytest
from command_line import called, refused
from planned import planned
from room import laid_out
from table import each_row

from vastflow.flows import run_campaign
from vastflow.flows.results.reasons import whys

pytestmark = pytest.mark.timeout(900)

UNLESS_RECORDED = "follows from execute, unless recordings come out as before"
UNLESS_TRACED = "follows from observe, unless traces come out as before"


def why_of(plan):
    return {why.stage: (str(why), why.amount) for why in whys(plan.due)}


@each_row(
    ("force", "why"),
    [
        (
            True,
            {
                "instantiate": ("forced", 1),
                "execute": ("forced", 4),
                "observe": ("forced", 4),
                "judge": ("forced", 4),
            },
        ),
        ("instantiate", {"instantiate": ("forced", 1)}),
        ("execute", {"execute": ("forced", 4), "observe": (UNLESS_RECORDED, 4), "judge": (UNLESS_RECORDED, 4)}),
        ("observe", {"observe": ("forced", 4), "judge": (UNLESS_TRACED, 4)}),
        ("judge", {"judge": ("forced", 4)}),
        (False, {}),
    ],
)
def test_plan_gives_forced_as_reason_and_removes_nothing(ran, small_room, force, why):
    folder = ran().parents[1]
    before = sorted((folder / "store").rglob("*"))
    options = {"results": folder / "results", "store": str(folder / "store")}
    assert why_of(planned(small_room, force=force, **options)) == why
    assert sorted((folder / "store").rglob("*")) == before


def test_plan_gives_own_reason_for_what_the_store_lacked_anyway(ran, small_room, tmp_path):
    ran()
    options = {"results": tmp_path / "results", "store": str(tmp_path / "store")}
    whole = planned(small_room, force="execute", runs=3, **options)
    assert [(str(why), why.amount) for why in whys(whole.due) if why.stage == "execute"] == [
        ("forced", 4),
        ("more runs are asked: 2 before, now 3", 2),
    ]
    shutil.rmtree(tmp_path / "store")
    assert why_of(planned(small_room, force=True, **options))["judge"] == ("follows from execute", 4)


def test_command_takes_force_with_and_without_stage(ran, small_room, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    ran()

    def computed(*options):
        result = called("plan", small_room, "--results", tmp_path / "results", "--json", *options)
        return [stage["computed"] for stage in json.loads(result.stdout)["stages"].values()]

    assert computed("--force") == computed("--force", "--why") == computed("--force=all") == [1, 4, 4, 4]
    assert computed("--force", "judge") == [0, 0, 0, 4]
    words = "--force: expected all, instantiate, execute, observe, judge, or nothing, got 'report'"
    assert words in refused("plan", small_room, "--force", "report")


@pytest.fixture(scope="module")
def place(flow_folder):
    laid_out(flow_folder, "again", [0.6])
    return flow_folder


@pytest.fixture(scope="module")
def run(place):
    def run(**options):
        return run_campaign(
            place / "again.vast", results=place / "results", store=place / "store", workers=2, **options
        )

    return run


@pytest.fixture(scope="module")
def first(run):
    return run()


def written(place):
    """Stage to the artifacts of the store with the time of their writing."""
    found = {}
    for file in (place / "store").rglob("manifest"):
        stage = file.relative_to(place / "store").parts[0]
        found.setdefault(stage, {})[str(file)] = file.stat().st_mtime_ns
    return found


STAGES = ("evaluate", "execute", "observe", "judge")


@each_row(
    ("force", "executed", "again"),
    [(True, 4, STAGES), ("execute", 4, ("execute",)), ("judge", 0, ("judge",))],
)
def test_forced_stage_is_computed_again_and_gives_the_same_results(place, run, first, force, executed, again):
    before = written(place)
    found = run(force=force)
    assert (found.summary.executed, found.summary.reused, found.faults) == (executed, 4 - executed, ())
    after = written(place)
    for stage in STAGES:
        assert after[stage].keys() == before[stage].keys()
        kept = {key for key, time_ns in after[stage].items() if before[stage][key] == time_ns}
        assert kept == (set() if stage in again else before[stage].keys())
    for table in ("runs", "verdicts"):
        name = f"{table}.parquet"
        assert (found.directory / name).read_bytes() == (first.directory / name).read_bytes()
    why = {row["stage"]: row["why"] for row in json.loads((found.directory / "metadata.json").read_text())["why"]}
    forced = {stage if stage != "evaluate" else "instantiate" for stage in again}
    assert {stage for stage, words in why.items() if words == "forced"} == forced
    assert run().directory == found.directory


def test_campaign_interrupted_after_a_stage_was_forced_is_completed_by_the_next_call(place, run, first, monkeypatch):
    before = written(place)

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("vastflow.flows.api._computed", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(force="judge")
    assert "judge" not in written(place)
    assert run().summary.reused == 4
    assert written(place)["judge"].keys() == before["judge"].keys()
