"""Valid Nav2 parameter files of other releases and forms: launch words, filters among the layers, special values."""

import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings, refusals
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

INFLATION = "inflation_layer: {plugin: 'nav2_costmap_2d::InflationLayer'}"
KEEPOUT = "plugin: 'nav2_costmap_2d::KeepoutFilter', filter_info_topic: info"


def costmap(text):
    return f"global_costmap: {{global_costmap: {{ros__parameters: {{{text}}}}}}}"


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def test_launch_word_is_on_where_the_campaign_names_a_mask(tmp_path):
    file = tmp_path / "nav2.yaml"
    own = f"filters: [k], k: {{{KEEPOUT}, enabled: KEEPOUT_ZONE_ENABLED, override_lethal_cost: true}}"
    file.write_text(costmap(own))
    content = nav2_file(file)
    assert not parameters_of({"nav2_params": content}).global_costmap.keepout_filter.enabled
    assert parameters_of({"nav2_params": content, "keepout_mask": content}).global_costmap.keepout_filter.enabled
    statuses = {each.path[-1]: each.status for each in findings(read(costmap(own)))}
    assert (statuses["enabled"], statuses["override_lethal_cost"]) == ("modeled", "no effect")


def test_lethal_override_of_a_filter_that_is_on_differs():
    found = read(costmap(f"filters: [k], k: {{{KEEPOUT}, override_lethal_cost: true}}"))
    assert [each.path[-1] for each in findings(found) if each.status == "differs"] == ["override_lethal_cost"]


def test_filter_in_the_list_of_layers_is_read():
    found = read(costmap(f"plugins: [inflation_layer, k], {INFLATION}, k: {{{KEEPOUT}}}")).parameters.global_costmap
    assert (found.keepout_filter.enabled, found.inflation_layer.enabled, found.static_layer.enabled) == (
        True,
        True,
        False,
    )


def test_keepout_filter_before_the_inflation_is_refused():
    with pytest.raises(FileError, match="k comes before the inflation: Nav2 inflates its mask"):
        read(costmap(f"plugins: [k, inflation_layer], {INFLATION}, k: {{{KEEPOUT}}}"))


@each_row(
    ("text", "group", "name", "value"),
    [
        ("failure_tolerance: -1.0", "controller_server", "failure_tolerance", 1e6),
        ("failure_tolerance: 0.0", "controller_server", "failure_tolerance", 0.0),
        ("general_goal_checker: {xy_goal_tolerance: 0.0}", "goal_checker", "xy_goal_tolerance", 0.0),
        ("general_goal_checker: {yaw_goal_tolerance: 10.0}", "goal_checker", "yaw_goal_tolerance", 10.0),
        ("progress_checker: {movement_time_allowance: 0.0}", "progress_checker", "movement_time_allowance", 0.0),
    ],
)
def test_special_values_are_read(text, group, name, value):
    lists = "goal_checker_plugins: [general_goal_checker]"
    text = text.replace(
        "general_goal_checker: {", "general_goal_checker: {plugin: 'nav2_controller::SimpleGoalChecker', "
    )
    lists = f"{lists}, " if "general" in text else ""
    found = read(f"controller_server: {{ros__parameters: {{{lists}{text}}}}}").parameters
    assert getattr(getattr(found, group), name) == value


def test_tolerances_below_zero_stay_refused_otherwise():
    with pytest.raises(FileError, match=r"failure_tolerance: expected a number in \[0, 1e\+06\], got -2.0"):
        read("controller_server: {ros__parameters: {failure_tolerance: -2.0}}")


def test_launch_word_does_not_end_a_node():
    assert [*refusals(read(costmap(f"filters: [k], k: {{{KEEPOUT}, enabled: KEEPOUT_ZONE_ENABLED}}")))] == []
    assert len([*refusals(read(costmap("always_send_full_costmap: 'yes'")))]) == 1
