"""Reading and writing parameters of a document, with a record of known, used, and wrong ones."""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias, TypeGuard, TypeVar

from pydantic import BaseModel, ValidationError

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Complaint, Fault, FaultKind, Got, Place, Problem
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation, complaints, held, source_of
from vastflow.sim.model.rates import held_hz
from vastflow.sim.nav2.parameter_files.declared import Declared, declared_defaults
from vastflow.sim.nav2.parameter_files.document import SUBSTITUTION, ParameterDocument, dotted
from vastflow.sim.nav2.parameter_files.nodes import PluginClass, Plugins, class_name, short_class
from vastflow.sim.nav2.parameter_files.trees import users_tree
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE, Registry

RATES: Final = frozenset({"controller_frequency", "update_frequency", "publish_frequency"})
"""Parameters whose loops run in whole numbers of ticks."""

Group = TypeVar("Group", bound=BaseModel)
Plain = TypeVar("Plain", bool, str)

Parts: TypeAlias = Mapping[str, Any]
"""Fields of `NavParameters`."""

Values: TypeAlias = dict[ParameterLocation, Value]


class Instance(NamedTuple):
    """A plug-in of a document: its place, its class without the package, and its modeled parameters."""

    place: ParameterLocation
    kind: str
    modeled: PluginClass


class Reader:
    """Reads one document.

    Attributes:
        drawn: Whether plug-ins in files are taken without their parameters, so that nothing of them is executed.
        varied: Paths whose numbers a campaign gives, which must be in the modeled range.
        asked: Paths of all parameters that are looked at, present or not, with the value that is taken.
        fields: Paths of those that are fields of a group, with the group's model and the field's name.
        kinds: Path of a group to what it is, for what of it is not asked for.
        unmodeled: Path of a group that is not read because it is not modeled, to why.
        unused: Path of a group that is not read because Nav2 would not read it either, to why.
        omitted: Path of what the document leaves out to Nav2's declaration, and to the other value of Jazzy's file.
        warnings: Path to what a file has that Nav2 takes, and that hardly anybody means, and to what follows.
        held: Path of a rate that is no whole number of ticks, to the rate (Hz) that is taken.
        bounded: Path of a number that Nav2 takes and that is out of the modeled range, to the bound that is taken.
        faults: Everything wrong.
    """

    def __init__(
        self, document: ParameterDocument, *, drawn: bool = False, varied: Collection[ParameterLocation] = ()
    ) -> None:
        self.document = document
        self.drawn = drawn
        self.varied = varied
        self.asked: dict[ParameterLocation, Value] = {}
        self.fields: dict[ParameterLocation, tuple[type[BaseModel], str]] = {}
        self.kinds: dict[ParameterLocation, str] = {}
        self.unmodeled: dict[ParameterLocation, str] = {}
        self.unused: dict[ParameterLocation, str] = {}
        self.omitted: dict[ParameterLocation, tuple[Declared, Value]] = {}
        self.warnings: dict[ParameterLocation, Complaint] = {}
        self.held: dict[ParameterLocation, float] = {}
        self.bounded: dict[ParameterLocation, float] = {}
        self.faults: list[Fault] = []

    def fault(self, path: ParameterLocation, problem: Problem, expected: str, kind: FaultKind = "error") -> None:
        if SUBSTITUTION in str(value := self.document.values.get(path)):
            kind_of_value = f", {expected}," if isinstance(problem, Got) else ""
            problem = f"the launch file replaces {value!r}"
            expected = f"write what it puts there{kind_of_value} or $(env NAME DEFAULT)"
        place = Place(self.document.file, *self.document.place(path), dotted(path))
        self.faults.append(Fault(place, problem, expected, kind))

    def group(
        self,
        model: type[Group],
        prefix: ParameterLocation,
        elsewhere: Mapping[str, ParameterLocation] | None = None,
        given: Mapping[str, Any] | None = None,
        left_out: Group | None = None,
        kinds: Sequence[str] = (),
    ) -> Group:
        """The parameters below `prefix`, with the defaults that Nav2's code declares for missing ones.

        What is wrong becomes faults, and then the values mean nothing.

        Args:
            elsewhere: Parameter to the path it has where that is not below `prefix`.
            given: Values that are not to be read.
            left_out: Values of Nav2 Jazzy's file, in place of the model's defaults; they count for what the code does not declare.
            kinds: Kinds of the group in `declared_defaults`; the first one with a parameter counts.
        """
        values: dict[str, Any] = dict(given or {})
        paths: dict[str, ParameterLocation] = {}
        tables = (declared_defaults()[kind] for kind in reversed(kinds))
        declared = {name: each for table in tables for name, each in table.items() if each.default is not None}
        for name, field in model.model_fields.items():
            source = source_of(field)
            if name in values or source.is_derived:
                continue
            path = (elsewhere or {}).get(name, (*prefix, source.name or name))
            if is_group(field.annotation):
                known = len(self.faults)
                found = self.group(field.annotation, path, kinds=[name] if kinds else ())
                values[name] = found if len(self.faults) == known else field.default
            elif source.texts:
                usual = str(declared[source.name].default) if source.name in declared else next(iter(source.texts))
                text = class_name(self.plain(path, usual))
                if text not in source.texts:
                    self.fault(path, Got(shown(text)), f"one of {', '.join(source.texts)}")
                values[name] = source.texts.get(text, source.texts[usual])
            else:
                default: Any = getattr(left_out, name, field.default)
                if name in declared:
                    default = self.default_of(path, declared[name], default)
                values[name] = self.document.values.get(path, default)
                if kinds and path not in self.varied and (bound := held(field, values[name])) is not None:
                    self.bounded[path] = values[name] = bound
                paths[name] = path
                self.fields[path] = model, name
        try:
            group = model.model_validate(values)
        except ValidationError as error:
            for name, right in complaints(model, error):
                if name:
                    self.fault(paths[name], Got(shown(self.document.values.get(paths[name]))), right)
                else:
                    named = re.findall(r"\w+", right)
                    path = next((path for name, path in paths.items() if name in named), ())
                    self.fault(path, "the values contradict each other", right, "contradiction")
            return model.model_construct(**values)
        self.asked |= {path: getattr(group, name) for name, path in paths.items()}
        for name, path in paths.items():
            if name in RATES and abs(held_hz(hz := getattr(group, name)) - hz) > 1e-6 * hz:
                self.asked[path] = self.held[path] = round(held_hz(hz), 3)
            if (needs := source_of(model.model_fields[name]).needs) and getattr(group, needs[0]) != needs[1]:
                self.leave(path, needs[2])
        return group

    def default_of(self, path: ParameterLocation, declared: Declared, shipped: Value) -> Value:
        """Return what Nav2's code declares; note it where the document leaves out what Jazzy's file has otherwise."""
        usual = declared.default
        shipped = list(shipped) if isinstance(shipped, tuple) else shipped
        if path not in self.document.values and usual != shipped:
            self.omitted[path] = declared, shipped
        return usual

    def plug_in(
        self,
        plug_ins: Registry[Any],
        foreign: Collection[str],
        path: ParameterLocation,
        default: str,
        listed: ParameterLocation,
    ) -> type[ParameterGroup] | None:
        """The parameters of the plug-in whose class is at `path`; None, with a fault, if it is missing.

        Args:
            foreign: Classes that are known and not modeled.
            listed: Path of the list item that names the plug-in.
        """
        known, noun, document = ", ".join(plug_ins.known), plug_ins.noun, self.document
        name = plug_in_name(self.plain(path, default))
        if not name:
            right = f"name the class of a {noun}: {known}, or {plug_ins.own}"
            self.fault(listed, f"{path[-1]!r} is missing below {path[-2]!r}", right)
        elif name in foreign:
            self.fault(path, f"{name} is not modeled", f"these are: {known}, and {plug_ins.own}")
        elif self.drawn and FILE in name:
            return ParameterGroup
        else:
            try:
                return plug_ins.parameters(name, Path(document.file).parent, document.plug_ins.get(name))
            except PlugInError as error:
                self.fault(path, error.problem, error.expected)
        return None

    def own_group(
        self, kind: type[Group], place: ParameterLocation, others: Collection[ParameterLocation] = ()
    ) -> Group:
        """Read the parameters of a plug-in and of groups in them; report unknown ones as faults."""
        if kind is ParameterGroup:
            return kind()
        for path in self.document.below(place):
            name = path[len(place)]
            if name not in kind.model_fields and path not in others:
                what = f"{kind.__name__} has no parameter {name!r}"
                self.fault(path, what, did_you_mean(name, kind.model_fields, "it has no parameters"))
        for name, field in kind.model_fields.items():
            if is_group(field.annotation):
                self.own_group(field.annotation, (*place, name))
        return self.group(kind, place)

    def leave(self, path: ParameterLocation, why: str) -> None:
        """Mark a parameter as ineffective because of others."""
        self.asked.pop(path, None)
        self.fields.pop(path, None)
        self.omitted.pop(path, None)
        self.unused[path] = why

    def plain(self, path: ParameterLocation, default: Plain) -> Plain:
        """A flag or a text, as `default` is, that is no field of a group."""
        found = self.document.values.get(path, default)
        if not isinstance(found, type(default)):
            self.fault(path, Got(shown(found)), "text" if isinstance(default, str) else "true or false")
            found = default
        self.asked[path] = found
        return found

    def names(self, path: ParameterLocation, default: Sequence[str] = ()) -> list[str]:
        """A list of names, or a text with blanks between them."""
        given: Value = self.document.values.get(path, list(default))
        self.asked[path] = given
        found = given.split() if isinstance(given, str) else given
        if isinstance(found, Sequence) and all(isinstance(name, str) for name in found):
            return list(map(str, found))
        self.fault(path, Got(shown(given)), "a list of names")
        return list(default)

    def only(self, path: ParameterLocation, modeled: Value) -> None:
        """A parameter with one modeled value: any other is a fault, because the robot would drive differently."""
        found = self.document.values.get(path, modeled)
        self.asked[path] = found
        if found != modeled:
            self.fault(path, Got(f"{shown(found)}, which is not modeled"), shown(modeled))

    def plugins(self, prefix: ParameterLocation, plugins: Plugins) -> list[Instance]:
        """The plug-ins in a list parameter below `prefix`; unknown classes are faults."""
        path, names = self.listed(prefix, plugins)
        found = [self._instance(Used((*prefix, name), (*path, str(k)), plugins, names)) for k, name in enumerate(names)]
        return [each for each in found if each]

    def plugin(self, prefix: ParameterLocation, plugins: Plugins) -> Instance | None:
        """The plug-in that the default behavior trees use; None, with a fault, if it is not modeled."""
        used = self.used(prefix, plugins)
        return self._instance(used) if used else None

    def instance_group(
        self, instance: Instance, elsewhere: Mapping[str, ParameterLocation] | None = None, beside: Sequence[str] = ()
    ) -> Any:
        for name, value in instance.modeled.only.items():
            self.only((*instance.place, name), value)
        kinds = [instance.kind, *beside] if instance.kind in declared_defaults() else ()
        return self.group(instance.modeled.model, instance.place, elsewhere, instance.modeled.fixed, kinds=kinds)

    def used(self, prefix: ParameterLocation, plugins: Plugins) -> "Used | None":
        """The plug-in of a list that the default behavior trees use; an empty list is a fault, and gives None."""
        path, names = self.listed(prefix, plugins)
        if not names:
            self.fault(path, Got("an empty list"), f"the name of a {plugins.what}")
            return None
        used, tree = plugins.used if plugins.used in names else names[0], users_tree(self.document)
        for name in names:
            if name != used:
                self.unused[(*prefix, name)] = f"{used} is used" if tree else f"the default behavior trees use {used}"
        if tree and len(set(names)) > 1:
            words = f"of {len(set(names))} {plugins.what}s {tree} must name one, or Nav2 follows no path"
            self.warnings[path] = words, f"{used} is used, as if {tree} named it"
        is_found = not plugins.asked_for or used in (plugins.used, self.document.controller) or bool(tree)
        if not is_found:
            words = f"Nav2's default behavior trees ask for {plugins.used}, and there is {', '.join(names)}"
            self.warnings[path] = words, f"each {plugins.asked_for}, and missions abort"
        return Used((*prefix, used), (*path, str(names.index(used))), plugins, names, is_found)

    def listed(self, prefix: ParameterLocation, plugins: Plugins) -> tuple[ParameterLocation, list[str]]:
        paths = [(*prefix, name) for name in plugins.lists]
        path = next((path for path in paths if path in self.document.values), paths[0])
        return path, self.names(path, tuple(plugins.defaults))

    def _instance(self, used: "Used") -> Instance | None:
        place, plugins = used.place, used.plugins
        path = (*place, "plugin")
        found = class_name(self.plain(path, used.default_class))
        if modeled := plugins.modeled.get(found):
            self.kinds[place] = short_class(found)
            return Instance(place, self.kinds[place], modeled)
        known = ", ".join(plugins.modeled)
        if not found:
            right = f"name the class of a {plugins.what}: {known}"
            self.fault(used.listed, f"'plugin' is missing below {place[-1]!r}", right)
        elif found in plugins.foreign:
            self.fault(path, f"{found} is not modeled", f"these are: {known}")
        else:
            self.fault(path, f"unknown {plugins.what} {found!r}", f"expected one of {known}")
        return None


class Used(NamedTuple):
    """A name in a list of plug-ins: the place of its parameters, that in the list, and the whole list.

    Attributes:
        is_found: Whether the behavior tree finds it.
    """

    place: ParameterLocation
    listed: ParameterLocation
    plugins: Plugins
    names: Sequence[str]
    is_found: bool = True

    @property
    def default_class(self) -> str:
        """The class of a name without one; Nav2 has it only for the list of its code."""
        defaults = self.plugins.defaults
        return defaults.get(self.place[-1], "") if self.names == list(defaults) else ""


def written(
    group: ParameterGroup,
    prefix: ParameterLocation,
    elsewhere: Mapping[str, ParameterLocation] | None = None,
    given: Collection[str] = (),
) -> Values:
    """Write a group as `Reader.group` reads it, without the fields that are `given`."""
    values: Values = {}
    for name, value in group:
        source = source_of(type(group).model_fields[name])
        if name in given or source.is_derived:
            continue
        path = (elsewhere or {}).get(name, (*prefix, source.name or name))
        if isinstance(value, ParameterGroup):
            values |= written(value, path)
        else:
            values[path] = next((text for text, each in (source.texts or {}).items() if each == value), value)
    return values


def written_plugins(
    prefix: ParameterLocation,
    plugins: Plugins,
    groups: Mapping[str, ParameterGroup],
    elsewhere: Mapping[str, ParameterLocation] | None = None,
) -> Values:
    """A list of plug-ins with a name each, and what `Reader.plugins` reads as their parameters."""
    values: Values = {(*prefix, plugins.lists[0]): list(groups)}
    for name, group in groups.items():
        kind, modeled = next(
            (kind, modeled)
            for kind, modeled in plugins.modeled.items()
            if isinstance(group, modeled.model) and modeled.fixed.items() <= dict(group).items()
        )
        values |= {(*prefix, name, "plugin"): kind, **written(group, (*prefix, name), elsewhere, modeled.fixed)}
    return values


def shown(value: Value) -> str:
    """`value` as the author of a document would know it."""
    if value is None:
        return "nothing"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:59]}…"


def plug_in_name(text: str) -> str:
    """A plug-in as Nav2 writes it today; a file and class as they are written."""
    return text if FILE in text else class_name(text)


def is_group(annotation: object) -> TypeGuard[type[ParameterGroup]]:
    """Whether a field is a group of parameters."""
    return isinstance(annotation, type) and issubclass(annotation, ParameterGroup)
