"""A process that executes recorded runs of a stranger's campaign directory again, and compares them bit for bit.

Its standard input has a line `[configuration, run]` of JSON for each run; it answers each with a line `[outcome, words]`.
"""

import json
import resource
import sys
from pathlib import Path
from typing import Final, Literal, TypeAlias

from vastflow.flows.results.trust import executing
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.sim.model.faults import UserError
from vastflow.sim.plug_ins.loading import code_from
from vastflow.sim.replay import first_difference
from vastflow.sim.run import run

Outcome: TypeAlias = Literal["equal", "different", "unusable"]
_MOST_BYTES: Final = 16 * 2**30
"""Address space of the process; the simulator takes 2 GiB of it."""


def compare_run(directory: Path, configuration: str, run_index: int) -> tuple[Outcome, str]:
    """Execute one run again; return the outcome, and the first difference or why there is none to tell."""
    try:
        recorded = recorded_run(directory, configuration, run_index)
        executed = run(recorded.scenario, run_index, recorded.seed)
    except UserError as error:
        return "unusable", str(error).replace(f"{directory}: ", "")
    except Exception as error:  # noqa: BLE001 - a stranger's scenario or plug-in may raise anything
        return "unusable", f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
    difference = first_difference(recorded.recording, executed)
    return ("equal", "") if difference is None else ("different", str(difference))


def main() -> None:
    """Answer each line of standard input; the first argument is the directory, the second whether its code was permitted."""
    directory, is_permitted = Path(sys.argv[1]), sys.argv[2] == "permitted"
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_BYTES, _MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers, sys.stdout = sys.stdout, sys.stderr  # whatever code prints is no answer
    with executing(directory) if is_permitted else code_from(()):
        for line in sys.stdin:
            print(json.dumps(compare_run(directory, *json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
