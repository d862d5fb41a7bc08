from hypothesis import example, given
from hypothesis import strategies as st

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.shards import MOST_TASK_RUNS, missing_shards, shard_ranges


@example(MOST_TASK_RUNS)
@example(MOST_TASK_RUNS + 1)
@given(st.integers(0, 60_000))
def test_ranges_hold_each_position_once_and_are_few(count):
    parts = shard_ranges(count)
    assert [i for part in parts for i in part] == list(range(count))
    assert len(parts) <= MOST_TASK_RUNS and max(map(len, parts), default=1) == max(-(-count // MOST_TASK_RUNS), 1)


def test_shards_have_incomplete_configurations_and_name_first_and_last():
    nothing = Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {})
    wanted = [ConfigurationRuns(f"room-{k}", "room", k, nothing, 1) for k in range(1, 1000)]
    shards = missing_shards(wanted, dict.fromkeys([*(f"room-{k}" for k in range(1, 402)), "depot-1"], 1))
    assert [each.place for shard in shards for each in shard.configurations] == list(range(1, 402))
    assert (str(shards[0]), str(shards[-1])) == ("1–5 of room", "401 of room")


def test_recorded_configurations_share_shards_and_others_have_their_own():
    nothing = Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {})
    wanted = [ConfigurationRuns(f"room-{k}", "room", k, nothing, 1) for k in range(1, 41)]
    shards = missing_shards(wanted, {f"room-{k}": 3 * (k % 20 == 0) for k in range(1, 41)})
    assert [str(shard) for shard in shards] == [
        "1–16 of room",
        "17–33 of room",
        "34–39 of room",
        "20 of room",
        "40 of room",
    ]
    assert [each.place for each in shards[1].configurations] == [17, 18, 19, *range(21, 34)]
