"""What Nav2 parameter files set the collision monitor to."""

import pytest
from table import each_row

from vastflow.sim.nav2.parameter_files.document import DocumentError, parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameters.servers import CollisionMonitor


def monitor(text):
    """The monitor of a document with these parameters, in flow style."""
    document = parse(f"collision_monitor: {{ros__parameters: {{{text}}}}}", "nav2.yaml")
    return interpretation(document).parameters.collision_monitor


APPROACH = "polygons: [p], p: {type: polygon, action_type: approach, min_points: 5}, observation_sources: [s]"


def test_monitors_approach_polygon_is_read_with_the_nodes_timeout():
    assert monitor(f"{APPROACH}, source_timeout: 3.0") == CollisionMonitor(
        time_before_collision=2.0, min_points=5, source_timeout=3.0
    )
    assert monitor(f"{APPROACH}, source_timeout: 3.0, s: {{source_timeout: 0.5}}").source_timeout == 0.5


@each_row(
    "text",
    [
        "polygons: []",
        APPROACH.replace("approach", "stop"),
        APPROACH.replace("type: polygon", "type: circle"),
        APPROACH.replace("min_points: 5", "enabled: false"),
        f"{APPROACH}, s: {{enabled: false}}",
        f"{APPROACH}, s: {{type: pointcloud}}",
        APPROACH.replace("[s]", "[]"),
    ],
)
def test_monitor_without_a_footprint_that_approaches_or_without_a_scan_does_nothing(text):
    assert not monitor(text).enabled


def test_what_of_a_monitor_does_not_count_is_said_to_have_no_effect():
    text = (
        f"{APPROACH}, source_timeout: 3.0, s: {{source_timeout: 0.5}}, q: {{type: velocity_polygon, action_type: stop}}"
    )
    found = findings(interpretation(parse(f"collision_monitor: {{ros__parameters: {{{text}}}}}")))
    assert {(each.path[2], each.why) for each in found if each.status == "no effect"} == {
        ("source_timeout", "s has its own"),
        ("q", "no list of plug-ins has it"),
    }


def test_flag_of_the_monitor_that_is_a_number_is_a_fault_at_its_place():
    text = APPROACH.replace("min_points: 5", "enabled: 3")
    with pytest.raises(
        DocumentError, match=r"collision_monitor\.ros__parameters\.p\.enabled: expected true or f, got 3"
    ):
        monitor(text)


SCANNED = "observation_sources: [s], s: {type: scan}"


def test_areas_of_the_monitor_are_read_with_their_actions():
    found = monitor(
        f"""polygons: [halt, slow, near], {SCANNED},
        halt: {{type: circle, action_type: stop, radius: 0.3, max_points: 3}},
        slow: {{type: polygon, action_type: slowdown, points: [0.8, 0.4, 0.8, -0.4, 0.0, -0.4], slowdown_ratio: 0.3}},
        near: {{type: polygon, action_type: limit, points: "[[1.0, 0.4], [1.0, -0.4], [0.3, 0.0]]", linear_limit: 0.2}}"""
    )
    assert not found.enabled
    halt, slow, near = found.zones
    assert (halt.action, halt.radius, halt.vertices, halt.min_points) == ("stop", 0.3, (), 4)
    assert (slow.action, slow.vertices, slow.slowdown_ratio) == (
        "slowdown",
        ((0.8, 0.4), (0.8, -0.4), (0.0, -0.4)),
        0.3,
    )
    assert (near.action, near.vertices[2], near.linear_limit, near.angular_limit) == ("limit", (0.3, 0.0), 0.2, 0.5)


def test_area_that_is_not_enabled_or_does_nothing_is_none():
    text = "{{type: circle, radius: 0.3, {}}}"
    off, none = text.format("action_type: stop, enabled: false"), text.format("action_type: none")
    assert monitor(f"polygons: [quiet, idle], {SCANNED}, quiet: {off}, idle: {none}").zones == ()


@each_row(
    ("area", "message"),
    [
        ("{type: circle, radius: 0.3}", "no 'action_type' or 'type' below 'a'; both of them"),
        (
            "{type: circle, radius: 0.3, action_type: halt}",
            "expected one of stop, slowdown, limit, approach, none, got 'halt'",
        ),
        ("{type: polygon, action_type: stop, points: [0.1, 0.2, 0.3]}", "with the x, y of three or more vertices"),
        (
            "{type: circle, radius: 0.3, action_type: slowdown, slowdown_ratio: 2.0}",
            r"slowdown_ratio must lie in \[0, 1\]",
        ),
        (
            "{type: circle, radius: 0.3, action_type: stop, max_points: -1}",
            "max_points must be a whole number, 0 or more",
        ),
    ],
)
def test_area_that_nav2_would_not_start_with_is_a_fault(area, message):
    with pytest.raises(DocumentError, match=message):
        monitor(f"polygons: [a], {SCANNED}, a: {area}")
