"""The command `plan`: what it counts, draws and prints, and its exit codes."""

import json
from collections import Counter
from pathlib import Path

import pytest
from command_line import called, refused
from PIL import Image

from vastflow.flows.plan.plan import MEAN_SPEED_MPS, TIMES_REAL_TIME, Estimate, estimate_of, plan_view_of, route_m
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate

PATHS = """\
    variations:
      - PathVariationRandom:
          path_length: [2.0, 200.0]
          path_length_tolerance: 0.5
          robot_diameter: 0.5
          seed: 3
          start_pose: "@start_pose"
          goal_poses: "@goal_pose"
      - ObstacleVariationWithDistanceTrigger:
          obstacle_configs: [{amount: 1, max_distance: 0.2, args: "width:=0.2"}]
          spawn_trigger_point: "@spawn_trigger_point"
          spawn_trigger_threshold: "@spawn_trigger_threshold"
          trigger_distance: 0.8
          robot_diameter: 0.5
          seed: 3
      - ParameterVariationList:
          name: laserscan_random_drop_percentage
          values: [0.0, 0.5, 0.5, 0.9]
    constraints:
      - see_enough: laserscan_random_drop_percentage < 0.8
"""

FLOOR_PLAN = """\
version: 1
configuration:
  - name: rooms
    variations:
      - FloorplanGeneration: {{floorplans: [{plan}]}}
      - PathVariationRandom: {{path_length: 2.0, path_length_tolerance: 0.5, robot_diameter: 0.35, seed: 1}}
"""


@pytest.fixture
def rich_room(small_room):
    """The small room with a feasible and an infeasible path, a duplicate, and an excluded configuration."""
    lines = small_room.read_text().splitlines(keepends=True)
    first, last = lines.index("      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}\n"), lines.index("execution:\n")
    small_room.write_text("".join([*lines[:first], PATHS, *lines[last:]]))
    return small_room


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))


def planned(*arguments):
    return called("plan", *arguments)


def as_json(*arguments):
    result = planned(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    (line,) = result.stdout.splitlines()
    return json.loads(line)


def configurations_of(campaign_file):
    return instantiate(load_campaign(campaign_file)).configurations


def test_plan_counts_configurations_and_their_losses(rich_room):
    found = as_json(rich_room)
    counts = {name: found["coverage"][name] for name in ("realized", "unrealizable", "excluded", "duplicate")}
    assert counts == {"realized": 2, "unrealizable": 1, "excluded": 1, "duplicate": 1}
    assert (found["configurations"], found["stages"]["execute"]) == (2, {"reused": 0, "computed": 4})
    room = found["coverage"]["families"]["room"]
    assert (room["design"]["kind"], room["excluded_by"]) == ("cartesian", {"see_enough": 1})
    assert room["unrealizable_by"]["PathVariationRandom"]["count"] == 1
    printed = planned(rich_room).stdout
    assert "200 m" in printed and "1 ×  room  see_enough" in printed and "dimension" not in printed
    printed = planned(rich_room, "--coverage").stdout
    assert "dimension" in printed and "pair of producers" in printed


@pytest.mark.parametrize(
    ("paths", "runs", "power", "words"),
    [
        (1, 2, {"these": None, "others": None}, "1 path, with 2 runs at each of 2 levels of laserscan_random_drop_percentage."),
        (6, 5, {"these": 0.4, "others": 0.6}, "So many runs show 40 points on these paths in 8 of 10 campaigns, and 60 points for other paths on this map."),
    ],
)  # fmt: skip
def test_plan_states_detectable_effects_for_paths_and_runs(rich_room, paths, runs, power, words):
    text = rich_room.read_text().replace(
        "path_length: [2.0, 200.0]", f"num_paths: {paths}, path_length: 2.0".replace(", ", "\n          ")
    )
    rich_room.write_text(text)
    (found,) = as_json(rich_room, "--runs", runs)["power"]
    assert (found["situations"], found["units"], found["levels"], found["runs"]) == (paths, "path", 2, runs)
    assert (found["power"], found["factors"]) == (power, ["laserscan_random_drop_percentage"])
    assert words in planned(rich_room, "--runs", runs).stdout.replace("\n", "")


def test_plan_draws_first_distinct_configurations(rich_room, tmp_path):
    assert as_json(rich_room)["pictures"] == [] and not list(tmp_path.glob("pictures-*"))
    found = as_json(rich_room, "--pictures", 1, "--out", tmp_path / "pictures")
    assert found["pictures"] == [str(tmp_path / "pictures" / "room-1-1-1.png")]
    with Image.open(found["pictures"][0]) as picture:
        assert (picture.format, min(picture.size) > 400) == ("PNG", True)
    printed = planned(rich_room, "--pictures", 4).stdout.splitlines()
    assert printed[-2:] == [f"pictures-small-room/room-1-1-{k}.png" for k in (1, 2)]
    assert (tmp_path / printed[-1]).is_file()


def test_plan_draws_generated_floor_plan(tmp_path):
    plan = Path(__file__).parents[2] / "campaigns/floorplans/nested_rooms.fpm"
    (tmp_path / "rooms.vast").write_text(FLOOR_PLAN.format(plan=plan))
    assert len(as_json(tmp_path / "rooms.vast", "--pictures", 1)["pictures"]) == 1


def test_picture_has_path_stops_and_obstacle_with_its_trigger(rich_room):
    view = plan_view_of(configurations_of(rich_room)[0])
    start, goal = view.situation.start, view.situation.goals[0]
    assert [tuple(view.route_xy_m[k]) for k in (0, -1)] == [(start.x_m, start.y_m), (goal.x_m, goal.y_m)]
    assert [obstacle.trigger.distance_m for obstacle in view.situation.obstacles] == [0.8]


def test_estimate_is_of_distinct_runs_at_mean_speed(rich_room):
    configurations = configurations_of(rich_room)
    five = Counter({each.name: 5 for each in configurations if each.duplicate_of is None})
    length_m = configurations[0].provenance["_path_length"]
    found = estimate_of(configurations, five, timeout_s=1000.0, cores=2)
    assert found.simulated_s == pytest.approx(2 * 5 * length_m / MEAN_SPEED_MPS)
    assert found.wall_s == pytest.approx(found.simulated_s / (2 * TIMES_REAL_TIME))


def test_estimate_uses_straight_line_without_path_up_to_timeout(small_room):
    configurations = configurations_of(small_room)
    assert [route_m(configuration) for configuration in configurations] == [2.0, 2.0]
    three = Counter({each.name: 3 for each in configurations})
    assert estimate_of(configurations, three, timeout_s=1.5, cores=1).simulated_s == 2 * 3 * 1.5
    assert "estimate: about" in " ".join(planned(small_room).stdout.split())
    assert Estimate(10.0, 300.0, 1).how == (
        "each run its path at 0.3 m/s, 300 s at most, 1 core of 200 times real time each, "
        "without Prefect's start and compilation"
    )


def test_plan_reports_faults_as_validate_does(small_room, rich_room, tmp_path):
    (tmp_path / "taken").write_text("")
    assert refused("plan", small_room, "--out", tmp_path / "taken").startswith("--out ")
    text = rich_room.read_text()
    rich_room.write_text(text.replace("percentage < 0.8", "percentage > 2"))
    assert "The constraints leave nothing of family 'room'" in refused("plan", rich_room)
    small_room.write_text(text.replace("  runs: 2", "  rums: 2"))
    assert refused("plan", small_room) == refused("validate", small_room)
