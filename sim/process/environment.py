"""The environment of a run's programs: this process' own, what the campaign adds, and what its `pre_command` exports."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from vastflow.sim.process.guard import VARIABLE
from vastflow.sim.process.process import Ended, NotStarted, ProcessGroup
from vastflow.sim.scenario_error import ScenarioError

COMMAND_TIMEOUT_S: Final = 600.0
"""Host time that `pre_command` and `post_command` may take."""
_NOT_TAKEN: Final = ("_", "SHLVL", "PWD", "OLDPWD", VARIABLE)
"""What says where the shell itself was, and which group it belonged to."""
_SOURCE: Final = """\
vastflow_result=$1 vastflow_script=$2
shift 2
source "$vastflow_script" "$@" || exit
command env -0 >"$vastflow_result"
"""

Start = Callable[[Sequence[str], Mapping[str, str], str], ProcessGroup]
"""Starts a command in an environment under a label, as `vastflow.sim.process.run.ProcessRun` does."""


class CommandFailed(ScenarioError):
    """The campaign's `pre_command` did not do what it should: the run can't begin, and is not judged."""


def sourced(
    command: Sequence[str],
    environment: Mapping[str, str],
    result: Path,
    start: Start,
    timeout_s: float = COMMAND_TIMEOUT_S,
) -> dict[str, str]:
    """`environment` as it is after bash has sourced a script in it; what the script started meanwhile runs on.

    Args:
        command: The script and its arguments.
        result: File to pass it through; it is removed again.

    Raises:
        CommandFailed: no bash, an exit code other than 0, or no end in time.
    """
    script = Path(command[0])
    try:
        group = start(["bash", "-c", _SOURCE, "bash", str(result), *command], environment, "pre_command")
    except NotStarted as error:
        raise CommandFailed(f"pre_command: {error}") from None
    ended = finished(group, timeout_s)
    if ended.reason:
        group.log.complete.wait(0.2)
        last = group.log.last_line()
        raise CommandFailed(f"pre_command {script.name!r} {ended.reason}" + (f": {last}" if last else ""))
    if not result.exists():
        raise CommandFailed(f"pre_command {script.name!r} left the shell that sources it; it must not call exit")
    entries = [os.fsdecode(entry).partition("=") for entry in result.read_bytes().split(b"\0") if entry]
    result.unlink()
    return {name: value for name, _, value in entries if name not in _NOT_TAKEN}


def finished(group: ProcessGroup, timeout_s: float) -> Ended:
    """How the program of `group` ended, by itself or because it was killed after `timeout_s`."""
    if (ended := group.wait(timeout_s)) is not None:
        return ended
    ended = group.stop(timeout_s=0.0)
    return Ended(ended.code, ended.signal, True, f"took longer than {timeout_s:g} s and was killed")
