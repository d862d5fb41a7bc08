"""Oracles by their names: of an entry point, `file.py:Class`, or a notebook."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from vastflow.oracles.judgment.notebook import notebook_code, notebook_oracle, read_cells
from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.sim.model.faults import Got, Invalid, Problem, message_of
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import known_plug_ins
from vastflow.sim.plug_ins.snapshot import snapshot_of

GROUP: Final = "vastflow.oracles"
SUCCESS: Final = "success"
"""The oracle of the mission's outcome, which always judges first."""


class OracleFault(NamedTuple):
    """A mistake in the request of an oracle, at keys and indices below its parameters, or in its name."""

    location: tuple[str | int, ...]
    problem: Problem
    expected: str


class OracleError(ValueError):
    """A request that no oracle can be made of, with all faults."""

    def __init__(self, name: str, *faults: OracleFault) -> None:
        self.faults = faults
        lines = (f"{'.'.join(map(str, (name, *at)))}: {message_of(what, right)}" for at, what, right in faults)
        super().__init__("\n".join(lines))


def known_oracles() -> tuple[str, ...]:
    """Names in the entry-point group `vastflow.oracles`, sorted."""
    return tuple(known_plug_ins(GROUP))


def oracle_of(name: str, parameters: Mapping[str, Any], base: Path = Path()) -> Oracle[Any]:
    """The oracle called `name` in the entry-point group, or `file.py:Class` or `notebook.ipynb` relative to `base`.

    Raises:
        OracleError: there is none of this name, or its parameters are wrong.
    """
    found = oracle_class(name, base)
    try:
        with plug_in_code():
            return found(found.Parameters.model_validate(dict(parameters)), name, base)
    except ValidationError as error:
        raise OracleError(name, *(_fault(detail, found.Parameters) for detail in error.errors())) from None
    except Exception as error:
        raise _refused(name, f"it raised {type(error).__name__}: {error}", "") from error


def oracles_of(requests: Sequence[tuple[str, Mapping[str, Any]]], base: Path = Path()) -> tuple[Oracle[Any], ...]:
    """The oracles of a campaign from names and parameters, in their order of judging: `success` always, and first."""
    parameters = dict(requests)
    ordered = {SUCCESS: parameters.get(SUCCESS, {}), **parameters}
    return tuple(oracle_of(name, values, base) for name, values in ordered.items())


def oracle_class(name: str, base: Path = Path()) -> type[Oracle[Any]]:
    """The class called `name`, see `oracle_of`.

    Raises:
        OracleError: there is none of this name.
    """
    if ".py:" in name or name.endswith(".ipynb"):
        found = _class_of_file(name, base)
    elif (entry := known_plug_ins(GROUP).get(name)) is None:
        raise _refused(name, f"unknown oracle {name!r}", did_you_mean(name, known_oracles()))
    else:
        found = entry.load()
    if not (isinstance(found, type) and issubclass(found, Oracle)):
        raise _refused(name, f"{name!r} is not an oracle", f"expected a subclass of {Oracle.__module__}.Oracle")
    return found


def _refused(name: str, what: Problem, right: str) -> OracleError:
    return OracleError(name, OracleFault((), what, right))


def _class_of_file(name: str, base: Path) -> Any:
    file_name, _, class_name = name.rpartition(":") if ".py:" in name else (name, "", "")
    file = base / file_name
    if not is_file(file):
        what = "a Python file" if class_name else "a notebook"
        raise _refused(name, f"there is no file {str(file)!r}", f"expected {what} beside the campaign file")
    try:
        if class_name:
            found = getattr(module_of(snapshot_of(file, base)), class_name, None)
        else:
            read_cells(file)  # a cell that is no Python is named as such
            found = notebook_oracle(snapshot_of(file, base, notebook_code(file)))
    except PlugInError as error:
        raise _refused(name, error.problem, error.expected) from None
    except Exception as error:
        what = f"{str(file)!r} can't be imported: {type(error).__name__}: {error}"
        raise _refused(str(file), what, "") from error
    if found is None:
        raise _refused(name, f"{str(file)!r} has no class {class_name!r}", "expected file.py:Class")
    return found


def _fault(detail: Mapping[str, Any], model: type[Parameters]) -> OracleFault:
    location = tuple(detail["loc"])
    if detail["type"] == "extra_forbidden":
        known = sorted(model.model_fields)
        hint = did_you_mean(str(location[-1]), known, "it takes no keys")
        return OracleFault(location, f"unknown key {location[-1]!r}", hint)
    if isinstance(error := detail.get("ctx", {}).get("error"), Invalid):
        return OracleFault(location, error.problem, error.expected)
    _, begins, expected = str(detail["msg"]).rpartition("Input should be ")
    return OracleFault(location, Got(repr(detail["input"])) if begins else expected, expected if begins else "")
