"""Reading parameters out of a document, with account of what was asked for, what was used and what was wrong."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError

from vastflow.sim.model.digest import Value
from vastflow.sim.model.rates import held_hz
from vastflow.sim.nav2.parameter_files.document import ParameterDocument, ParameterFault, dotted
from vastflow.sim.nav2.parameter_files.plugins import Plugins, class_name
from vastflow.sim.nav2.parameters.parameter import ParameterLocation, code_default, complaints

RATES: Final = frozenset({"controller_frequency", "update_frequency", "publish_frequency"})
"""Parameters whose loops run in whole numbers of ticks."""

Group = TypeVar("Group", bound=BaseModel)

Parts: TypeAlias = Mapping[str, Any]
"""Fields of `NavParameters`."""


@dataclass(frozen=True, slots=True)
class Instance:
    """A plug-in that a document loads: its name there, and what its class is called here."""

    name: str
    kind: str


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
            if name not in values:
                path = paths[name] = (elsewhere or {}).get(name, (*prefix, name))
                values[name] = self.document.values.get(
                    path, code_default(field) if left_out is None else getattr(left_out, name)
                )
                self.fields[path] = model, name
        try:
            group = model.model_validate(values)
        except ValidationError as error:
            self._faults_of(model, error, paths)
            return model.model_construct(**values)
        self.asked |= {path: getattr(group, name) for name, path in paths.items()}
        for name in RATES & paths.keys():
            if abs(held_hz(found := getattr(group, name)) - found) > 1e-6 * found:
                self.asked[paths[name]] = self.held[paths[name]] = round(held_hz(found), 3)
        return group

    def _faults_of(
        self, model: type[BaseModel], error: ValidationError, paths: Mapping[str, ParameterLocation]
    ) -> None:
        for name, right in complaints(model, error):
            if name:
                self.fault(paths[name], f"found {shown(self.document.values.get(paths[name]))}", right)
                continue
            named = re.findall(r"\w+", right)
            path = next((path for name, path in paths.items() if name in named), ())
            what = f"found parameters that contradict each other: {right}"
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
            self.fault(path, f"found {shown(given)}", "a list of names")
            found = list(default)
        self.asked[path] = given
        return [str(name) for name in found]

    def only(self, path: ParameterLocation, modeled: Value) -> None:
        """A parameter of which one value is modeled: another is a fault, for the robot would drive otherwise."""
        found = self.document.values.get(path, modeled)
        self.asked[path] = found
        if found != modeled:
            self.fault(path, f"found {shown(found)}, which is not modeled", shown(modeled))

    def _plain(self, path: ParameterLocation, default: Value, kind: type, meaning: str) -> Value:
        found = self.document.values.get(path, default)
        if not isinstance(found, kind):
            self.fault(path, f"found {shown(found)}", meaning)
            found = default
        self.asked[path] = found
        return found

    def plugins(self, prefix: ParameterLocation, plugins: Plugins) -> list[Instance]:
        """The plug-ins that a list parameter below `prefix` names; those of unknown classes are faults."""
        path = self._list_of(prefix, plugins)
        names = self.names(path, tuple(plugins.defaults))
        found = [(name, self._kind(prefix, name, (*path, str(k)), plugins)) for k, name in enumerate(names)]
        return [Instance(name, kind) for name, kind in found if kind]

    def plugin(self, prefix: ParameterLocation, plugins: Plugins) -> Instance | None:
        """The one that the default behavior trees use; None without one that is modeled, which is a fault."""
        used = self.used(prefix, plugins)
        kind = self._kind(prefix, *used, plugins) if used else None
        return Instance(used[0], kind) if used and kind else None

    def used(self, prefix: ParameterLocation, plugins: Plugins) -> tuple[str, ParameterLocation] | None:
        """Name of the plug-in that the default behavior trees use, and where the list has it; None for an empty list, a fault."""
        path = self._list_of(prefix, plugins)
        names = self.names(path, tuple(plugins.defaults))
        if not names:
            self.fault(path, "found an empty list", f"the name of a {plugins.what}")
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
        """What `name` of a list is without a class of its own; Nav2 has one only where the list is that of its code."""
        defaults = plugins.defaults
        return defaults.get(name, "") if self.names(listed[:-1], tuple(defaults)) == list(defaults) else ""

    def _list_of(self, prefix: ParameterLocation, plugins: Plugins) -> ParameterLocation:
        paths = [(*prefix, name) for name in plugins.lists]
        return next((path for path in paths if path in self.document.values), paths[0])

    def _kind(self, prefix: ParameterLocation, name: str, listed: ParameterLocation, plugins: Plugins) -> str | None:
        path = (*prefix, name, "plugin")
        found = class_name(self.text(path, self.default_class(name, listed, plugins)))
        if kind := plugins.modeled.get(found):
            self.kinds[path[:-1]] = kind
            return kind
        known = ", ".join(plugins.modeled)
        if not found:
            self.fault(listed, f"no 'plugin' below {name!r}", f"the class of a {plugins.what}; known: {known}")
        elif found in plugins.foreign:
            self.fault(path, f"{found} is not modeled", f"a {plugins.what} that is: {known}")
        else:
            self.fault(path, f"no {plugins.what} {found!r} is known", f"known: {known}")
        return None


def shown(value: Value) -> str:
    """`value` as the author of a document would know it."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:59]}…"
