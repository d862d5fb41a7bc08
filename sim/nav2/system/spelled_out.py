"""A Nav2 parameter file spelled out: each parameter that differs from Nav2's defaults is a key."""

from collections.abc import Mapping
from typing import Final, TypeAlias

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.chosen import default_document, parameters_of, targets, with_controller
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, dotted
from vastflow.sim.nav2.parameter_files.interpretation import document_of
from vastflow.sim.nav2.parameter_files.parameter_file import read_nav2_document
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS, short_name
from vastflow.sim.nav2.parameter_files.robots import of_robot
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.plug_ins.snapshot import PlugInFile
from vastflow.sim.system.keys import CONTROLLER_KEY, FILE_KEY
from vastflow.sim.system.robot import NAMESPACE_KEY

_MONITOR: Final = "collision_monitor.FootprintApproach.enabled"
"""Off where a file has no such node, which no key takes away."""

Values: TypeAlias = Mapping[ParameterLocation, Value]


def spelled_out(system: Mapping[str, Value]) -> Mapping[str, Value]:
    """Return the same system without a parameter file, or the given one if keys can't express the file.

    What the other keys rewrite of the file stands for itself, and its default is Nav2's.
    """
    content = system.get(FILE_KEY)
    if not isinstance(content, FileContent) or isinstance(content, PlugInFile):
        return system
    rest = {key: value for key, value in system.items() if key not in (FILE_KEY, NAMESPACE_KEY)}
    try:
        meant = parameters_of(system)
        of_file = parameters_of(
            {key: system[key] for key in (FILE_KEY, NAMESPACE_KEY, CONTROLLER_KEY) if key in system}
        )
        kind, default = type(of_file.controller), default_document().values
        chosen: dict[str, Value] = (
            {} if kind is MppiParameters else {CONTROLLER_KEY: short_name(CONTROLLER_PLUG_INS.name_of(kind))}
        )
        if chosen:
            default = with_controller(default_document(), chosen[CONTROLLER_KEY]).values
        said = document_of(of_file).values
        rewritten = {path for key in rest for path in targets(said, key)}
        own = {
            _key(path, default): list(value) if isinstance(value, tuple) else value
            for path, value in said.items()
            if path not in rewritten and default.get(path) != value
        }
        if not of_file.collision_monitor.enabled:
            own[_MONITOR] = False
        found = {**chosen, **own, **rest}
        return found if parameters_of(found) == meant else system
    except FileError:
        return system


def assumed_keys(system: Mapping[str, Value]) -> frozenset[str]:
    """Keys that `spelled_out` adds although the parameter file lacks them: what Nav2's code does differs from its default file."""
    content = system.get(FILE_KEY)
    if not isinstance(content, FileContent):
        return frozenset()
    given = of_robot(read_nav2_document(content.path), system.get(NAMESPACE_KEY)).values
    named = {*system, *([CONTROLLER_KEY] if any("controller_server" in path for path in given) else ())}
    return frozenset(
        key for key in spelled_out(system) if key not in named and given.keys().isdisjoint(targets(given, key))
    )


def _key(path: ParameterLocation, default: Values) -> str:
    """The path without `ros__parameters`, unless it is ambiguous."""
    short = ".".join(name for name in path if name != PARAMETERS)
    return short if targets(default, short) == (path,) else dotted(path)
