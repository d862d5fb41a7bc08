"""Topics of a Nav2 parameter file that do not meet have the effect that they have in Nav2."""

from table import each_row

from vastflow.sim.nav2.parameter_files.chosen import parameters_of, unused_because
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER, command_chain
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

RPP = "{plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'}"
INFO = (
    "costmap_filter_info_server: {ros__parameters: {filter_info_topic: info, type: 1, base: 100.0, multiplier: -1.0}}"
)


def with_speed_filter(said, heard):
    own = f"s: {{plugin: 'nav2_costmap_2d::SpeedFilter', filter_info_topic: info{said}}}"
    server = f"controller_server: {{ros__parameters: {{controller_plugins: [A], A: {RPP}{heard}}}}}"
    return f"{server}\nglobal_costmap: {{global_costmap: {{ros__parameters: {{filters: [s], {own}}}}}}}\n{INFO}"


@each_row(
    ("said", "heard", "meet"),
    [
        ("", "", True),
        (", speed_limit_topic: /speed_limit", "", True),
        (", speed_limit_topic: zone", ", speed_limit_topic: /zone", True),
        (", speed_limit_topic: zone", "", False),
        (", speed_limit_topic: zone", ", speed_limit_topic: speed_limit", False),
        ("", ", speed_limit_topic: other", False),
    ],
)
def test_speed_limit_arrives_where_topics_meet(said, heard, meet):
    found = interpretation(parse(with_speed_filter(said, heard)))
    assert found.parameters.global_costmap.speed_filter.enabled == meet
    assert any("no limit arrives" in consequence for _, consequence in found.reader.warnings.values()) != meet
    statuses = {each.status for each in findings(found) if "s" in each.path and each.path[-1] != "speed_limit_topic"}
    assert statuses == ({"modeled"} if meet else {"no effect"})


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
    assert bool(found.reader.warnings) == bool(topics)


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
