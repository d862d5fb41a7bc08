"""Exit codes of the command line, beside 0 and those that a command says of itself."""

from typing import Final

BAD_INPUT: Final = 2
"""A mistake that the user can mend; also where the command line itself is wrong."""
FAULT: Final = 3
"""Something broke: a run, a worker, Prefect, a plug-in."""
