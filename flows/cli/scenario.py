"""The commands about scenario files: `scenario check` and `scenario parameters`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vastflow.flows.terminal.options import command_group

if TYPE_CHECKING:
    from vastflow.sim.scenario.definition import EnumValue, Field, ScenarioDefinition

scenario = command_group("Look at scenario files (.osc, OpenSCENARIO DSL).")

ScenarioArgument = Annotated[Path, typer.Argument(metavar="FILE.osc", help="Scenario file.")]


@scenario.command()
def check(file: ScenarioArgument) -> None:
    """Check a scenario file.

    All faults are reported at once, with their places and what was expected; in a file without faults, each action that
    can't be run here, with the reason.
    """
    from vastflow.sim.model.faults import FileError
    from vastflow.sim.reading.vocabulary import ACTIONS
    from vastflow.sim.scenario.language.reading import read_scenarios
    from vastflow.sim.scenario.tree.support import unsupported

    definitions = read_scenarios(file)
    if lacking := [fault for definition in definitions for fault in unsupported(definition, ACTIONS)]:
        raise FileError(lacking)
    names = [definition.name for definition in definitions]
    print(f"OK: {'scenario' if len(names) == 1 else 'scenarios'} {', '.join(names)}")


@scenario.command()
def parameters(file: ScenarioArgument) -> None:
    """Print the parameters of a file's scenarios as JSON.

    Name, type, whether it is a list, and default in SI units; null if a value is required.
    """
    from vastflow.sim.scenario.language.reading import read_scenarios

    listed = [
        {"scenario": definition.name, "parameters": [_described(definition, one) for one in definition.parameters]}
        for definition in read_scenarios(file)
    ]
    print(json.dumps(listed, indent=2, default=_member))


def _described(definition: "ScenarioDefinition", parameter: "Field") -> dict[str, Any]:
    from vastflow.sim.scenario.language.parameters import default_of

    return {
        "name": parameter.name,
        "type": parameter.type.name,
        "is_list": parameter.type.is_list,
        "default": default_of(definition, parameter.name),
    }


def _member(value: "EnumValue") -> str:
    return value.member
