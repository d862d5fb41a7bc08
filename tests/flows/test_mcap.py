"""The export format `mcap`: bags that readers which share no code with their writer read as Nav2's."""

import io
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from command_line import called, refused
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from room import SMALL_ROOM, drawn_room
from rosbags.highlevel import AnyReader
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.export.mcap.mcap import bag_of
from vastflow.flows.export.mcap.messages import RunBag
from vastflow.flows.export.mcap.topics import TOPICS, typestore
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.model.shape import Box
from vastflow.sim.nav2.navigator.state import RECOVERIES
from vastflow.sim.replay import Patch
from vastflow.sim.run import run
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import installed_tree

SEED = 5
RIHS01 = {
    "/map": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "/tf": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "/plan": "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    "/scan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "/clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "/particle_cloud": "193d8cb88ca2b98cd81ece15342744f054bb398ebfa8f6369914432303f42b11",
    "/behavior_tree_log": "9335ecb688a4f61b7eb82a7c10f23eea5f4e8bbdb7edfa048e3539aa928f51b7",
}
"""Hashes of Jazzy's definitions, as ROS 2 has them."""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A campaign directory of one configuration with two runs of three seconds."""
    folder = tmp_path_factory.mktemp("campaign")
    drawn_room(folder)
    (folder / "room.vast").write_text(SMALL_ROOM.replace("0.02]", "0.02]") + "  seed: 5\n  timeout: 3\n")

    def found(configuration):
        recordings = [run(configuration.scenario, k, SEED) for k in range(2)]
        verdicts = [Verdict("success", k, "fail") for k in range(2)]
        behaviors = write_behaviors({each.run.run_index: each.behaviors for each in recordings})
        return ConfigurationResult([write_recordings(recordings)], [], verdicts, behaviors=[behaviors])

    keys = Keys(numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), "o" * 64, "j" * 64, SEED, [])
    return write_results(folder / "room.vast", folder / "results", found, runs=2, keys=keys).directory


@pytest.fixture(scope="module")
def recorded(results):
    return recorded_run(results, "room-1", 1)


@pytest.fixture(scope="module")
def bag(recorded, tmp_path_factory):
    place = tmp_path_factory.mktemp("bag") / "rosbag2"
    place.mkdir()
    for name, content in bag_of(recorded).items():
        (place / name).write_bytes(content)
    return place


def read(bag):
    """Return log time, topic, and message of each, in the order of the file."""
    content = io.BytesIO((bag / "rosbag2.mcap").read_bytes())
    reader = make_reader(content, decoder_factories=[DecoderFactory()])
    return [(m.log_time, c.topic, d) for _, c, m, d in reader.iter_decoded_messages(log_time_order=False)]


@pytest.fixture(scope="module")
def messages(bag):
    return read(bag)


def of(messages, topic):
    return [(t_ns, message) for t_ns, name, message in messages if name == topic]


def stamp_ns(message):
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def yaw_of(quaternion):
    return 2 * np.arctan2(quaternion.z, quaternion.w)


def test_bag_has_every_row_of_the_recording(messages, recorded):
    columns = recorded.recording.columns
    truth = of(messages, "/ground_truth/odom")
    assert [t_ns for t_ns, _ in truth] == [int(t) * 10**6 for t in columns["t_ms"]]
    poses = [(m.pose.pose.position.x, m.pose.pose.position.y, yaw_of(m.pose.pose.orientation)) for _, m in truth]
    expected = np.column_stack([columns[name] for name in ("x_mm", "y_mm", "yaw_mrad")]) / 1e3
    assert np.allclose(poses, expected, rtol=0, atol=1e-9)
    sent = [(m.linear.x, m.angular.z) for _, m in of(messages, "/cmd_vel")]
    assert np.allclose(sent, np.column_stack([columns["sent_speed_mmps"], columns["sent_yaw_rate_mradps"]]) / 1e3)
    assert len(of(messages, "/amcl_pose")) == int(columns["localized"].sum())


def test_transforms_lead_from_the_map_to_estimate_and_truth_at_every_time(messages, recorded):
    columns = recorded.recording.columns
    rows = {int(t): k for k, t in enumerate(columns["t_ms"])}
    transforms = of(messages, "/tf")
    assert [t_ns for t_ns, _ in transforms] == [k * 50_000_000 for k in range(len(transforms))]
    compared = 0
    for t_ns, message in transforms:
        tree = {each.child_frame_id: each for each in message.transforms}
        assert {child: each.header.frame_id for child, each in tree.items()} == {
            "odom": "map", "base_link": "odom", "base_link_true": "map",
        }  # fmt: skip
        assert {stamp_ns(each) for each in tree.values()} == {t_ns}
        k = rows.get(t_ns // 10**6)
        if k is None or k == len(columns["t_ms"]) - 1:  # of the last row the stack doesn't know
            continue
        odom, base = (tree[name].transform for name in ("odom", "base_link"))
        turn = yaw_of(odom.rotation)
        x, y = base.translation.x, base.translation.y
        estimate = (
            odom.translation.x + np.cos(turn) * x - np.sin(turn) * y,
            odom.translation.y + np.sin(turn) * x + np.cos(turn) * y,
        )
        assert np.allclose(
            estimate, [columns["estimated_x_mm"][k] / 1e3, columns["estimated_y_mm"][k] / 1e3], atol=6e-4
        )
        true = tree["base_link_true"].transform.translation
        assert np.allclose([true.x, true.y], [columns["x_mm"][k] / 1e3, columns["y_mm"][k] / 1e3], atol=6e-4)
        compared += 1
    assert compared > 25
    ((_, still),) = of(messages, "/tf_static")
    (mount,) = still.transforms
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "base_scan")
    assert (mount.transform.translation.x, yaw_of(mount.transform.rotation)) == pytest.approx((-0.04, np.pi / 2))


def test_scans_end_where_walls_are(messages):
    """Count the beams whose end, 3 cm on, is at an occupied cell."""
    transforms = {
        t_ns: {each.child_frame_id: each.transform for each in m.transforms} for t_ns, m in of(messages, "/tf")
    }
    ((_, occupancy),) = of(messages, "/map")
    cells = np.array(occupancy.data).reshape(occupancy.info.height, occupancy.info.width)
    scans = of(messages, "/scan")
    assert len(scans) >= 28
    shares = []
    for _, scan in scans:
        pose = transforms[stamp_ns(scan)]["base_link_true"]
        yaw = yaw_of(pose.rotation)
        x = pose.translation.x - 0.04 * np.cos(yaw)
        y = pose.translation.y - 0.04 * np.sin(yaw)
        bearings = yaw + np.pi / 2 + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        ranges = np.array(scan.ranges) + 0.03  # into the wall
        hit = np.isfinite(ranges)
        columns = ((x + ranges * np.cos(bearings) - occupancy.info.origin.position.x) / occupancy.info.resolution)[hit]
        rows = ((y + ranges * np.sin(bearings) - occupancy.info.origin.position.y) / occupancy.info.resolution)[hit]
        rows, columns = (
            np.clip(rows.astype(int), 0, cells.shape[0] - 1),
            np.clip(columns.astype(int), 0, cells.shape[1] - 1),
        )
        shares.append(
            np.mean(
                [
                    cells[max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3].max() == 100
                    for r, c in zip(rows, columns, strict=True)
                ]
            )
        )
    assert np.mean(shares) > 0.95


def test_messages_are_in_order_and_stamps_never_go_back(messages):
    times = [t_ns for t_ns, _, _ in messages]
    assert times == sorted(times)
    last = {}
    for t_ns, topic, message in messages:
        if hasattr(message, "header"):
            stamp = stamp_ns(message)
            assert last.get(topic, 0) <= stamp <= t_ns, topic
            last[topic] = stamp
    first = {topic: k for k, (_, topic, _) in reversed(list(enumerate(messages)))}
    assert first["/tf"] < first["/scan"]
    assert first["/tf_static"] < first["/scan"]


def test_map_transforms_and_costmaps_are_offered_to_those_who_come_late(bag):
    told = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (told["ros_distro"], told["version"], told["storage_identifier"]) == ("jazzy", 9, "mcap")
    assert told["custom_data"]["executed_again"] == "equal to the recording bit for bit"
    latched, types = set(), {}
    for each in told["topics_with_message_count"]:
        topic = each["topic_metadata"]
        (qos,) = topic["offered_qos_profiles"]
        types[topic["name"]] = topic["type_description_hash"]
        if qos["durability"] == "transient_local":
            latched.add(topic["name"])
        assert (qos["reliability"] == "best_effort") == TOPICS[topic["name"]].best_effort
    assert {"/map", "/tf_static", "/amcl_pose", "/local_costmap/costmap", "/global_costmap/costmap"} <= latched
    assert latched.isdisjoint({"/tf", "/scan", "/odom", "/cmd_vel", "/plan"})
    assert {topic: types[topic].removeprefix("RIHS01_") for topic in RIHS01} == RIHS01


def test_another_reader_finds_the_same_messages(bag, messages):
    with AnyReader([bag], default_typestore=typestore()) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
        assert counts == {topic: len(of(messages, topic)) for topic in counts}
        assert sum(counts.values()) == len(messages)
        assert {name: topic.msgtype for name, topic in reader.topics.items()} == {
            name: TOPICS[name].kind for name in counts
        }
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
    must = {
        "/scan",
        "/odom",
        "/particle_cloud",
        "/plan",
        "/transformed_global_plan",
        "/goal_pose",
        "/behavior_tree_log",
    }
    assert must <= counts.keys()


def test_odometry_is_the_transform_of_its_time_and_moves_as_it_says(messages):
    transforms = {
        t_ns: {each.child_frame_id: each.transform.translation for each in m.transforms}["base_link"]
        for t_ns, m in of(messages, "/tf")
    }
    odometry = of(messages, "/odom")
    places = np.array([(m.pose.pose.position.x, m.pose.pose.position.y) for _, m in odometry])
    assert np.allclose(places, [(transforms[t_ns].x, transforms[t_ns].y) for t_ns, _ in odometry], rtol=0, atol=1e-12)
    steps_mps = np.hypot(*np.diff(places, axis=0).T) / 0.05
    told_mps = np.array([m.twist.twist.linear.x for _, m in odometry])[1:]  # over the step that ends here
    assert told_mps.max() > 0.2 and np.abs(steps_mps - told_mps).max() < 0.01


def test_estimates_have_the_covariance_that_was_recorded(messages, recorded):
    columns = recorded.recording.columns
    new = columns["localized"] == 1
    for place, name in ((0, "xx_mm2"), (1, "xy_mm2"), (6, "xy_mm2"), (7, "yy_mm2"), (35, "yaw_mrad2")):
        told = [m.pose.covariance[place] for _, m in of(messages, "/amcl_pose")]
        assert np.allclose(told, columns[f"covariance_{name}"][new] / 1e6, rtol=0, atol=1e-12), name
    assert columns["covariance_yaw_mrad2"].any()


def test_footprint_turns_with_the_robot(tmp_path):
    bag = RunBag()
    nothing, outline_m = np.empty((0, 2)), np.array([[0.5, 0.2], [-0.5, 0.2], [-0.5, -0.2], [0.5, -0.2]])
    moment = SimpleNamespace(t_s=0.0, goal=0, estimate=Pose(1.0, 2.0, np.pi / 2))
    costs = Patch(np.zeros((1, 1), dtype=np.uint8), Pose(0.0, 0.0), 0.05)
    paths = dict.fromkeys(("plan_xy_m", "ahead_xy_m", "intended_xy_m", "particles"), nothing)
    snapshot = SimpleNamespace(moment=moment, goals=(), outline_m=outline_m, local_costs=costs, **paths)
    told = SimpleNamespace(map_odom=Pose(0.0, 0.0), updates=-1)
    bag.seen(snapshot, told, has_local=True, has_global=False)
    for name, content in bag.files({"of": "a test"}).items():
        (tmp_path / name).write_bytes(content)
    ((_, message),) = of(read(tmp_path), "/local_costmap/published_footprint")
    points = [(each.x, each.y) for each in message.polygon.points]
    assert np.allclose(points, [(0.8, 2.5), (0.8, 1.5), (1.2, 1.5), (1.2, 2.5)])


def test_obstacle_that_disappears_is_deleted_from_the_view(tmp_path):
    box = Obstacle("box", Box(0.5, 0.4), Pose(1.0, 2.0, 0.3))
    places = np.array([(np.inf, np.inf), (1.0, 2.0), (np.inf, np.inf)])
    track = ObstacleTrack(box, np.array([-1, 1000, 2000]), places, np.array([0.0, 0.3, 0.0]))
    bag = RunBag()
    bag.surroundings([track], (), 5_000)
    for name, content in bag.files({"of": "a test"}).items():
        (tmp_path / name).write_bytes(content)
    told = of(read(tmp_path), "/ground_truth/obstacles")
    assert [(t_ns, [each.action for each in m.markers]) for t_ns, m in told] == [(10**9, [0]), (2 * 10**9, [2])]
    (marker,) = told[0][1].markers
    assert (marker.ns, marker.type, marker.scale.x, marker.scale.y) == ("box", 1, 0.5, 0.4)
    assert (marker.pose.position.x, yaw_of(marker.pose.orientation)) == pytest.approx((1.0, 0.3))


def test_costmaps_have_the_walls_at_their_places(messages):
    ((_, occupancy),) = of(messages, "/map")
    _, costs = of(messages, "/global_costmap/costmap")[-1]
    walls = np.array(occupancy.data) == 100
    assert (costs.info.width, costs.info.height) == (occupancy.info.width, occupancy.info.height)
    assert (np.array(costs.data)[walls] == 100).all()
    assert {0, 99, 100} <= set(np.unique(np.array(costs.data))) <= set(range(-1, 101))  # 99 is inscribed
    _, local = of(messages, "/local_costmap/costmap")[-1]
    assert local.header.frame_id == "odom"
    assert abs(yaw_of(local.info.origin.orientation)) < 1e-9  # its edges lie along those of odom


def test_bag_of_a_run_that_comes_out_otherwise_has_the_recorded_part_alone(recorded, tmp_path, monkeypatch):

    changed = dict(recorded.recording.columns)
    changed["x_mm"] = changed["x_mm"] + 1
    other = replace(recorded, recording=replace(recorded.recording, columns=changed))
    for name, content in bag_of(other).items():
        (tmp_path / name).write_bytes(content)
    told = read(tmp_path)
    topics = {topic for _, topic, _ in told}
    assert topics.isdisjoint({"/scan", "/odom", "/plan", "/local_costmap/costmap", "/particle_cloud"})
    assert {"/tf", "/map", "/cmd_vel", "/ground_truth/odom"} <= topics
    (words,) = [m.msg for _, topic, m in told if topic == "/rosout" and "only what was recorded" in m.msg]
    assert "executed here, the run differs: row 0 (0.00 s), x_mm" in words
    about = yaml.safe_load((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["custom_data"]
    assert about["executed_again"] == words


def test_bag_of_an_imported_run_has_no_truth_that_nothing_measured(recorded, tmp_path):
    from dataclasses import replace

    recording = recorded.recording
    kept = {k: v for k, v in recording.columns.items() if not k.startswith(("covariance_", "command_"))}
    imported = replace(recording, columns=kept, run=replace(recording.run, estimated_by="amcl"))
    for name, content in bag_of(replace(recorded, recording=imported)).items():
        (tmp_path / name).write_bytes(content)
    told = read(tmp_path)
    topics = {topic for _, topic, _ in told}
    assert topics.isdisjoint({"/ground_truth/odom", "/cmd_vel_nav"}) and {"/tf", "/cmd_vel", "/amcl_pose"} <= topics
    assert {each.child_frame_id for _, m in of(told, "/tf") for each in m.transforms} == {"odom", "base_link"}


def test_command_exports_one_run_with_a_layout_of_topics_that_exist(results, tmp_path):
    done = called("export", results, tmp_path / "out", "--format", "mcap", "--only", "room-1/1")
    assert done.exit_code == 0, done.output
    assert "1 runs: 0 passed, 1 failed" in done.output
    files = sorted(str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*") if file.is_file())
    assert files == ["foxglove.json", "room-1/1/rosbag2/metadata.yaml", "room-1/1/rosbag2/rosbag2.mcap"]
    layout = json.loads((tmp_path / "out/foxglove.json").read_text())
    panels = layout["configById"]
    named = {*panels["3D!nav"]["topics"]}
    for panel in panels.values():
        for path in panel.get("paths", []):
            named.add("/" + path["value"].removeprefix("/").partition(".")[0])
    assert named <= TOPICS.keys()

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def test_command_names_the_runs_that_there_are(results, tmp_path):
    assert refused("export", results, tmp_path / "out", "--only", "room-1/7").endswith(
        "no run of room-1 matches 'room-1/7'"
    )


@pytest.fixture
def published():
    """Messages of nodes: time (ns), topic, type, and bytes; the last one is of a type of their own."""
    store = typestore()
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 50_000_000), "map")
    none = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = types["geometry_msgs/msg/Twist"](types["geometry_msgs/msg/Vector3"](0.25, 0.0, 0.0), none)
    told = [
        (100_000_000, "/plan", types["nav_msgs/msg/Path"](header, [])),
        (50_000_000, "/cmd_vel", types["geometry_msgs/msg/TwistStamped"](header, twist)),
        (100_000_000, "/cmd_vel", types["geometry_msgs/msg/TwistStamped"](header, twist)),
        (50_000_000, "/my_speed", types["std_msgs/msg/Float64"](0.5)),
    ]
    kinds = [(*each, each[-1].__msgtype__) for each in told]
    messages = [(t_ns, topic, kind, bytes(store.serialize_cdr(each, kind))) for t_ns, topic, each, kind in kinds]
    return [*messages, (50_000_000, "/grip", "my_msgs/msg/Grip", b"\0\1\0\0\7")]


@pytest.fixture
def driven_bag(recorded, published, tmp_path):
    rows = [f'{t_ns},"{topic}","{kind}",{len(content)}\n' for t_ns, topic, kind, content in published]
    outputs = {
        "ros2/messages.csv": "".join(["t_ns,topic,type,bytes\n", *rows]).encode(),
        "ros2/messages.cdr": b"".join(content for *_, content in published),
    }
    scenario = replace(recorded.scenario, programs=ProcessSetup(nodes=Nodes()))
    for name, content in bag_of(replace(recorded, scenario=scenario), outputs=outputs).items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def test_bag_has_the_bytes_that_nodes_published_in_place_of_the_recordings_commands(driven_bag, published):
    known = sorted((t_ns, topic, content) for t_ns, topic, _, content in published if topic != "/grip")
    topics = {topic for _, topic, _ in known}
    with (driven_bag / "rosbag2.mcap").open("rb") as file:
        found = [(c.topic, s.name, m) for s, c, m in make_reader(file).iter_messages()]
    assert sorted((m.log_time, topic, m.data) for topic, _, m in found if topic in topics) == known
    assert {name for topic, name, _ in found if topic == "/cmd_vel"} == {"geometry_msgs/msg/TwistStamped"}
    with AnyReader([driven_bag]) as bag:
        chosen = [each for each in bag.connections if each.topic in topics]
        assert sorted((t_ns, c.topic, bytes(raw)) for c, t_ns, raw in bag.messages(chosen)) == known
    speeds = [message.twist.linear.x for _, message in of(read(driven_bag), "/cmd_vel")]
    assert speeds == [0.25, 0.25]


def test_bag_names_messages_without_definition_and_leaves_them_out(driven_bag):
    words = "no definition is known of /grip (my_msgs/msg/Grip)"
    told = yaml.safe_load((driven_bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert words in told["custom_data"]["executed_again"]
    assert "/grip" not in {each["topic_metadata"]["name"] for each in told["topics_with_message_count"]}
    assert words in [message.msg for _, message in of(read(driven_bag), "/rosout")]


def test_exported_twice_is_the_same(recorded):
    assert bag_of(recorded) == bag_of(recorded)


def test_export_names_missing_package(recorded, monkeypatch):
    import builtins

    real = builtins.__import__

    def without(name, *rest, **kwargs):
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *rest, **kwargs)

    typestore.cache_clear()
    monkeypatch.setattr(builtins, "__import__", without)
    try:
        with pytest.raises(Exception, match=r"^bags need the package rosbags: pip install 'vastflow\[ros\]'$"):
            RunBag()
    finally:
        typestore.cache_clear()


def test_bag_has_each_recovery_of_nav2(tmp_path):
    """Nav2 counts the clearing of both costmaps as two."""
    bag = RunBag()
    events = [Event(float(k), "recovery", 1.0, 1.0, what, 0.0) for k, what in enumerate(RECOVERIES)]
    bag.surroundings((), events, 10_000)
    for name, content in bag.files({"of": "a test"}).items():
        (tmp_path / name).write_bytes(content)
    changes = [
        (t_ns // 10**9, each) for t_ns, log in of(read(tmp_path), "/behavior_tree_log") for each in log.event_log
    ]
    assert [(t_s, each.node_name) for t_s, each in changes if each.current_status == "RUNNING"] == [
        (0, "ClearLocalCostmap-Context"),
        (1, "ClearGlobalCostmap-Context"),
        (2, "ClearLocalCostmap-Subtree"),
        (2, "ClearGlobalCostmap-Subtree"),
        (3, "Spin"),
        (4, "Wait"),
        (5, "BackUp"),
    ]
    uids = {each.node_name: each.uid for _, each in changes}
    assert len(set(uids.values())) == len(uids)
