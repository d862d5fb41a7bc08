"""Child processes with limits: a question as JSON on their standard input, an answer as JSON on their output."""

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final

from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import python_command

PROBLEM: Final = "problem"
"""Key of an answer that is a sentence for the user."""


def ask(module: str, question: Mapping[str, Any], wall_s: float, environment: Mapping[str, str], what: str) -> Any:
    """Return the answer of a module in a process of its own, which is killed after `wall_s`, its start included.

    Raises:
        UserError: the child's problem, or `what` ended at a limit.
    """
    pipe = subprocess.PIPE
    child = subprocess.Popen(
        python_command(module), stdin=pipe, stdout=pipe, stderr=pipe, cwd="/", env=environment, start_new_session=True
    )
    try:
        said, wrong = child.communicate(json.dumps(question).encode(), timeout=wall_s)
    except subprocess.TimeoutExpired:
        raise UserError(f"{what} takes more than {wall_s:g} s. Ask for less.") from None
    finally:
        child.kill()
        child.communicate()
    try:
        answer = json.loads(said)
    except ValueError:
        print(wrong.decode(errors="replace"), file=sys.stderr)
        raise UserError(f"{what} needs more memory than it may have, or ended its process. Ask for less.") from None
    if PROBLEM in answer:
        raise UserError(" ".join(str(answer[PROBLEM]).split()))
    return answer


def answer_as_child(answer: Callable[[Any], Mapping[str, Any]], memory_bytes: int, *, writes: bool = False) -> None:
    """Read the question of `ask`, and write its answer, with at most so much address space; user errors are problems.

    Args:
        writes: Whether the process may write files.
    """
    out, sys.stdout = sys.stdout, sys.stderr
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if not writes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    try:
        said = answer(json.load(sys.stdin))
    except UserError as error:
        said = {PROBLEM: str(error)}
    json.dump(said, out, allow_nan=False)
    out.flush()
