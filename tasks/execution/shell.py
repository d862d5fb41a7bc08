"""A command between the script that is sourced before it and the one that runs after it."""

import shlex
from collections.abc import Sequence

BASH = "/bin/bash"
"""Scripts to be sourced, such as ROS's `setup.bash`, are written for it."""


def wrapped(command: Sequence[str], pre_command: str | None, post_command: str | None) -> tuple[str, ...]:
    """`command`, after `pre_command` has been sourced and before `post_command` runs.

    Exit code: the command's own, whatever the script after it does. Where the script before it fails, the command does not
    run and the code is the script's. SIGTERM reaches the command, and the script after it still runs.

    Args:
        pre_command, post_command: Paths in the container; None where there is none.
    """
    if not command:
        raise ValueError("the command of an image is not known outside of it and can't be wrapped")
    if pre_command is None and post_command is None:
        return tuple(command)
    lines = [] if pre_command is None else [f". {shlex.quote(pre_command)} || exit"]
    if post_command is None:
        lines.append(f"exec {shlex.join(command)}")
    else:
        lines += [
            "trap 'kill -TERM $!' TERM",
            f"{shlex.join(command)} &",
            "wait $!",
            "status=$?",
            # A signal ends `wait`, not the command.
            "while kill -0 $! 2>/dev/null; do wait $!; status=$?; done",
            shlex.quote(post_command),
            "exit $status",
        ]
    return BASH, "-c", "\n".join(lines)
