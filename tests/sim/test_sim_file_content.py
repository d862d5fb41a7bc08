"""The digest of a Nav2 parameter file has all that the robot is read from, and nothing else."""

import pytest
from table import each_row

from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

INFO = (
    "costmap_filter_info_server: {ros__parameters: {filter_info_topic: info, type: 1, base: 100.0, multiplier: -1.0}}"
)
KEEPOUT = "filters: [k], k: {plugin: 'nav2_costmap_2d::KeepoutFilter', filter_info_topic: info}"
MASKED = f"global_costmap: {{global_costmap: {{ros__parameters: {{{KEEPOUT}}}}}}}\n{INFO}\n"
SIMPLE = "{plugin: 'nav2_controller::SimpleGoalChecker'}"
CHECKERS = f"goal_checker_plugins: [a, general_goal_checker], a: {SIMPLE}, general_goal_checker: {SIMPLE}"
TWO = f"controller_server: {{ros__parameters: {{{CHECKERS}}}}}\n"
STAMPED = "velocity_smoother: {ros__parameters: {enable_stamped_cmd_vel: true}}\n"
SECOND = INFO.replace("costmap_filter_info_server", "a_server").replace("type: 1", "type: 1, mask_topic: m")


@pytest.fixture
def files(tmp_path):
    """Write texts to files, and return the files' values."""

    def written(*texts):
        for k, text in enumerate(texts):
            (tmp_path / f"{k}.yaml").write_text(text)
        return [nav2_file(tmp_path / f"{k}.yaml") for k in range(len(texts))]

    return written


@each_row(
    ("base", "one", "other"),
    [
        (MASKED, "mask: {ros__parameters: {topic_name: filter_mask}}", "mask: {ros__parameters: {topic_name: mine}}"),
        (TWO, "bt_navigator: {ros__parameters: {a: 1}}", "bt_navigator: {ros__parameters: {max_linear_vel: 1}}"),
        (TWO, "bt_navigator: {ros__parameters: {a: b}}", "bt_navigator: {ros__parameters: {a: max_linear_vel}}"),
        (TWO, "bt_navigator: {ros__parameters: {default_nav_to_pose_bt_xml: mine.xml}}", ""),
        (STAMPED, "/**: {ros__parameters: {enable_stamped_cmd_vel: true}}", ""),
        (
            STAMPED,
            "/**: {ros__parameters: {enable_stamped_cmd_vel: true}}\n/*: {ros__parameters: {enable_stamped_cmd_vel: false}}",
            "/*: {ros__parameters: {enable_stamped_cmd_vel: false}}\n/**: {ros__parameters: {enable_stamped_cmd_vel: true}}",
        ),
    ],
)
def test_files_of_two_robots_have_two_digests(files, base, one, other):
    values = files(base + one, base + other)
    read = [interpretation(parse(base + text)).parameters for text in (one, other)]
    assert read[0] != read[1]
    assert values[0].digest != values[1].digest
    mask = dict.fromkeys(("keepout_mask",), values[0]) if base == MASKED else {}
    assert [parameters_of({"nav2_params": value, **mask}) for value in values] == read


@each_row(
    ("base", "one", "other"),
    [
        (STAMPED, "", "# a comment"),
        (STAMPED, "", "other: {ros__parameters: {rate: 3, topic_name_of: x}}"),
        (STAMPED, "map_server: {ros__parameters: {topic_name: map}}", ""),
        (TWO, "bt_navigator: {ros__parameters: {default_nav_to_pose_bt_xml: follow_point.xml}}", ""),
        (TWO, "bt_navigator: {ros__parameters: {odom_topic: a}}", "bt_navigator: {ros__parameters: {odom_topic: b}}"),
    ],
)
def test_files_of_one_robot_have_one_digest(files, base, one, other):
    values = files(base + one, base + other)
    read = [interpretation(parse(base + text)).parameters for text in (one, other)]
    assert read[0] == read[1]
    assert values[0].digest == values[1].digest


def test_order_of_info_servers_does_not_count(files):
    base = MASKED.replace(INFO, "") + "mask: {ros__parameters: {topic_name: m}}\n"
    texts = [base + "\n".join(servers) for servers in ([INFO, SECOND], [SECOND, INFO])]
    first, second = files(*texts)
    assert first.digest == second.digest
    assert interpretation(parse(texts[0])).parameters == interpretation(parse(texts[1])).parameters
