"""Reading parameters from a document, with a record of what was asked for, used and wrong; and writing them."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeGuard, TypeVar

from pydantic import BaseModel, ValidationError

from vastflow.sim.model.digest import Value
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation, complaints, source_of
from vastflow.sim.model.rates import held_hz
from vastflow.sim.nav2.parameter_files.document import ParameterDocument, ParameterFault, dotted
from vastflow.sim.nav2.parameter_files.nodes import PluginClass, Plugins, class_name, short_class
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import FILE, Registry

RATES: Final = frozenset({"controller_frequency", "update_frequency", "publish_frequency"})
"""Parameters whose loops run in whole numbers of ticks."""

Group = TypeVar("Group", bound=BaseModel)

Parts: TypeAlias = Mapping[str, Any]
"""Fields of `NavParameters`."""


Values: TypeAlias = dict[ParameterLocation, Value]


@dataclass(frozen=True, slots=True)
class Instance:
    """A plug-in that a document loads: its place, its class without the package, and what is modeled."""

    place: ParameterLocation
    kind: str
    modeled: PluginClass

    @property
    def name(self) -> str:
        """Its name in the list."""
        return self.place[-1]


class Reader:
    """Reads one document.

    Attributes:
        asked: Paths of all parameters that are looked at, present or not, with the value that is taken.
        fields: Paths of those that are fields of a group, with the group's model and the field's name.
        kinds: Path of a group to what it is, for what of it is not asked for.
        unmodeled: Path of a group that is not read because it is not modeled, to why.
        unused: Path of a group that is not read because Nav2 would not read it either, to why.
        held: Path of a rate that is no whole number of ticks, to the rate (Hz) that is taken.
        faults: Everything wrong.
    """

    def __init__(self, document: ParameterDocument) -> None:
        self.document = document
        self.asked: dict[ParameterLocation, Value] = {}
        self.fields: dict[ParameterLocation, tuple[type[BaseModel], str]] = {}
        self.kinds: dict[ParameterLocation, str] = {}
        self.unmodeled: dict[ParameterLocation, str] = {}
        self.unused: dict[ParameterLocation, str] = {}
        self.held: dict[ParameterLocation, float] = {}
        self.faults: list[ParameterFault] = []

    def fault(self, path: ParameterLocation, what: str, right: str) -> None:
        """Note a mistake at `path`, once however often it is met."""
        fault = ParameterFault(dotted(path), what, right, self.document.place(path))
        if fault not in self.faults:
            self.faults.append(fault)

    def group(
        self,
        model: type[Group],
        prefix: ParameterLocation,
        elsewhere: Mapping[str, ParameterLocation] | None = None,
        given: Mapping[str, Any] | None = None,
        left_out: Group | None = None,
    ) -> Group:
        """The parameters below `prefix`; those the document leaves out are as in `left_out`, or as in Nav2's code.

        What is wrong becomes faults, and then the values mean nothing.

        Args:
            elsewhere: Parameter to the path it has where that is not below `prefix`.
            given: Values that are not to be read.
        """
        values: dict[str, Any] = dict(given or {})
        paths: dict[str, ParameterLocation] = {}
        for name, field in model.model_fields.items():
            source = source_of(field)
            if name in values or source.is_derived:
                continue
            path = (elsewhere or {}).get(name, (*prefix, source.name or name))
            if is_group(field.annotation):
                known = len(self.faults)
                found = self.group(field.annotation, path)
                values[name] = found if len(self.faults) == known else field.default
            elif source.texts:
                values[name] = self._choice(path, source.texts)
            else:
                usual = getattr(left_out, name, field.default if source.code is None else source.code)
                values[name] = self.document.values.get(path, usual)
                paths[name] = path
                self.fields[path] = model, name
        try:
            group = model.model_validate(values)
        except ValidationError as error:
            self._faults_of(model, error, paths)
            return model.model_construct(**values)
        self.asked |= {path: getattr(group, name) for name, path in paths.items()}
        for name, path in paths.items():
            if name in RATES and abs(held_hz(hz := getattr(group, name)) - hz) > 1e-6 * hz:
                self.asked[path] = self.held[path] = round(held_hz(hz), 3)
            if (needs := source_of(model.model_fields[name]).needs) and getattr(group, needs[0]) != needs[1]:
                self.leave(path, needs[2])
        return group

    def _choice(self, path: ParameterLocation, texts: Mapping[str, Any]) -> Any:
        usual = next(iter(texts))
        found = class_name(self.text(path, usual))
        if found not in texts:
            self.fault(path, f"got {shown(found)}", f"one of {', '.join(texts)}")
        return texts.get(found, texts[usual])

    def plug_in(
        self,
        plug_ins: Registry[Any],
        foreign: Collection[str],
        text: str,
        path: ParameterLocation,
        listed: ParameterLocation,
    ) -> type[ParameterGroup] | None:
        """The parameters of the plug-in that `text` at `path` names; None where there is none, which is a fault."""
        known, noun, document = ", ".join(plug_ins.known), plug_ins.noun, self.document
        name = plug_in_name(text)
        if not name:
            right = f"the class of a {noun}; known: {known}; {plug_ins.own}"
            self.fault(listed, f"no {path[-1]!r} below {path[-2]!r}", right)
            return None
        if name in foreign:
            self.fault(path, f"{name} is not modeled", f"a {noun} that is: {known}; {plug_ins.own}")
            return None
        try:
            return plug_ins.parameters(name, Path(document.file).parent, document.plug_ins.get(name))
        except PlugInError as error:
            self.fault(path, error.what, error.right)
            return None

    def own_group(
        self, kind: type[Group], place: ParameterLocation, others: Collection[ParameterLocation] = ()
    ) -> Group:
        """Read the parameters of a plug-in and of groups in them; report unknown ones as faults."""
        self._check_names(kind, place, others)
        return self.group(kind, place)

    def _check_names(
        self, kind: type[BaseModel], place: ParameterLocation, others: Collection[ParameterLocation] = ()
    ) -> None:
        for path in self.document.below(place):
            name = path[len(place)]
            if name not in kind.model_fields and path not in others:
                what = f"{kind.__name__} has no parameter {name!r}"
                self.fault(path, what, did_you_mean(name, kind.model_fields, "none, for it has no parameters"))
        for name, field in kind.model_fields.items():
            if is_group(field.annotation):
                self._check_names(field.annotation, (*place, name))

    def _faults_of(
        self, model: type[BaseModel], error: ValidationError, paths: Mapping[str, ParameterLocation]
    ) -> None:
        for name, right in complaints(model, error):
            if name:
                self.fault(paths[name], f"got {shown(self.document.values.get(paths[name]))}", right)
                continue
            named = re.findall(r"\w+", right)
            path = next((path for name, path in paths.items() if name in named), ())
            what = f"got parameters that contradict each other: {right}"
            place = self.document.place(path)
            self.faults.append(ParameterFault(dotted(path), what, "values that agree", place, together=True))

    def leave(self, path: ParameterLocation, why: str) -> None:
        """Take back that a parameter was asked for: it has no effect beside others."""
        self.asked.pop(path, None)
        self.fields.pop(path, None)
        self.unused[path] = why

    def flag(self, path: ParameterLocation, default: bool) -> bool:
        """A flag that is no field of a group."""
        return bool(self._plain(path, default, bool, "true or false"))

    def text(self, path: ParameterLocation, default: str) -> str:
        """A text."""
        return str(self._plain(path, default, str, "text"))

    def names(self, path: ParameterLocation, default: Sequence[str]) -> list[str]:
        """A list of names, or a text with blanks between them."""
        given: Value = self.document.values.get(path, list(default))
        found = given.split() if isinstance(given, str) else given
        if not isinstance(found, Sequence) or not all(isinstance(name, str) for name in found):
            self.fault(path, f"got {shown(given)}", "a list of names")
            found = list(default)
        self.asked[path] = given
        return [str(name) for name in found]

    def only(self, path: ParameterLocation, modeled: Value) -> None:
        """A parameter of which one value is modeled: another is a fault, for the robot would drive otherwise."""
        found = self.document.values.get(path, modeled)
        self.asked[path] = found
        if found != modeled:
            self.fault(path, f"got {shown(found)}, which is not modeled", shown(modeled))

    def _plain(self, path: ParameterLocation, default: Value, kind: type, meaning: str) -> Value:
        found = self.document.values.get(path, default)
        if not isinstance(found, kind):
            self.fault(path, f"got {shown(found)}", meaning)
            found = default
        self.asked[path] = found
        return found

    def plugins(self, prefix: ParameterLocation, plugins: Plugins) -> list[Instance]:
        """The plug-ins that a list parameter below `prefix` names; those of unknown classes are faults."""
        path = self._list_of(prefix, plugins)
        names = self.names(path, tuple(plugins.defaults))
        found = [self._instance((*prefix, name), (*path, str(k)), plugins) for k, name in enumerate(names)]
        return [each for each in found if each]

    def plugin(self, prefix: ParameterLocation, plugins: Plugins) -> Instance | None:
        """The one that the default behavior trees use; None without one that is modeled, which is a fault."""
        used = self.used(prefix, plugins)
        return self._instance((*prefix, used[0]), used[1], plugins) if used else None

    def plugin_group(self, prefix: ParameterLocation, plugins: Plugins) -> Any:
        """The parameters of that one."""
        found = self.plugin(prefix, plugins)
        return found and self.instance_group(found)

    def instance_group(self, instance: Instance, elsewhere: Mapping[str, ParameterLocation] | None = None) -> Any:
        """The parameters of a plug-in."""
        for name, value in instance.modeled.only.items():
            self.only((*instance.place, name), value)
        return self.group(instance.modeled.model, instance.place, elsewhere, instance.modeled.fixed)

    def used(self, prefix: ParameterLocation, plugins: Plugins) -> tuple[str, ParameterLocation] | None:
        """Return name and place of the plug-in that the default behavior trees use.

        An empty list is a fault, and gives None.
        """
        path = self._list_of(prefix, plugins)
        names = self.names(path, tuple(plugins.defaults))
        if not names:
            self.fault(path, "got an empty list", f"the name of a {plugins.what}")
            return None
        used = plugins.used if plugins.used in names else names[0]
        for name in names:
            if name != used:
                self.unused[(*prefix, name)] = f"the default behavior trees use {used}"
        if plugins.is_asked_for and used != plugins.used:
            why = f"the default behavior trees ask for {plugins.used}, which Nav2 would not find; {used} is used"
            self.unmodeled[path] = why
        return used, (*path, str(names.index(used)))

    def default_class(self, name: str, listed: ParameterLocation, plugins: Plugins) -> str:
        """Default class of a name without one; Nav2 has it only for the list of its code."""
        defaults = plugins.defaults
        return defaults.get(name, "") if self.names(listed[:-1], tuple(defaults)) == list(defaults) else ""

    def _list_of(self, prefix: ParameterLocation, plugins: Plugins) -> ParameterLocation:
        paths = [(*prefix, name) for name in plugins.lists]
        return next((path for path in paths if path in self.document.values), paths[0])

    def _instance(self, place: ParameterLocation, listed: ParameterLocation, plugins: Plugins) -> Instance | None:
        path = (*place, "plugin")
        found = class_name(self.text(path, self.default_class(place[-1], listed, plugins)))
        if modeled := plugins.modeled.get(found):
            self.kinds[place] = short_class(found)
            return Instance(place, self.kinds[place], modeled)
        known = ", ".join(plugins.modeled)
        if not found:
            self.fault(listed, f"no 'plugin' below {place[-1]!r}", f"the class of a {plugins.what}; known: {known}")
        elif found in plugins.foreign:
            self.fault(path, f"{found} is not modeled", f"a {plugins.what} that is: {known}")
        else:
            self.fault(path, f"no {plugins.what} {found!r} is known", f"known: {known}")
        return None


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
        values[(*prefix, name, "plugin")] = kind
        values |= written(group, (*prefix, name), elsewhere, modeled.fixed)
    return values


def shown(value: Value) -> str:
    """`value` as the author of a document would know it."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:59]}…"


def plug_in_name(text: str) -> str:
    """A plug-in as Nav2 writes it today; a file and class as they are written."""
    return text if FILE in text else class_name(text)


def is_group(annotation: object) -> TypeGuard[type[ParameterGroup]]:
    """Whether a field is a group of parameters."""
    return isinstance(annotation, type) and issubclass(annotation, ParameterGroup)
