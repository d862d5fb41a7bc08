"""The commands about scenario files: `scenario check` and `scenario parameters`."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.terminal.options import command_group

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
    from vastflow.sim.scenario.language.parameters import default_of
    from vastflow.sim.scenario.language.reading import read_scenarios

    listed = []
    for definition in read_scenarios(file):
        described = [
            {
                "name": each.name,
                "type": each.type.name,
                "is_list": each.type.is_list,
                "default": default_of(definition, each.name),
            }
            for each in definition.parameters
        ]
        listed.append({"scenario": definition.name, "parameters": described})
    print(json.dumps(listed, indent=2, default=lambda value: value.member))  # of an enumeration
