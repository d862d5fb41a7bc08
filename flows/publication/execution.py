"""A process that executes recorded runs of a stranger's campaign directory again, and compares them bit for bit."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias

from vastflow.flows.results.trust import executing
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.sim.plug_ins.loading import code_from
from vastflow.sim.replay import first_difference
from vastflow.sim.run import run

Outcome: TypeAlias = Literal["equal", "different"]


def answer(request: Mapping[str, Any]) -> tuple[Outcome, str]:
    """Execute one run again; return the outcome, and the first difference or why there is none to tell.

    Code of the directory is executed if the user permitted it.
    """
    directory, configuration, run_index = Path(request["directory"]), request["configuration"], request["run_index"]
    with executing(directory) if request["permitted"] else code_from(()):
        recorded = recorded_run(directory, configuration, run_index)
        executed = run(recorded.scenario, run_index, recorded.seed)
    difference = first_difference(recorded.recording, executed)
    return ("equal", "") if difference is None else ("different", str(difference))
