"""Topics of a Nav2 parameter file that do not meet have the effect that they have in Nav2."""

from table import each_row

from vastflow.sim.nav2.parameter_files.chosen import parameters_of, unused_because
from vastflow.sim.nav2.parameter_files.command_chain import NO_SMOOTHER, command_chain, filter_chains
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
    ("said", "heard", "meet", "limit"),
    [
        ("", "", True, "(speed_limit)"),
        (", speed_limit_topic: /speed_limit", "", True, "(speed_limit)"),
        (", speed_limit_topic: zone", ", speed_limit_topic: /zone", True, "(zone)"),
        (", speed_limit_topic: zone", "", False, "(zone) ✗ (speed_limit)"),
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
