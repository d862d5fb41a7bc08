"""What steps of postprocessing made, as a folder of the campaign directory has it: files, and what was said of each step."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from vastflow.sim.model.digest import file_digest

FOLDER: Final = "postprocessing"
STEPS: Final = "steps.json"


@dataclass(frozen=True)
class Processed:
    """One step.

    Attributes:
        outcome: `failed` is a fault of the step, never one of a run.
        message: What it says of itself, or why it failed.
        files: Place below the results' copy to the digest of each file that it wrote.
        key: Digest of all that the files follow from; empty where nothing may be reused.
    """

    name: str
    outcome: Literal["done", "failed", "recorded", "not executed"]
    message: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    key: str = ""


def write_processed(directory: Path, steps: list[Processed]) -> None:
    """Say in the campaign directory what became of the steps."""
    text = json.dumps({"steps": [asdict(step) for step in steps]}, indent=2, ensure_ascii=False) + "\n"
    (directory / FOLDER).mkdir(exist_ok=True)
    (directory / FOLDER / STEPS).write_text(text, encoding="utf-8", errors="backslashreplace")


def earlier(directory: Path, key: str) -> tuple[Path, Processed] | None:
    """A folder of another campaign directory beside this one with the files of a step of this key, the newest there is."""
    for folder in sorted(directory.parent.glob(f"*/{FOLDER}"), key=lambda each: each.parent.name[-20:], reverse=True):
        for step in _steps(folder / STEPS):
            if step.key == key and step.outcome == "done" and _whole(folder, step):
                return folder, step
    return None


def _steps(file: Path) -> Iterator[Processed]:
    try:
        rows = json.loads(file.read_text(encoding="utf-8"))["steps"]
        yield from [Processed(**row) for row in rows]
    except (OSError, ValueError, KeyError, TypeError):
        return


def _whole(folder: Path, step: Processed) -> bool:
    """Whether its files are there as they were written: a user may have edited them."""
    return all((folder / name).is_file() and file_digest(folder / name) == own for name, own in step.files.items())
