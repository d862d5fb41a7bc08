"""Wildcards in the names of nodes: whom they speak of, what counts of several values, and where mistakes in them are."""

import pytest
from table import each_row

from vastflow.sim.nav2.parameter_files.document import DocumentError, parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file, read_nav2_document, resolved
from vastflow.sim.nav2.parameters.dwb import DwbParameters

COSTMAPS = """
local_costmap: {local_costmap: {ros__parameters: {width: 4, height: 4, footprint_padding: 0.02}}}
global_costmap: {global_costmap: {ros__parameters: {footprint_padding: 0.02}}}
"""


def read(text):
    return interpretation(resolved(parse(text, "n.yaml")))


def radii(text):
    parameters = read(text).parameters
    return parameters.local_costmap.robot_radius, parameters.global_costmap.robot_radius


def alpha(text):
    return read(text).parameters.amcl.alpha1


def test_wildcard_gives_each_node_that_has_such_a_parameter_the_value_beside_its_own():
    found = read("/**: {ros__parameters: {robot_radius: 0.31}}" + COSTMAPS).parameters
    assert (found.local_costmap.robot_radius, found.global_costmap.robot_radius) == (0.31, 0.31)
    assert (found.local_costmap.width, found.local_costmap.footprint_padding) == (4, 0.02)


@each_row(
    ("text", "expected"),
    [
        ("/**: {ros__parameters: {alpha1: 0.5}}\namcl: {ros__parameters: {alpha1: 0.3}}", 0.3),
        ("amcl: {ros__parameters: {alpha1: 0.3}}\n/**: {ros__parameters: {alpha1: 0.5}}", 0.5),
        ("/**: {ros__parameters: {alpha1: 0.5}}\n/*: {ros__parameters: {alpha1: 0.4}}", 0.4),
    ],
)
def test_of_several_values_the_last_of_the_file_counts(text, expected):
    assert alpha(text) == expected


@each_row(
    ("name", "own", "stands"),
    [
        ("/**", "amcl", True),
        ("/**", "robot/amcl", True),
        ("/*", "amcl", True),
        ("/*", "robot/amcl", False),
        ("/*/amcl", "robot/amcl", True),
        ("/*/amcl", "amcl", True),
        ("/**/amcl", "amcl", True),
        ("/**/amcl", "a/b/amcl", True),
        ("/robot/**", "robot/amcl", True),
        ("/robot/**", "other/amcl", False),
        ("/robot/*", "robot/amcl", True),
        ("/**/planner_server", "amcl", False),
    ],
)
def test_one_star_stands_for_one_part_of_a_name_and_two_for_any_number(name, own, stands):
    text = f"/{own}: {{ros__parameters: {{alpha2: 0.3}}}}\n{name}: {{ros__parameters: {{alpha1: 0.5}}}}"
    assert alpha(text) == (0.5 if stands else 0.2)


def test_file_may_have_a_node_s_parameters_in_a_wildcard_alone():
    controller = "controller_plugins: [Own], Own: {plugin: 'dwb_core::DWBLocalPlanner', critics: [PathDist]}"
    found = read(f"/**: {{ros__parameters: {{{controller}}}}}\namcl: {{ros__parameters: {{}}}}")
    assert "controller_server" not in found.replaced
    assert isinstance(found.parameters.controller, DwbParameters)


def test_what_belongs_to_no_node_in_particular_starts_none():
    text = "/**: {ros__parameters: {use_sim_time: true}}\namcl: {ros__parameters: {alpha1: 0.3}}"
    found = read(text)
    assert "controller_server" in found.replaced
    assert {finding.path[-1]: finding.status for finding in findings(found)} == {
        "use_sim_time": "no effect",
        "alpha1": "modeled",
    }


def test_mistake_in_a_wildcard_has_its_line_and_column():
    text = COSTMAPS + "/**:\n  ros__parameters:\n    robot_radius: -1.0\n"
    with pytest.raises(DocumentError, match=r"n.yaml:6:19: .*robot_radius: found -1.0"):
        read(text)


def test_file_s_digest_is_that_of_what_it_means(tmp_path):
    one, other, third = (tmp_path / f"{name}.yaml" for name in ("one", "other", "third"))
    one.write_text("/**/amcl: {ros__parameters: {alpha1: 0.5}}")
    other.write_text("amcl: {ros__parameters: {alpha1: 0.5}}")
    third.write_text("/**/amcl: {ros__parameters: {alpha1: 0.6}}")
    assert read_nav2_document(one).values == read_nav2_document(other).values
    assert nav2_file(one).digest == nav2_file(other).digest != nav2_file(third).digest


def test_file_without_wildcards_stays_as_it_is():
    document = parse(COSTMAPS)
    assert resolved(document) is document
