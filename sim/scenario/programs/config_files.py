"""Configuration files of programs: parameters found, checked, and written by their paths in YAML, JSON, and XML.

A path in YAML and JSON has keys and indices with dots between, as `controller_server.ros__parameters.goals.0`; a key may have dots of its own, and
`ros__parameters` may be left out. A node of ROS gets parameters that its file lacks where a path has it.
A path in XML is one of ElementTree's below the root, then `@` and an attribute, as `BehaviorTree/RateController/@hz` or `//RateController/@hz`.
"""

import functools
import itertools
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import yaml
from yaml.constructor import SafeConstructor
from yaml.nodes import CollectionNode, MappingNode, Node, ScalarNode, SequenceNode

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint, Got, Invalid, ScenarioError
from vastflow.sim.model.files import (
    MOST_LEVELS,
    MOST_TEXT_BYTES,
    Unreadable,
    json_value,
    read_bytes,
    read_text,
    xml_root,
    yaml_node,
)
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.system.keys import SUT

Tree: TypeAlias = Node | Element
Where: TypeAlias = tuple[int | str, ...]
"""Indices of a node in the nodes above it, or the name of a new one last."""

_ROS: Final = "ros__parameters"
_MOST_SUGGESTED: Final = 5_000
_ELEMENTS: Final = r"[\w.-]+(?:\[(?:[1-9]\d*|@[\w.-]+='[^']*')\])*"
_XML_PATH: Final = re.compile(rf"((?://)?{_ELEMENTS}(?:/{_ELEMENTS})*)(?:/@([\w:.-]+))?")
_NUMBER: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_TAG: Final = "tag:yaml.org,2002:"
_WORDS: Final = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "seq": "a list",
    "map": "a mapping",
}


class _Quoted(yaml.SafeDumper):
    """Quotes all text, as readers don't agree on what is a number."""


_Quoted.add_representer(str, lambda dumper, text: dumper.represent_scalar(f"{_TAG}str", text, style='"'))
_Quoted.add_multi_representer(float, yaml.SafeDumper.represent_float)  # NumPy's


def read_tree(path: Path) -> Tree:
    """Read a configuration file; raises `Unreadable` if it can't be used."""
    match path.suffix.lower():
        case ".xml":
            root = xml_root(read_bytes(path, "an XML file", MOST_TEXT_BYTES))
            if root.find("/".join(["*"] * MOST_LEVELS)) is not None:  # what writes it recurses
                raise Unreadable(f"it is more than {MOST_LEVELS} levels deep", "use fewer levels")
            return root
        case ".json":
            text = yaml.dump(json_value(read_text(path, "a JSON file")), Dumper=_Quoted, sort_keys=False)
        case ".yaml" | ".yml":
            text = read_text(path, "a YAML file")
        case other:
            raise Unreadable(Got(repr(other)), "a file that ends with .yaml, .yml, .json, or .xml")
    node = yaml_node(text)
    events = yaml.parse(text, yaml.CSafeLoader)
    if node is None or len([event for event in events if isinstance(event, yaml.DocumentStartEvent)]) > 1:
        raise Unreadable(Got("nothing" if node is None else "several YAML documents"), "one YAML document")
    return node


@functools.lru_cache(maxsize=16)
def _known_tree(content: FileContent, suffix: str) -> Tree:
    return read_tree(Path(content.path))


def configured(setup: ProcessSetup | None, values: Mapping[str, Value]) -> ProcessSetup | None:
    """Return the setup of a configuration with these values; raises `ScenarioError` for one that no process reads."""
    found: dict[str, dict[str, Value]] = {}
    for key in (key for key in values if key.startswith(SUT)):
        name, _, path = key.removeprefix(SUT).partition(".")
        if setup is None or name not in setup.config_files:
            raise ScenarioError(f"{key}: there is no config file {name!r} that a process reads")
        found.setdefault(setup.config_files[name], {})[path] = values[key]
    return setup and replace(setup, config_files={}, parameters=found)


def complaint(setup: ProcessSetup | None, key: str, value: Value) -> Complaint | None:
    """Return what is wrong with a parameter of a configuration file; None for a file that can't be read, too."""
    if setup is None:
        return f"no process reads {key!r}, as the built-in robot drives", f"leave out '{SUT}' and the name behind it"
    name, _, path = key.removeprefix(SUT).partition(".")
    if name not in setup.config_files:
        return f"there is no config file {name!r}", did_you_mean(name, setup.config_files, "add execution.config_files")
    try:
        if content := dict(setup.files).get(setup.config_files[name]):
            _fitted(_known_tree(content, Path(content.path).suffix), path, value)
    except Unreadable:
        return None
    except Invalid as error:
        return error.problem, error.expected
    return None


def write_parameters(parameters: Mapping[str, Mapping[str, Value]], folder: Path) -> None:
    """Write values into files below `folder` by their paths; comments are lost. Raises `ScenarioError`, see `complaint`."""
    for name, values in parameters.items():
        try:
            tree = read_tree(folder / name)
            for path, value in sorted(values.items()):
                new, put = _fitted(tree, path, value)
                tree = put(new)
        except Invalid as error:
            raise ScenarioError(f"{name}: {error}") from None
        if isinstance(tree, Element):
            content = ElementTree.tostring(tree, "utf-8", xml_declaration=True)
        elif name.lower().endswith(".json"):
            content = json.dumps(SafeConstructor().construct_document(tree), indent=2, ensure_ascii=False).encode()
        else:
            content = yaml.serialize(tree, None, yaml.CSafeDumper, encoding="utf-8", allow_unicode=True, width=1 << 16)
        (folder / name).write_bytes(content)


def _fitted(tree: Tree, path: str, value: Value) -> tuple[Node, Callable[[Node], Tree]]:
    """Return a value as it is written, and what puts it there; raises `Invalid`, see `complaint`."""
    old, put = _in_xml(tree, path) if isinstance(tree, Element) else _in_nodes(tree, path)
    node = yaml_node(yaml.dump(value, Dumper=_Quoted, sort_keys=False))
    assert node is not None
    new = _typed(node, old)
    if isinstance(tree, Element) and not new.value.isprintable():
        raise Invalid(Got(repr(new.value)), "printable text")
    return new, put


def _in_nodes(tree: Node, path: str) -> tuple[Node, Callable[[Node], Tree]]:
    places = _places_by_path(tree)
    node, is_ros, name = path.partition(f"{_ROS}.")
    found = places.get(path, [])
    if len(found) > 1:
        raise Invalid(f"{path!r} is there twice", "give each key once")
    is_below_value = any(not isinstance(above, MappingNode) for _, above in places.get(path.rpartition(".")[0], []))
    if not found and is_ros and name and not is_below_value:  # parameters with defaults may be left out
        above = [where for where, group in places.get(node + _ROS, []) if isinstance(group, MappingNode)]
        found = [((*where, name), ScalarNode(f"{_TAG}null", "")) for where in above]
    if not found:
        raise Invalid(f"there is no {path!r}", did_you_mean(path, itertools.islice(places, _MOST_SUGGESTED)))
    (where, old), *_ = found
    return old, functools.partial(_replaced, tree, where)


@functools.lru_cache(maxsize=16)
def _places_by_path(tree: Node) -> Mapping[str, Sequence[tuple[Where, Node]]]:
    found: dict[str, list[tuple[Where, Node]]] = {}
    for path, where, node in _places(tree, "", ()):
        for each in {path, path.replace(f".{_ROS}.", ".")}:
            found.setdefault(each, []).append((where, node))
    return found


def _places(node: Node, above: str, where: Where) -> Iterator[tuple[str, Where, Node]]:
    is_map, children = isinstance(node, MappingNode), node.value if isinstance(node, CollectionNode) else ()
    for k, child in enumerate(children):
        path, below = f"{above}{child[0].value if is_map else k}", child[1] if is_map else child
        yield path, (*where, k), below
        yield from _places(below, f"{path}.", (*where, k))


def _replaced(node: Node, where: Where, new: Node) -> Node:
    """Return a tree with another node at a place; aliases of what it is in stay."""
    if not where:
        return new
    (k, *below), children = where, [*node.value]
    if isinstance(k, str):
        children.append((ScalarNode(f"{_TAG}str", k), new))
    elif isinstance(node, MappingNode):
        children[k] = children[k][0], _replaced(children[k][1], tuple(below), new)
    else:
        children[k] = _replaced(children[k], tuple(below), new)
    assert isinstance(node, CollectionNode)
    return type(node)(node.tag, children, flow_style=node.flow_style)


def _in_xml(root: Element, path: str) -> tuple[Node, Callable[[Node], Tree]]:
    if not (asked := _XML_PATH.fullmatch(path)):
        raise Invalid(Got(repr(path)), "a path of elements, such as //RateController/@hz")
    elements, name = asked.groups()
    found = root.findall(f".{elements}" if elements.startswith("//") else elements)
    found = [each for each in found if (name in each.attrib if name else not len(each))]
    if not found:
        names = (f"//{each.tag}/@{name}" for each in root.iter() for name in each.attrib)
        raise Invalid(f"there is no {path!r}", did_you_mean(path, {*itertools.islice(names, _MOST_SUGGESTED)}))
    if len(found) > 1:
        raise Invalid(f"{path!r} is there {len(found)} times", "name one by [1] or by [@attribute='value']")

    def put(new: Node) -> Element:
        if name:
            found[0].set(name, new.value)
        else:
            found[0].text = new.value
        return root

    return ScalarNode(f"{_TAG}str", found[0].get(name) if name else found[0].text or ""), put


def _typed(new: Node, old: Node) -> Node:
    """Return a value in the type of another: a whole number as a float where that is one."""
    there, given = _kind(old), _kind(new)
    if isinstance(old, SequenceNode) and isinstance(new, SequenceNode) and old.value:
        return SequenceNode(new.tag, [_typed(each, old.value[0]) for each in new.value], flow_style=old.flow_style)
    if (there, given) == ("float", "int"):
        return ScalarNode(f"{_TAG}float", f"{new.value}.0")
    if there in _WORDS and there != given:
        said = {"str": repr(new.value), "seq": "a list", "map": "a mapping"}.get(given, new.value)
        raise Invalid(Got(str(said)), f"{_WORDS[there]}, as in the file")
    return new


def _kind(node: Node) -> str:
    kind: str = node.tag.rpartition(":")[2]
    if kind != "str" or not isinstance(node, ScalarNode) or node.style:
        return kind  # else of XML, or of YAML 1.1, to which 1e-3 is text
    if _NUMBER.fullmatch(node.value):
        return "int" if node.value.lstrip("+-").isdecimal() else "float"
    return "bool" if node.value in ("true", "false") else kind
