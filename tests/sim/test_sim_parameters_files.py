"""Nav2 parameter files: their readings and faults, pinned in `golden/nav2_parameters.yaml`, and rules for all files."""

import ast
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

import vastflow.sim
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.nav2.parameter_files.built_in import BuiltIn, built_in
from vastflow.sim.nav2.parameter_files.chosen import check_key, parameters_of
from vastflow.sim.nav2.parameter_files.controller_server import critics_of
from vastflow.sim.nav2.parameter_files.document import dotted, parse, read_document
from vastflow.sim.nav2.parameter_files.findings import findings, left_out
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.parameter_files.nodes import (
    FILTERS,
    GOAL_CHECKERS,
    LAYERS,
    PATH_HANDLERS,
    PLANNERS,
    PROGRESS_CHECKERS,
)
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file, read_nav2_document, resolved
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.stack import NavParameters

SHIPPED = Path(__file__).parents[2] / "campaigns" / "nav2"


def read(text):
    return interpretation(resolved(parse(text, "nav2.yaml")))


def faults(text):
    with pytest.raises(FileError) as caught:
        read(text)
    return str(caught.value).splitlines()


def flat(group, place=""):
    """Names and values of the parameters of a group, and of critics the names of those that are enabled."""
    critics = critics_of(group) if place == "controller." else {}
    if critics:
        enabled = [name for name, critic in critics.items() if critic.enabled]
        yield f"{place}critics", sorted(enabled, key=lambda name: getattr(critics[name], "place", 0))
    for name, value in group:
        if isinstance(value, ParameterGroup):
            yield from flat(value, f"{place}{name}.")
        elif name not in ("enabled", "place") or "controller." not in place:
            yield f"{place}{name}", value


def reading(text):
    """Return lines of statuses, missing nodes, and values of a file that differ from a bare file's."""
    found = read(text)
    lines = []
    for each in findings(found):
        used = f", used {each.used!r}" if each.used not in (None, each.value) else ""
        lines.append(f"{dotted(each.path)}: {each.status}{used}{f', {each.why}' if each.why else ''}")
    lines.append(
        f"as in Jazzy: {', '.join(found.replaced)}; as in Nav2's code: {', '.join(found.absent)}; without: {', '.join(found.left_away)}"
    )
    controller, planner = type(found.parameters.controller)(), type(found.parameters.planner)()
    lines.append(f"{type(controller).__name__}, {type(planner).__name__}")
    bare = read("amcl: {ros__parameters: }").parameters.with_values(controller=controller, planner=planner)
    usual = dict(flat(bare))
    return lines + [f"{name} = {value!r}" for name, value in flat(found.parameters) if value != usual[name]]


def test_parameter_files_set_pinned_values(golden):
    golden("nav2_parameters", "readings", reading, key="reading")


def test_parameter_files_have_the_pinned_faults(golden):
    golden("nav2_parameters", "file", faults)


def test_system_keys_have_pinned_faults(golden):
    def faults_of(text):
        system = yaml.safe_load(text)
        *others, (key, value) = system.items()
        with pytest.raises(FileError) as caught:
            parameters_of(system)
        if not {"nav2_params", "robot.drive"} & system.keys():  # the others depend on further keys
            with pytest.raises(FileError) as alone:
                check_key(dict(others), key, value)
            assert set(alone.value.faults) == set(caught.value.faults)
        return str(caught.value).splitlines()

    golden("nav2_parameters", "keys", faults_of)


@each_row(
    ("name", "expected"),
    [("jazzy_mppi.yaml", NavParameters()), ("rpp.yaml", NavParameters(controller=RppParameters()))],
)
def test_shipped_file_sets_the_default_stack(name, expected):
    assert interpretation(read_document(SHIPPED / name)).parameters == expected


def test_shipped_dwb_file_sets_a_turtlebot_4_under_humble():
    found = interpretation(read_document(SHIPPED / "dwb.yaml")).parameters
    assert found.controller == DwbParameters()
    assert (found.global_costmap.robot_radius, found.local_costmap.inflation_layer.inflation_radius) == (0.175, 0.45)
    assert (found.local_costmap.static_layer.enabled, found.collision_monitor.enabled) == (True, False)
    assert found.velocity_smoother.max_velocity == (0.26, 0.0, 1.0)


@each_row("name", ["jazzy_mppi.yaml", "dwb.yaml", "rpp.yaml"])
def test_shipped_files_have_no_unmodeled_parameters(name):
    others = {dotted(each.path): each.status for each in findings(interpretation(read_document(SHIPPED / name)))}
    assert {path: status for path, status in others.items() if status in ("differs", "not modeled")} == {}


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(["jazzy_mppi.yaml", "dwb.yaml", "rpp.yaml"]), st.data())
def test_damaged_file_is_read_or_has_faults_with_places(name, data):
    lines = (SHIPPED / name).read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(lines) - 1))
        accident = data.draw(st.sampled_from(["lose", "double", "indent", "cut", "put"]))
        if accident == "lose":
            del lines[at]
        elif accident == "double":
            lines.insert(at, lines[at])
        elif accident == "indent":
            lines[at] = "  " + lines[at]
        elif accident == "cut":
            lines[at] = lines[at][: data.draw(st.integers(0, 40))]
        else:
            value = data.draw(st.sampled_from(["x", "-1", "[1, x]", "{a: 1}", "", ".inf", "true", "*a"]))
            lines[at] = f"{lines[at].partition(':')[0]}: {value}"
    try:
        found = read("\n".join(lines))
    except FileError as error:
        assert all(fault.place.line > 0 for fault in error.faults)
    else:
        assert len(findings(found)) > 100


def test_left_out_parameters_have_the_values_of_nav2s_code():
    found = {path[2]: value for path, value in left_out(read("amcl: {ros__parameters: {pf_err: 0.1}}")).items()}
    assert "pf_err" not in found
    assert found["pf_z"] == 0.99


def test_modeled_parameters_are_not_built_in():
    modeled = {path[-1] for path in interpretation(document_of(NavParameters())).reader.fields}
    tabled = {name for kind in ("amcl", "scan", "NavfnPlanner", "velocity_smoother") for name in built_in()[kind]}
    assert modeled & tabled == set()


def test_modeled_parameters_are_read_by_the_simulator():
    package = Path(vastflow.sim.__file__).parent
    read_names: set[str] = set()
    for file in package.rglob("*.py"):
        if {"parameters", "parameter_files"}.isdisjoint(file.parts):
            read_names |= {
                each.attr for each in ast.walk(ast.parse(file.read_text())) if isinstance(each, ast.Attribute)
            }
    groups = [ParameterGroup]
    for group in groups:
        groups += group.__subclasses__()
    nav2 = [group for group in groups if group.__module__.startswith("vastflow.sim.nav2.parameters.")]
    assert len(nav2) > 30
    assert {name for group in nav2 for name in group.model_fields} <= read_names


@each_row(
    ("text", "status", "why"),
    [
        ("source_timeout: 1.0", "no effect", "no scan of a lidar of 2 Hz or more is that old"),
        ("source_timeout: 0.0", "no effect", "no scan of a lidar of 2 Hz or more is that old"),
        ("source_timeout: 0.2", "differs", ""),
        ("s.source_timeout: 0.2", "differs", ""),
    ],
)
def test_age_that_no_scan_has_has_no_effect(text, status, why):
    area = "polygons: [p], p: {type: polygon, action_type: approach}, observation_sources: [s], s.type: scan"
    rows = findings(read(f"collision_monitor: {{ros__parameters: {{{area}, {text}}}}}"))
    assert [(row.status, row.why) for row in rows if row.path[-1] == "source_timeout"] == [(status, why)]


@each_row(("value", "status"), [("true", "differs"), ("false", "built in")])
def test_unknown_space_is_free_in_the_local_costmap(value, status):
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{track_unknown_space: {value}}}}}}}"
    assert [row.status for row in findings(read(text))] == [status]


@each_row(
    ("rule", "agreeing", "other", "value"),
    [
        (BuiltIn((20.0, 1.0)), 20, 10.0, 20.0),
        (BuiltIn((True,)), True, 1, True),
        (BuiltIn((1,)), 1.0, True, 1),
        (BuiltIn(((0.0, 0.0),)), [0.0, 0], [0.0], [0.0, 0.0]),
        (BuiltIn(("a::B",)), "a/B", "c::B", "a::B"),
        (BuiltIn(low=0.2), 2.0, 0.1, "0.2 or more"),
        (BuiltIn((0.0,), low=0.2), 0, 0.1, "0.2 or more"),
        (BuiltIn(high=0.2), 0, "low", "0.2 or less"),
        (BuiltIn(includes=("a", "b")), ["b", "c", "a"], ["a"], ["a", "b"]),
    ],
)
def test_built_in_rule_compares_values_and_is_named(rule, agreeing, other, value):
    assert rule.agrees(agreeing)
    assert not rule.agrees(other)
    assert rule.value == value


@each_row("plugins", [PLANNERS, PROGRESS_CHECKERS, GOAL_CHECKERS, PATH_HANDLERS, LAYERS, FILTERS])
def test_docs_list_the_modeled_classes(plugins):
    page = (Path(__file__).parents[2] / "docs" / "use-your-nav2-parameters.md").read_text()
    (row,) = (line for line in page.splitlines() if line.strip().startswith(f"| {plugins.what} "))
    assert re.findall(r"`(\w+::\w+)`", row) == list(plugins.modeled)


@each_row(
    ("name", "own", "stands"),
    [
        ("/**", "amcl", True),
        ("/*", "amcl", True),
        ("/*", "robot/amcl", False),
        ("/*/amcl", "robot/amcl", True),
        ("/*/amcl", "amcl", True),
        ("/**/amcl", "a/b/amcl", True),
        ("/robot/**", "robot/amcl", True),
        ("/robot/*", "robot/amcl", True),
        ("/**/planner_server", "amcl", False),
    ],
)
def test_wildcard_matches_one_name_or_any_number_of_names(name, own, stands):
    text = f"/{own}: {{ros__parameters: {{alpha2: 0.3}}}}\n{name}: {{ros__parameters: {{alpha1: 0.5}}}}"
    assert read(text).parameters.amcl.alpha1 == (0.5 if stands else 0.2)


def test_file_digest_depends_on_resolved_wildcards(tmp_path):
    one, other, third = (tmp_path / f"{name}.yaml" for name in ("one", "other", "third"))
    one.write_text("/**/amcl: {ros__parameters: {alpha1: 0.5}}")
    other.write_text("amcl: {ros__parameters: {alpha1: 0.5}}")
    third.write_text("/**/amcl: {ros__parameters: {alpha1: 0.6}}")
    assert read_nav2_document(one).values == read_nav2_document(other).values
    assert nav2_file(one).digest == nav2_file(other).digest != nav2_file(third).digest
    assert resolved(document := read_document(other)) is document
