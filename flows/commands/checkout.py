"""Scripts of the repository, which measure or compare and which no wheel carries."""

import os
import sys
from pathlib import Path
from typing import Final, NoReturn

from vastflow.sim.model.faults import UserError

PROOFS: Final = Path(__file__).resolve().parents[2] / "tests" / "proofs"


def run_script(command: str, name: str, *arguments: object) -> NoReturn:
    """Become a script of `tests/proofs`: it has this process's terminal, its signals and its exit code.

    Args:
        command: The command that the user called, for the message where there is no such script.
    """
    script = PROOFS / f"{name}.py"
    if not script.is_file():
        raise UserError(
            f"vastflow {command}: it runs tests/proofs/{name}.py, which only a clone of vastflow's repository has: "
            "call it there, after `pip install -e .`"
        )
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, str(script), *map(str, arguments)])
