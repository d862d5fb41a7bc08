"""Topics of a Nav2 parameter file that do not meet have the effect that they have in Nav2."""

import pytest
from scipy.spatial.transform import Rotation
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of, unused_because
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER, command_chain, filter_chains
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameters.costmap import NEVER_HZ
from vastflow.sim.scenario.tree.messages import pose_in

RPP = "{plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'}"
INFO = (
    "costmap_filter_info_server: {ros__parameters: {filter_info_topic: info, type: 1, base: 100.0, multiplier: -1.0}}"
)


def with_speed_filter(said, heard):
    own = f"s: {{plugin: 'nav2_costmap_2d::SpeedFilter', filter_info_topic: info{said}}}"
    server = f"controller_server: {{ros__parameters: {{controller_plugins: [A], A: {RPP}{heard}}}}}"
    return f"{server}\nglobal_costmap: {{global_costmap: {{ros__parameters: {{filters: [s], {own}}}}}}}\n{INFO}"


@each_row(
    ("said", "heard", "meet", "limit"),
    [
        ("", "", True, "(speed_limit)"),
        (", speed_limit_topic: /speed_limit", "", True, "(speed_limit)"),
        (", speed_limit_topic: zone", ", speed_limit_topic: /zone", True, "(zone)"),
        (", speed_limit_topic: zone", "", False, "(zone) ✗ (speed_limit)"),
        (
            ", speed_limit_topic: /zones/speed_limit",
            ", speed_limit_topic: /speed_limit",
            False,
            "(zones/speed_limit) ✗ (speed_limit)",
        ),
        (", speed_limit_topic: /robot/speed_limit", "", True, "(robot/speed_limit)"),
        (", speed_limit_topic: zone", ", speed_limit_topic: speed_limit", False, "(zone) ✗ (speed_limit)"),
        ("", ", speed_limit_topic: other", False, "(speed_limit) ✗ (other)"),
    ],
)
def test_speed_limit_arrives_where_topics_meet(said, heard, meet, limit):
    found = interpretation(parse(with_speed_filter(said, heard)))
    assert found.parameters.global_costmap.speed_filter.enabled == meet
    assert [*filter_chains(found.reader)] == [f"mask → (info) → global_costmap/s → {limit} → controller"]
    assert any("no limit arrives" in consequence for _, consequence in found.reader.warnings.values()) != meet
    statuses = {each.status for each in findings(found) if "s" in each.path and each.path[-1] != "speed_limit_topic"}
    assert statuses == ({"modeled"} if meet else {"no effect"})


def of_topics(found):
    """Warnings, but for those of what the texts here leave out and of the controller's name."""
    others = ("rolling_window", "regenerate_noises", "controller_plugins")
    return [said for path, said in found.reader.warnings.items() if path[-1] not in others]


INFO_TOPIC = "filter_info_topic: info"
MASK = "filter_mask_server: {ros__parameters: {topic_name: /mask}}"


@each_row(
    ("kind", "info", "gap"),
    [
        ("Keepout", "{filter_info_topic: /info}", ""),
        ("Keepout", "{filter_info_topic: other}", "listens on info, and costmap_filter_info_server publishes on other"),
        ("Keepout", "{filter_info_topic: info, mask_topic: mask}", ""),
        (
            "Keepout",
            "{filter_info_topic: info, mask_topic: zones}",
            "names the mask zones, and filter_mask_server publishes on mask",
        ),
        ("Speed", "{filter_info_topic: info, type: 1, mask_topic: /mask}", ""),
        (
            "Speed",
            "{filter_info_topic: other, type: 1}",
            "listens on info, and costmap_filter_info_server publishes on other",
        ),
        ("Speed", "{filter_info_topic: info}", "has type 0, and a speed filter takes 1 or 2"),
        (
            "Speed",
            "{filter_info_topic: info, type: 2, mask_topic: zones}",
            "names the mask zones, and filter_mask_server publishes on mask",
        ),
    ],
)
def test_filter_whose_topics_do_not_meet_has_no_effect(kind, info, gap):
    own = f"f: {{plugin: 'nav2_costmap_2d::{kind}Filter', {INFO_TOPIC}}}"
    server = f"costmap_filter_info_server: {{ros__parameters: {info}}}"
    mask = MASK if "mask_topic" in info else ""
    text = f"global_costmap: {{global_costmap: {{ros__parameters: {{filters: [f], {own}}}}}}}\n{server}\n{mask}"
    found = interpretation(
        parse(f"controller_server: {{ros__parameters: {{controller_plugins: [A], A: {RPP}}}}}\n{text}")
    )
    assert getattr(found.parameters.global_costmap, f"{kind.lower()}_filter").enabled == (not gap)
    assert [gap in what for what, _ in of_topics(found)] == [True] * bool(gap)
    (chain,) = filter_chains(found.reader)
    assert ("✗" in chain, chain.startswith("mask → (info)"), gap in chain) == (bool(gap), True, True)


def test_filter_beside_the_info_server_of_another_one_keeps_its_mask():
    own = "k: {plugin: 'nav2_costmap_2d::KeepoutFilter', filter_info_topic: elsewhere}"
    text = with_speed_filter("", "").replace("filters: [s]", f"filters: [s, k], {own}")
    assert interpretation(parse(text)).parameters.global_costmap.keepout_filter.enabled


def test_mask_of_an_unheard_speed_filter_has_a_reason(tmp_path):
    (tmp_path / "nav2.yaml").write_text(with_speed_filter(", speed_limit_topic: zone", ""))
    content = nav2_file(tmp_path / "nav2.yaml")
    assert "publishes on zone" in unused_because({"nav2_params": content, "speed_mask": content}, "speed_mask")
    assert not parameters_of({"nav2_params": content}).global_costmap.speed_filter.enabled


MONITOR = "collision_monitor: {ros__parameters: {polygons: [], observation_sources: []TOPICS}}"


@each_row(
    ("topics", "greatest_mps", "chain"),
    [
        ("", 0.5, "controller → velocity_smoother → (cmd_vel_smoothed) → collision_monitor → (cmd_vel) → base"),
        (
            ", cmd_vel_in_topic: /robot/cmd_vel_smoothed, cmd_vel_out_topic: base",
            0.5,
            "controller → velocity_smoother → (cmd_vel_smoothed) → collision_monitor → (base) → base",
        ),
        (
            ", cmd_vel_in_topic: cmd_vel_raw",
            0.0,
            "controller → velocity_smoother → (cmd_vel_smoothed) ✗ (cmd_vel_raw) → collision_monitor → (cmd_vel) → base",
        ),
        (
            ", cmd_vel_in_topic: cmd_vel_nav",
            NO_SMOOTHER.max_velocity[0],
            "controller → (cmd_vel_nav) → collision_monitor → (cmd_vel) → base",
        ),
    ],
)
def test_commands_pass_where_the_monitors_topics_meet(topics, greatest_mps, chain):
    found = interpretation(parse(MONITOR.replace("TOPICS", topics)))
    assert command_chain(found.document, found.left_away) == chain
    assert found.parameters.velocity_smoother.max_velocity[0] == greatest_mps
    assert bool(of_topics(found)) == bool(topics)


def test_chain_without_a_monitor_ends_at_the_smoother():
    assert (
        command_chain(parse("amcl: {ros__parameters: }"), ("collision_monitor",))
        == "controller → velocity_smoother → base"
    )


STAMPED = "enable_stamped_cmd_vel: true"


@each_row(
    ("controller", "smoother", "monitor", "more", "stands"),
    [
        ("", "", "", "", False),
        (STAMPED, STAMPED, STAMPED, "", False),
        (STAMPED, "", "", "", True),
        ("", STAMPED, "", "", True),
        (STAMPED, STAMPED, "", "", True),
        (STAMPED, "", "", f"/**: {{ros__parameters: {{{STAMPED}}}}}\n", False),
        # Since Kilted it is true where it is left out.
        (STAMPED, "", "", "amcl: {ros__parameters: {service_introspection_mode: x}}\n", False),
    ],
)
def test_robot_stands_where_commands_have_two_types(controller, smoother, monitor, more, stands):
    nodes = {"controller_server": controller, "velocity_smoother": smoother}
    text = "\n".join(f"{name}: {{ros__parameters: {{{own}}}}}" for name, own in nodes.items())
    found = interpretation(parse(f"{more}{text}\n{MONITOR.replace('TOPICS', f', {monitor}' if monitor else '')}"))
    assert (found.parameters.velocity_smoother.max_velocity[0] == 0.0) == stands
    assert ("✗" in command_chain(found.document, found.left_away)) == stands
    assert any("another type" in what for what, _ in found.reader.warnings.values()) == stands


AREA = "polygons: [P], P: {type: polygon, action_type: approach, min_points: 6MORE}, observation_sources: [scan], scan: {type: scan}"
CIRCLE = "{type: circle, action_type: slowdown, radius: 0.5, min_points: 6}"


@each_row(
    ("node", "own", "is_on", "is_published", "gap"),
    [
        # nav2_costmap_2d publishes on published_footprint (1.3.12, costmap_2d_ros.cpp), and the monitor leaves out an area without a shape (collision_monitor_node.cpp:589).
        ("collision_monitor", ", footprint_topic: /local_costmap/published_footprint", True, True, ""),
        ("collision_monitor", ", footprint_topic: /robot/local_costmap/published_footprint", True, True, ""),
        ("collision_monitor", ", footprint_topic: global_costmap/published_footprint", True, True, ""),
        ("collision_monitor", ", footprint_topic: /local_costmap/footprint", False, True, "local_costmap/footprint"),
        ("collision_monitor", ", footprint_topic: published_footprint", False, True, "published_footprint"),
        # A behavior without a costmap or a footprint takes each pose for a collision (costmap_topic_collision_checker.cpp:55-76).
        ("behavior_server", "local_costmap_topic: /local_costmap/costmap_raw", True, True, ""),
        ("behavior_server", "local_costmap_topic: local_costmap/costmap", True, False, "local_costmap/costmap"),
        ("behavior_server", "local_footprint_topic: local_costmap/footprint", True, False, "local_costmap/footprint"),
        ("behavior_server", "global_costmap_topic: elsewhere", True, True, ""),
    ],
)
def test_listener_that_hears_nothing_has_the_effect_that_nav2_has(node, own, is_on, is_published, gap):
    nodes = {"collision_monitor": AREA.replace("MORE", ""), "local_costmap: {local_costmap": "rolling_window: true"}
    nodes[node] = AREA.replace("MORE", own) if node == "collision_monitor" else own
    text = "\n".join(f"{each}: {{ros__parameters: {{{text}}}}}{'}' * ('{' in each)}" for each, text in nodes.items())
    found = interpretation(parse(text))
    assert found.parameters.collision_monitor.enabled == is_on
    assert (found.parameters.local_costmap.publish_frequency != NEVER_HZ) == is_published
    assert [what for what, _ in of_topics(found)] == [f"nothing publishes on {gap}"] * bool(gap)


@each_row(
    ("sources", "own", "least"),
    [
        ("[scan]", "", 6),
        ("[scan, scan]", ", sources_names: [scan]", 3),  # two sources of a name fill one list of points
        ("[scan, scan]", "", 2),  # which each of the area's two names counts (nav2_collision_monitor, polygon.cpp:237)
        ("[scan, cloud]", ", sources_names: [cloud]", None),
        ("[scan, cloud]", ", sources_names: [scan, cloud]", 6),
    ],
)
def test_area_counts_a_point_as_often_as_its_sources_are_named(sources, own, least):
    area = AREA.replace("MORE", own).replace("observation_sources: [scan]", f"observation_sources: {sources}")
    zones = f"polygons: [Z, Z], Z: {CIRCLE[:-1]}{own}}}, observation_sources: {sources}, cloud: {{type: pointcloud}}"
    first, second = (
        interpretation(parse(f"collision_monitor: {{ros__parameters: {{{text}}}}}")) for text in (area, zones)
    )
    monitor = first.parameters.collision_monitor
    assert (monitor.min_points if monitor.enabled else None) == least
    assert [zone.min_points for zone in second.parameters.collision_monitor.zones] == [least] * (least is not None)
    assert [what for what, _ in of_topics(first)] == ["'scan' is none of its sources"] * (least is None)
    assert not any("only one source" in why for path, why in first.reader.unmodeled.items() if path[-1] == "scan")


@each_row(
    ("own", "words"),
    [
        ("polygons: [P], P: {type: polygon, action_type: approach, sources_names: [x]}", "'x' is not in"),
        ("polygons: [Z], Z: {type: circle, radius: 0.5, action_type: stop, sources_names: [x]}", "'x' is not in"),
    ],
)
def test_area_with_a_source_that_the_node_has_not_is_refused(own, words):
    with pytest.raises(FileError, match=words):
        interpretation(parse(f"collision_monitor: {{ros__parameters: {{{own}, observation_sources: [scan]}}}}"))


def test_areas_see_nothing_where_their_only_source_is_off():
    own = f"polygons: [Z], Z: {CIRCLE}, observation_sources: [scan], scan: {{enabled: false}}"
    found = interpretation(parse(f"collision_monitor: {{ros__parameters: {{{own}}}}}"))
    assert found.parameters.collision_monitor.zones == ()


def test_filter_listed_twice_counts_once():
    own = "k: {plugin: 'nav2_costmap_2d::KeepoutFilter', filter_info_topic: /info}"
    text = f"global_costmap: {{global_costmap: {{ros__parameters: {{filters: [k, k], {own}}}}}}}"
    assert interpretation(parse(text)).parameters.global_costmap.keepout_filter.enabled


def test_pose_of_message_has_yaw_of_its_quaternion():
    turned = dict(zip("xyzw", Rotation.from_euler("ZYX", [0.7, 0.2, -0.1]).as_quat().tolist(), strict=True))
    pose = pose_in({"pose": {"pose": {"position": {"x": 1.0, "y": 2.0}, "orientation": turned}}})
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((1.0, 2.0, 0.7), abs=1e-12)
