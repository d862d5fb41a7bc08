"""The stack's parameters as a scenario chooses them: a document, rewritten by the keys of the system dimension.

What needs a system's parameters raises `FileError` as `parameters_of` does.
"""

import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from vastflow.sim.model.digest import FileContent, Value, canonical
from vastflow.sim.model.faults import Fault, FileError, Got, Place, Problem
from vastflow.sim.model.names import SLIP, did_you_mean, nearest
from vastflow.sim.model.parameter import ParameterLocation, complaint
from vastflow.sim.model.polygon import as_array, vertices_of
from vastflow.sim.nav2.costmaps.outline import outline_of, padded_outline
from vastflow.sim.nav2.parameter_files.controller_server import primary_controller, written_controller
from vastflow.sim.nav2.parameter_files.costmaps import LAUNCH_WORDS, filtered_by
from vastflow.sim.nav2.parameter_files.document import EXPONENT, PARAMETERS, ParameterDocument, dotted
from vastflow.sim.nav2.parameter_files.findings import nav2_names
from vastflow.sim.nav2.parameter_files.interpretation import Interpretation, document_of, interpretation
from vastflow.sim.nav2.parameter_files.nodes import CONTROLLERS, ROTATION_SHIM, class_name
from vastflow.sim.nav2.parameter_files.parameter_file import loaded
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS, short_names
from vastflow.sim.nav2.parameter_files.reader import plug_in_name, shown
from vastflow.sim.nav2.parameter_files.releases import RELEASE
from vastflow.sim.nav2.parameter_files.robots import of_robot
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.plug_ins.registry import FILE
from vastflow.sim.system.keys import (
    CONTROLLER_KEY,
    COVARIANCE_KEY,
    FILE_KEY,
    KEEPOUT_KEY,
    MASK_KEYS,
    RELEASE_KEY,
    SPEED_KEY,
    SUT,
)
from vastflow.sim.system.robot import NAMESPACE_KEY, NOISE_MODEL_KEY, NOISE_PLACE, robot_keys
from vastflow.sim.world.noise_registry import GaussianDropoutParameters

WHOLE: Final = re.compile(r"[-+]?\d+")
POINTED: Final = re.compile(r"[-+]?(\d+\.\d*|\.\d+)")


def rewritten(
    document: ParameterDocument, rewrites: Mapping[str, Value]
) -> tuple[ParameterDocument, dict[str, tuple[ParameterLocation, ...]]]:
    """Replace or add parameters of a document, and find the paths that each key targets.

    Of two keys for one path the longer one counts, in whatever order they come. Text that is a number or a flag is
    that.
    """
    values = dict(document.values)
    touched: dict[str, tuple[ParameterLocation, ...]] = {}
    for key in sorted(rewrites, key=lambda key: (key.count("."), key)):
        touched[key] = targets(values, key)
        for path in touched[key]:
            items = _items(values.get(path[:-1]))
            if path not in values and items and path[-1].isdecimal():
                k = int(path[-1])
                values[path[:-1]] = [*items[:k], converted(rewrites[key]), *items[k + 1 :]]
            else:
                values[path] = converted(rewrites[key])
    return replace(document, values=values), touched


def targets(values: Mapping[ParameterLocation, Value], key: str) -> tuple[ParameterLocation, ...]:
    """The paths that a key targets.

    A key is the name of a parameter and stands for every occurrence of it, or a whole path with its nodes and
    `ros__parameters`, dotted, which stands for this one, present or not; a number at the end is an item of a list. Besides
    these, RewrittenYaml's own, the last names of a path stand for every path that ends with them
    (`FollowPath.vx_max`, `global_costmap.robot_radius`).
    """
    names = tuple(key.split("."))
    if found := _occurrences(values, names):
        return found
    if names[-1].isdecimal() and (lists := _occurrences(values, names[:-1])):
        k = int(names[-1])
        return tuple((*path, str(k)) for path in lists if k < len(_items(values[path])))
    return (names,) if PARAMETERS in names[:-1] else ()


def _occurrences(values: Mapping[ParameterLocation, Value], names: ParameterLocation) -> tuple[ParameterLocation, ...]:
    if names in values:
        return (names,)
    return tuple(path for path in values if path[-1:] == names[-1:] and unmarked(path)[-len(names) :] == names)


def unmarked(path: ParameterLocation) -> ParameterLocation:
    return tuple(name for name in path if name != PARAMETERS)


def _items(value: Value) -> Sequence[Value]:
    return value if isinstance(value, Sequence) and not isinstance(value, str) else ()


def converted(value: Value) -> Value:
    """Text that is a number or a flag, as that; the files of launch arguments have nothing but text."""
    if not isinstance(value, str):
        return [converted(item) for item in value] if isinstance(value, Sequence) else value
    text = value.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if POINTED.fullmatch(text) or EXPONENT.fullmatch(text) else value


OWN_KEYS: Final[Mapping[str, tuple[ParameterLocation, ...]]] = {
    **{
        key: ((*NOISE_PLACE, name),)
        for name in GaussianDropoutParameters.model_fields
        for key in (name, name.removeprefix("laserscan_"))
    },
    "odometry_noise_std_deviation": (("odometry_noise_std_deviation",),),
    COVARIANCE_KEY: tuple((f"{COVARIANCE_KEY}_{axis}",) for axis in ("xx", "yy", "yaw")),
    **{key: (path,) for key, path in robot_keys().items()},
    RELEASE_KEY: (RELEASE,),
}
"""Keys that stand in no Nav2 file, and where `Perturbation`, the lidar's noise, and `RobotParameters` are read. The two of the paper's study go by the
names of its launch arguments, or by those of its relay node."""

_NOT_IN_THE_FILE: Final = frozenset({FILE_KEY, CONTROLLER_KEY, *MASK_KEYS})
"""Keys that rewrite no parameter."""


class Chosen(NamedTuple):
    """A system's rewritten document, and the paths that each of its keys targets."""

    interpretation: Interpretation
    touched: Mapping[str, tuple[ParameterLocation, ...]]


def parameters_of(system: Mapping[str, Value]) -> NavParameters:
    """The stack's parameters of a system dimension; keys that it does not model are left to `unread`.

    The document is that of `nav2_params`, else Nav2 Jazzy's default; `controller` puts another controller in it; every
    other key rewrites parameters of it (see `targets`). Numbers and flags may be written as text.

    Raises:
        FileError: a value of the wrong type or out of range, an unknown plug-in, a file that has changed. The faults
            of what the system rewrites name its keys.
    """
    return _chosen(_system(system)).interpretation.parameters


_NOISE: Final = ".".join((*NOISE_PLACE, ""))


def drawn_parameters(system: Mapping[str, Value]) -> NavParameters:
    """The parameters of a system without those of plug-ins in files, of which nothing is executed; raises as `parameters_of`."""
    return _drawn(system).interpretation.parameters


def _drawn(system: Mapping[str, Value]) -> Chosen:
    file = system.get(FILE_KEY)
    named = [*system.values(), *(loaded(file).values.values() if isinstance(file, FileContent) else ())]
    own = any(FILE in str(value) for value in named)  # others share what `parameters_of` made
    noise = system.get(NOISE_MODEL_KEY)
    if not isinstance(noise, str | None) or FILE in str(noise):
        system = {key: value for key, value in system.items() if not key.startswith(_NOISE)}
    return _chosen(replace(_system(system), drawn=own))


def file_of(system: Mapping[str, Value]) -> Interpretation | None:
    """Return the Nav2 parameter file of a system as it is read without the other keys; None without one.

    Nothing of plug-ins in files is executed.
    """
    own = {key: system[key] for key in (FILE_KEY, NAMESPACE_KEY) if key in system}
    return _drawn(own).interpretation if FILE_KEY in own else None


def unread(system: Mapping[str, Value], undecided: Iterable[str] = ()) -> tuple[str, ...]:
    """Keys of the system dimension that nothing in the simulator reads, sorted.

    Args:
        undecided: More keys, whose values are not known yet.
    """
    chosen = _chosen(_system(system))
    document, asked, undecided = chosen.interpretation.document, chosen.interpretation.reader.asked, tuple(undecided)
    touched = {key: _targets(document, key) for key in undecided} | {**chosen.touched}

    def is_read(path: ParameterLocation) -> bool:
        return path in asked or (path[-1].isdecimal() and path[:-1] in asked)

    unread_keys = {key for key, paths in touched.items() if not any(map(is_read, paths))} - _NOT_IN_THE_FILE
    masks = {key for key in MASK_KEYS if key in (*system, *undecided)}
    parameters = chosen.interpretation.parameters
    return tuple(sorted(unread_keys | {key for key in masks if not filtered_by(key, parameters)}))


def intended_key(system: Mapping[str, Value], key: str, others: Iterable[str] = ()) -> str | None:
    """The key that one which nothing reads was meant to be: a known one with a prefix, or spelled alike.

    A parameter that Nav2 has, and this system doesn't, is no slip.

    Args:
        others: Known keys that are not the system's.
    """
    names, own = tuple(key.split(".")), sorted({*OWN_KEYS, *_NOT_IN_THE_FILE, *others})
    if prefixed := next((each for mark in "._" for each in own if each.endswith(f"{mark}{key}")), None):
        return prefixed
    asked = _chosen(_system(system)).interpretation.reader.asked
    known = {*(tuple(each.split(".")) for each in own), *(unmarked(path)[-len(names) :] for path in asked)}
    for k, name in enumerate(names[:-1] if names[-1] in nav2_names() else names):
        beside = {
            path[k]
            for path in known
            if len(path) == len(names) and path[:k] + path[k + 1 :] == names[:k] + names[k + 1 :]
        }
        if near := nearest(name, beside, SLIP):
            return ".".join((*names[:k], near, *names[k + 1 :]))
    return None


def unused_because(system: Mapping[str, Value], key: str) -> str:
    """The reason why other parameters make one ineffective; empty for any other key."""
    reader = _chosen(_system(system)).interpretation.reader
    unused, kind = reader.unused, {KEEPOUT_KEY: "KeepoutFilter", SPEED_KEY: "SpeedFilter"}.get(key)
    if kind:
        return next((unused[place] for place, found in reader.kinds.items() if found == kind and place in unused), "")
    return next((why for path, why in unused.items() if targets({path: None}, key) == (path,)), "")


def check_key(system: Mapping[str, Value], key: str, value: Value) -> bool:
    """Check one more key of a system; True if it targets a parameter.

    For a parameter's value in a system that is right this is some thirty times as fast as `parameters_of`; bounds on several
    parameters together are not checked then.
    """
    try:
        fields = _fields(_system(system), key)
    except FileError:
        fields = None
    if fields is None:
        parameters_of({**system, key: value})
        return True
    for model, name in fields:
        if right := complaint(model, name, converted(value)):
            raise _error(key, Got(shown(value)), right)
    return bool(fields)


def _error(key: str, problem: Problem, expected: str) -> FileError:
    return FileError([Fault(Place("", 0, 0, key), problem, expected)])


@functools.cache
def default_document() -> ParameterDocument:
    """The modeled part of Nav2 Jazzy's default file."""
    return document_of(NavParameters())


def with_controller(document: ParameterDocument, name: Value) -> ParameterDocument:
    """The document with one controller: its own of that kind if it has one, else one with the default parameters.

    Args:
        name: `mppi`, the name of an installed controller, or `file.py:Class` of one that the document lists.

    Raises:
        FileError: no such controller.
    """
    values = dict(document.values)
    node = document.node("controller_server")
    if node is None:
        node = ("controller_server", PARAMETERS)
        values |= {path: default_document().values[path] for path in default_document().below(node)}
    listed = (*node, CONTROLLERS.lists[0])
    own: dict[str, str] = {}
    for each in reversed(_items(values.get(listed))):
        place = (*node, str(each))
        text = str(values.get((*place, "plugin")))
        if class_name(text) == ROTATION_SHIM:
            text = str(values.get(primary_controller(values, place)))
        own[plug_in_name(text)] = place[-1]
    meant = short_names().get(name, name) if isinstance(name, str) else ""
    if meant in own:
        return replace(document, values={**values, listed: [own[meant]]}, controller=own[meant])
    if meant not in CONTROLLER_PLUG_INS.known:
        known = [*short_names(), *sorted(each for each in own if FILE in each)]
        raise _error(CONTROLLER_KEY, f"unknown controller {shown(name)}", did_you_mean(str(name), known))
    block = written_controller(node, CONTROLLER_PLUG_INS.parameters(meant)())
    kept = {path: value for path, value in values.items() if path[: len(node) + 1] != (*node, CONTROLLERS.used)}
    return replace(document, values={**kept, **block})


@dataclass(frozen=True, slots=True)
class _System:
    """A system dimension that is equal to another of the same content."""

    content: str
    values: Mapping[str, Value] = field(compare=False)
    drawn: bool = False


def _system(values: Mapping[str, Value]) -> _System:
    values = {key: value for key, value in values.items() if not key.startswith(SUT)}
    return _System(canonical(values), values)


@functools.lru_cache(maxsize=64)
def _chosen(system: _System) -> Chosen:
    keys = {key: value for key, value in system.values.items() if key not in _NOT_IN_THE_FILE}
    document = default_document()
    if FILE_KEY in system.values:
        content = system.values[FILE_KEY]
        if not isinstance(content, FileContent):
            raise _error(FILE_KEY, Got(shown(content)), f"a file, which execution.{FILE_KEY} names")
        document = loaded(content)
    document = of_robot(document, system.values.get(NAMESPACE_KEY))
    masked = {path: word for path, word in document.values.items() if isinstance(word, str) and word in LAUNCH_WORDS}
    replaced = {path: LAUNCH_WORDS[word] in system.values for path, word in masked.items()}
    document = replace(document, values={**document.values, **replaced}) if replaced else document
    if CONTROLLER_KEY in system.values:
        document = with_controller(document, system.values[CONTROLLER_KEY])
    own = {key: value for key, value in keys.items() if _own_paths(key)}
    changed, touched = rewritten(document, {key: value for key, value in keys.items() if key not in own})
    touched |= {key: _targets(document, key) for key in own}
    try:
        own_paths = {path for paths in touched.values() for path in paths}
        values = {**changed.values, **_own_values(own)}
        return Chosen(interpretation(replace(changed, values=values), drawn=system.drawn, varied=own_paths), touched)
    except FileError as error:
        raise FileError(_named(fault, touched) for fault in error.faults) from None


@functools.lru_cache(maxsize=256)
def _fields(system: _System, key: str) -> tuple[tuple[type[BaseModel], str], ...] | None:
    """The parameters that a key would rewrite; None if it targets more than values."""
    chosen = _chosen(system).interpretation
    paths = _targets(chosen.document, key)
    fields = tuple(chosen.reader.fields[path] for path in paths if path in chosen.reader.fields)
    return fields if len(fields) == len(paths) and key not in (CONTROLLER_KEY, COVARIANCE_KEY) else None


def _targets(document: ParameterDocument, key: str) -> tuple[ParameterLocation, ...]:
    return _own_paths(key) or targets(document.values, key)


def _own_paths(key: str) -> tuple[ParameterLocation, ...]:
    """Return the places of a key that is in no Nav2 file; a noise model defines its own parameters."""
    place = tuple(key.split("."))
    return OWN_KEYS.get(key) or ((place,) if place[: len(NOISE_PLACE)] == NOISE_PLACE else ())


def _own_values(own: Mapping[str, Value]) -> Mapping[ParameterLocation, Value]:
    values: dict[ParameterLocation, Value] = {}
    for key in sorted(own):
        paths, items = _own_paths(key), converted(own[key])
        if len(paths) == 1:
            items = [items]
        elif not isinstance(items, Sequence) or isinstance(items, str) or len(items) != len(paths):
            right = "a list of three variances, of x and y (m²) and of the yaw (rad²)"
            raise _error(key, Got(shown(own[key])), right)
        values |= dict(zip(paths, items, strict=True))
    return values


def _named(fault: Fault, touched: Mapping[str, tuple[ParameterLocation, ...]]) -> Fault:
    """Return the fault of a rewritten value as one of the key that wrote it."""
    where = f"{fault.place.where}."

    def writes(path: ParameterLocation) -> bool:
        """Whether a path is the fault's, above it, or an item of it."""
        return where.startswith(f"{dotted(path)}.") or f"{dotted(path)}.".startswith(where)

    by = [key for key, paths in touched.items() if any(map(writes, paths))]
    if not by or fault.kind == "contradiction":
        return fault
    return replace(fault, place=Place("", 0, 0, max(by, key=lambda key: key.count("."))))


def local_outline(parameters: NavParameters) -> NDArray[np.float64]:
    """Vertices (V, 2), in the robot's frame, of the area that must be free at the start.

    They are those of the padded footprint, and those of the body that the section `robot` gives.
    """
    outline, given = outline_of(parameters.local_costmap), parameters.robot
    if given.radius is not None:
        return np.vstack([outline, padded_outline(given.radius, 0.0)])
    return np.vstack([outline, as_array(vertices_of(given.polygon))]) if given.polygon else outline
