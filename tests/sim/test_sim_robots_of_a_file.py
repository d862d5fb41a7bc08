"""A Nav2 parameter file of several robots: which one drives, and that the order of the robots counts."""

import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file, resolved
from vastflow.sim.nav2.parameter_files.robots import of_robot


def robot(namespace, radius_m):
    node = f"{namespace}/local_costmap/local_costmap".strip("/")
    return f"{node}: {{ros__parameters: {{rolling_window: true, robot_radius: {radius_m}}}}}"


SMALL, LARGE = robot("robot1", 0.22), robot("robot2", 0.35)


@pytest.fixture
def file_of(tmp_path):
    def write(name, *parts):
        (tmp_path / name).write_text("\n".join(parts))
        return nav2_file(tmp_path / name)

    return write


def radius(content, **system):
    return parameters_of({"nav2_params": content, **system}).local_costmap.robot_radius


def test_order_of_robots_is_in_the_digest(file_of):
    one, other = file_of("one.yaml", SMALL, LARGE), file_of("other.yaml", LARGE, SMALL)
    assert one != other
    assert (radius(one), radius(other)) == (0.22, 0.35)


def test_order_of_nodes_of_one_robot_is_in_no_digest(file_of):
    amcl = "robot1/amcl: {ros__parameters: {alpha1: 0.3}}"
    assert file_of("one.yaml", amcl, SMALL) == file_of("other.yaml", SMALL, amcl)


@each_row(
    ("parts", "namespace", "radius_m"),
    [
        ((SMALL, LARGE), None, 0.22),
        ((SMALL, LARGE), "robot2", 0.35),
        ((LARGE, SMALL), "/robot1/", 0.22),
        ((SMALL, robot("", 0.3)), None, 0.3),
        ((SMALL, robot("", 0.3)), "robot1", 0.22),
        ((robot("", 0.3), SMALL), "", 0.3),
        ((robot("fleet/a", 0.3), robot("fleet/b", 0.4)), "fleet/b", 0.4),
        # Nodes of another robot are not this one's.
        (("robot1/amcl: {ros__parameters: {alpha1: 0.3}}", LARGE), None, 0.1),
    ],
)
def test_namespace_chooses_the_robot(file_of, parts, namespace, radius_m):
    chosen = {} if namespace is None else {"robot.namespace": namespace}
    assert radius(file_of("nav2.yaml", *parts), **chosen) == radius_m


def test_unknown_namespace_is_an_error(file_of):
    content = file_of("nav2.yaml", SMALL, LARGE)
    with pytest.raises(
        FileError,
        match=r"robot.namespace: The Nav2 parameters have no node in 'robot3'. Expected one of /robot1, /robot2",
    ):
        parameters_of({"nav2_params": content, "robot.namespace": "robot3"})
    with pytest.raises(FileError, match=r"no node in 'robot1'. Expected one of /"):
        parameters_of({"robot.namespace": "robot1"})


def test_warning_names_other_robots():
    (words,) = interpretation(parse(f"{SMALL}\n{LARGE}")).reader.warnings.values()
    assert words[0] == "the file has parameters of other robots, /robot2"
    assert words[1].startswith("the robot is /robot1,")
    assert not interpretation(parse(SMALL)).reader.warnings


def test_wildcard_gives_each_robot_its_nodes():
    wild = "/**/amcl: {ros__parameters: {alpha1: 0.5}}\n/robot2/**: {ros__parameters: {alpha2: 0.6}}"
    document = resolved(parse(f"{wild}\n{SMALL}\n{LARGE}"))
    found = [interpretation(of_robot(document, name)).parameters.amcl for name in ("robot1", "robot2")]
    assert [(each.alpha1, each.alpha2) for each in found] == [(0.5, 0.2), (0.5, 0.6)]


def test_info_servers_of_one_topic_are_an_error():
    server = "s1: {ros__parameters: {filter_info_topic: info, type: 1}}"
    speed = "s: {plugin: 'nav2_costmap_2d::SpeedFilter', filter_info_topic: info}"
    costmap = f"global_costmap: {{global_costmap: {{ros__parameters: {{filters: [s], {speed}}}}}}}"
    with pytest.raises(FileError, match=r"s1 and s2 publish on 'info'"):
        interpretation(parse(f"{costmap}\n{server}\n{server.replace('s1', 's2')}"))
