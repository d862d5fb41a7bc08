"""Parameters of programs' configuration files: found, checked, and written by their paths."""

import json
from xml.etree import ElementTree

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.digest import FileContent, digest, file_digest
from vastflow.sim.model.faults import ScenarioError, message_of
from vastflow.sim.model.files import Unreadable
from vastflow.sim.model.scenario import ProcessSetup, setup_of
from vastflow.sim.scenario.programs.config_files import complaint, configured, read_tree, write_parameters
from vastflow.sim.scenario.programs.run import process_run

NAV2 = """\
# parameters of the stack
controller_server:
  ros__parameters:
    use_sim_time: true   # of the bridge
    controller_frequency: 20.0
    count: 3
    rate: 1e-3
    version: "1.0"
    critics: ["RotateToGoal", 'Oscillation']
    weights: [1.0, 2.5]
    FollowPath:
      max_vel_x: 0.26
      plugin: dwb
    dotted.name: 4
    nothing:
/**:
  ros__parameters: {seen: yes, hex: 0x1F, quoted: '0.5'}
"""
TREE = """<root main_tree_to_execute="Main">
  <!-- plans once a second -->
  <BehaviorTree ID="Main">
    <Sequence name="all">
      <RateController hz="1.0"><Plan goal="{goal}" retries="2"/></RateController>
      <Wait seconds="1"/><Wait seconds="2" on="true"/>
      <Script>x &lt; 1</Script>
    </Sequence>
  </BehaviorTree>
</root>
"""
NODE = "controller_server.ros__parameters"


@pytest.fixture
def check(tmp_path):
    """Return the complaint about a value for a path of a file with this text."""

    def complain(path, value, text=NAV2, name="nav2.yaml"):
        (file := tmp_path / name).write_text(text)
        files = ((name, FileContent(str(file), file_digest(file))),)
        found = complaint(ProcessSetup(files, config_files={"nav2": name}), f"sut.nav2.{path}", value)
        return found and message_of(*found)

    return complain


def written(folder, name, text, values):
    (folder / name).write_text(text, encoding="utf-8")
    write_parameters({name: values}, folder)
    return (folder / name).read_text(encoding="utf-8")


def test_written_file_differs_in_its_values_and_comments_alone(tmp_path):
    values = {
        f"{NODE}.FollowPath.max_vel_x": 1,
        f"{NODE}.critics.1": "Path",
        f"{NODE}.weights": [3, 0.5],
        f"{NODE}.version": "2.0",
        "/**.ros__parameters.seen": False,
        "controller_server.dotted.name": 5,
    }
    assert (
        written(tmp_path, "nav2.yaml", NAV2, values)
        == """\
controller_server:
  ros__parameters:
    use_sim_time: true
    controller_frequency: 20.0
    count: 3
    rate: 1e-3
    version: "2.0"
    critics: ["RotateToGoal", "Path"]
    weights: [3.0, 0.5]
    FollowPath:
      max_vel_x: 1.0
      plugin: dwb
    dotted.name: 5
    nothing:
/**:
  ros__parameters: {seen: false, hex: 0x1F, quoted: '0.5'}
"""
    )


def test_aliases_of_what_a_value_is_in_keep_theirs(tmp_path):
    text = "a: &a {x: 1, y: 2}\nb: *a\nc: *a\n"
    assert yaml.safe_load(written(tmp_path, "a.yaml", text, {"b.x": 5})) == {
        "a": {"x": 1, "y": 2}, "b": {"x": 5, "y": 2}, "c": {"x": 1, "y": 2},
    }  # fmt: skip


def test_node_of_ros_gets_a_parameter_that_its_file_lacks(tmp_path, check):
    assert check(f"{NODE}.FollowPath.max_vel_y", 0.1) is None
    found = yaml.safe_load(written(tmp_path, "nav2.yaml", NAV2, {f"{NODE}.FollowPath.max_vel_y": 0.1}))
    assert found["controller_server"]["ros__parameters"]["FollowPath.max_vel_y"] == 0.1


def test_written_tree_differs_in_its_values_and_comments_alone(tmp_path):
    values = {
        "//RateController/@hz": 5,
        "BehaviorTree[@ID='Main']/Sequence/Wait[2]/@on": False,
        "//Script": "x > 2 & y",
        "//Plan/@goal": "{other}",
    }
    comment = "\n  <!-- plans once a second -->"
    expected = TREE.replace(comment, "\n  ").replace('hz="1.0"', 'hz="5.0"').replace('on="true"', 'on="false"')
    expected = expected.replace("x &lt; 1", "x &gt; 2 &amp; y").replace("{goal}", "{other}")
    found = written(tmp_path, "tree.xml", TREE, values)
    assert ElementTree.canonicalize(found) == ElementTree.canonicalize(expected)


@each_row(
    "path, value, said",
    [
        (f"{NODE}.FollowPath.max_vel_x", 1, None),
        (f"{NODE}.FollowPath.max_vel_x", "0.3", "expected a number, as in the file, got '0.3'"),
        (f"{NODE}.rate", 0.2, None),
        (f"{NODE}.count", 2.5, "expected a whole number, as in the file, got 2.5"),
        (f"{NODE}.count", True, "expected a whole number, as in the file, got true"),
        (f"{NODE}.use_sim_time", 1, "expected true or false, as in the file, got 1"),
        (f"{NODE}.version", 1.0, "expected text, as in the file, got 1.0"),
        (f"{NODE}.weights", [1, 2], None),
        (f"{NODE}.weights", ["a"], "expected a number, as in the file, got 'a'"),
        (f"{NODE}.weights", 1.0, "expected a list, as in the file, got 1.0"),
        (f"{NODE}.FollowPath", 3, "expected a mapping, as in the file, got 3"),
        (f"{NODE}.FollowPath.max_vel_x", {"a": 1}, "expected a number, as in the file, got a mapping"),
        (f"{NODE}.nothing", "anything", None),
        ("controller_server.FollowPath.max_vel_x", 0.3, None),
        ("controler_server.ros__parameters.count", 3, f"There is no 'controler_server.ros__parameters.count'. Did you mean '{NODE}.count'?"),
        (f"{NODE}.weights.2", 1.0, f"There is no '{NODE}.weights.2'. Did you mean '{NODE}.weights.1'?"),
    ],
)  # fmt: skip
def test_value_has_a_place_and_its_type(check, path, value, said):
    assert check(path, value) == said


@each_row(
    "path, value, said",
    [
        ("//RateController/@hz", 2, None),
        ("//RateController/@hz", "fast", "expected a number, as in the file, got 'fast'"),
        ("//Plan/@retries", 1.5, "expected a whole number, as in the file, got 1.5"),
        ("//RateControler/@hz", 2, "There is no '//RateControler/@hz'. Did you mean '//RateController/@hz'?"),
        ("//Wait/@seconds", 3, "'//Wait/@seconds' is there 2 times. Name one by [1] or by [@attribute='value']."),
        ("//Plan/@goal", "a\x00", r"expected printable text, got 'a\x00'"),
        ("//Plan/@goal", [1], "expected text, as in the file, got a list"),
        ("..//x", 1, "expected a path of elements, such as //RateController/@hz, got '..//x'"),
        ("//Sequence", "x", "There is no '//Sequence'. Did you mean '//Sequence/@name'?"),
    ],
)  # fmt: skip
def test_value_of_a_tree_has_a_place_and_its_type(check, path, value, said):
    assert check(path, value, TREE, "tree.xml") == said


def test_path_that_two_keys_have_is_refused(check):
    assert check("a.b", 1, "a: {b: 1}\na.b: 2\n") == "'a.b' is there twice. Give each key once."


def test_unknown_files_and_missing_processes_are_said():
    setup = ProcessSetup(config_files={"nav2": "nav2.yaml"})
    assert message_of(*complaint(setup, "sut.nav.x", 1)) == "There is no config file 'nav'. Did you mean 'nav2'?"
    assert message_of(*complaint(None, "sut.nav2.x", 1)) == (
        "No process reads 'sut.nav2.x', as the built-in robot drives. Leave out 'sut.' and the name behind it."
    )
    for each in (setup, None):
        with pytest.raises(ScenarioError, match=r"sut\.nav\.x: there is no config file 'nav' that a process reads"):
            configured(each, {"sut.nav.x": 1})


@each_row(
    "name, text, said",
    [
        ("a.yaml", "a: 1\n---\nb: 2\n", "expected one YAML document, got several YAML documents"),
        ("a.yaml", "# nothing\n", "expected one YAML document, got nothing"),
        ("a.yaml", "a: [1\n", "Not YAML"),
        ("a.json", "{'a': 1}", "It is not JSON"),
        ("a.xml", "<a><b></a>", "expected XML, got mismatched tag"),
        ("a.xml", "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "expected XML without a document type, got <!DOCTYPE"),
        ("a.xml", "<a>" * 500 + "</a>" * 500, "It is more than 100 levels deep"),
        ("a.ini", "[a]", "expected a file that ends with .yaml, .yml, .json, or .xml, got '.ini'"),
    ],
)
def test_file_that_can_not_be_used_is_one_sentence(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(Unreadable) as error:
        read_tree(tmp_path / name)
    assert str(error.value).startswith(said) and "\n" not in str(error.value)


texts = st.text(st.characters(codec="utf-8", exclude_characters="\ufeff\x85\u2028\u2029"), max_size=12)
scalars = st.one_of(
    st.booleans(), st.integers(-(10**18), 10**18), st.floats(allow_nan=False, allow_infinity=False), texts
)
keys = st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=6)


def of_one_type(old, new):
    return type(old) is type(new) or (type(old) is float and type(new) is int)


@given(
    st.dictionaries(keys, st.dictionaries(keys, scalars | st.lists(st.integers()), min_size=1), min_size=1),
    scalars,
    st.data(),
)
def test_written_value_is_read_back_and_all_else_stays(tmp_path_factory, content, new, data):
    folder = tmp_path_factory.mktemp("files", numbered=True)
    outer = data.draw(st.sampled_from(sorted(content)))
    inner = data.draw(st.sampled_from(sorted(content[outer])))
    if not of_one_type(content[outer][inner], new):
        new = content[outer][inner]
    expected = {**content, outer: {**content[outer], inner: new}}
    for name, dump, load in (("a.json", json.dumps, json.loads), ("a.yaml", yaml.safe_dump, yaml.safe_load)):
        found = load(written(folder, name, dump(content), {f"{outer}.{inner}": new}))
        assert found == expected
        assert type(found[outer][inner]) is type(content[outer][inner])
        assert name == "a.yaml" or [*found] == [*content]


printable = texts.filter(str.isprintable)


@given(
    st.dictionaries(st.sampled_from("abc"), printable.map("t{}".format), min_size=1),
    printable.map("t{}".format),
    printable,
)
def test_written_attribute_is_read_back_and_all_else_stays(tmp_path_factory, attributes, new, text):
    folder = tmp_path_factory.mktemp("files", numbered=True)
    root = ElementTree.Element("root")
    ElementTree.SubElement(root, "leaf", attributes).tail = text
    name = min(attributes)
    given_text = ElementTree.tostring(root, "unicode")
    found = ElementTree.fromstring(written(folder, "a.xml", given_text, {f"leaf/@{name}": new}))
    assert found[0].attrib == {**attributes, name: new}
    assert (found[0].tail or "") == text


def test_digest_has_values_and_no_names_of_files():
    setup = ProcessSetup(config_files={"nav2": "nav2.yaml"})
    other = ProcessSetup(config_files={"stack": "nav2.yaml"})
    assert digest(configured(setup, {"x": 1}).content) == digest(ProcessSetup().content)
    with_value = configured(setup, {"sut.nav2.a.b": 1})
    assert with_value.content == configured(other, {"sut.stack.a.b": 1}).content != ProcessSetup().content
    assert setup_of(with_value.content) == with_value
    assert setup_of(setup.content) == setup


def test_programs_read_values_and_the_users_file_stays(tmp_path):
    (file := tmp_path / "nav2.yaml").write_text(NAV2)
    files = (("nav2.yaml", FileContent(str(file), file_digest(file))),)
    setup = configured(ProcessSetup(files, config_files={"nav2": "nav2.yaml"}), {f"sut.nav2.{NODE}.count": 7})
    with process_run(setup, where=tmp_path) as run:
        for folder in (run.folders.config, run.folders.out):
            assert "count: 7\n" in (folder / "nav2.yaml").read_text()
    assert file.read_text() == NAV2
