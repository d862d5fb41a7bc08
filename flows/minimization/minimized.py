"""What a minimization came to."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from vastflow.flows.minimization.candidate_file import FILE
from vastflow.flows.minimization.failing import Failing
from vastflow.flows.minimization.failure_test import FailureTest
from vastflow.producers.minimization.minimize import Minimum

PICTURE: Final = "before-after.png"


@dataclass(frozen=True)
class Minimized:
    """What a minimization came to.

    Attributes:
        text: The campaign file with what is left.
        files: The other files that it needs: place beside it to content.
        picture: PNG of the scenario as it was and as it is in the end.
        runs: That trials and confirmations took.
        executed: Of these, by this call; the others were in the store.
    """

    failing: Failing
    test: FailureTest
    minimum: Minimum
    text: str = field(repr=False)
    files: Mapping[str, bytes] = field(repr=False)
    picture: bytes = field(repr=False)
    runs: int
    executed: int

    def write(self, folder: Path) -> list[Path]:
        """Write the campaign file with all that it needs, and the picture; gives the campaign file and the picture."""
        written = {**self.files, FILE: self.text.encode(), PICTURE: self.picture}
        for place, content in written.items():
            file = folder / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return [folder / FILE, folder / PICTURE]
