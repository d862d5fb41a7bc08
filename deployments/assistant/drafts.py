"""Campaign files of an assistant: methods that are tools, which plan and run them in child processes."""

import os
import re
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Final, TypeAlias

from pydantic import Field

from vastflow.deployments.explorer.directories import CampaignDirectory
from vastflow.sim.model.faults import FileError, UserError
from vastflow.sim.model.files import copy_file, files_below, yaml_value
from vastflow.tasks.engine.child import Child, NoAnswer
from vastflow.tasks.engine.process import own_environment, python_command

WALL_S: Final = 90.0
MEMORY_BYTES: Final = 8_000_000_000
MOST_TEXT: Final = 200_000
MOST_RUNS: Final = 2_000
"""Runs of a campaign that an assistant starts, of all configurations together."""
_MOST_FAULTS: Final = 40
_END_S: Final = 10.0
_BETWEEN: Final = re.compile(r"[\s'\",;:=()\[\]{}<>|]+")
_TOPIC: Final = re.compile(r"/\w+")
_FILE: Final = "campaign.vast"

Text: TypeAlias = Annotated[str, Field(max_length=MOST_TEXT, description="Content of a campaign file (YAML).")]
FilesOf: TypeAlias = Annotated[
    str,
    Field(description="Campaign whose input files the text may name; empty: the user's workspace, if one is served."),
]
Runs: TypeAlias = Annotated[
    int, Field(ge=0, le=MOST_RUNS, description="Runs of each configuration; 0: as in the text.")
]


class Drafts:
    """Campaign files of an assistant; methods raise `UserError`.

    Args:
        find: Finds a campaign directory by its id.
        workspace: Folder of files that they may name.
        results: Folder for their results; None if the user does not allow to run them. Then none of their code is executed.
    """

    def __init__(self, find: Callable[[str], CampaignDirectory], workspace: Path | None, results: Path | None) -> None:
        self._find, self._workspace, self._results = find, workspace, results
        self._folder = TemporaryDirectory(prefix="vastflow-")
        self._process: subprocess.Popen[bytes] | None = None

    def plan_campaign(self, text: Text, files_of: FilesOf = "", runs: Runs = 0) -> dict[str, Any]:
        """Validate and plan a campaign file without running it: faults with places, notes, number of configurations and runs."""
        found = self._planned(self._laid_out(text, files_of), runs)
        step = (
            "run_campaign(…) with this text" if self._results else "the user saves the text and calls vastflow run FILE"
        )
        return {**found, "next_step": step if found["valid"] else "mend the faults, and call plan_campaign again"}

    def run_campaign(self, text: Text, files_of: FilesOf = "", runs: Runs = 0) -> dict[str, Any]:
        """Run a campaign file in the background, if it is small; `campaigns` shows its progress and its end."""
        if self._process is not None and self._process.poll() is None:
            raise UserError("expected the end of the campaign that is still running, which `campaigns` shows")
        file = self._laid_out(text, files_of)
        found = self._planned(file, runs)
        if not found["valid"]:
            raise UserError(f"text: {found['faults'][0]}")
        if (most := found["runs_in_all"]) > MOST_RUNS:
            raise UserError(f"text: expected at most {MOST_RUNS:,} runs of all configurations together, got {most:,}")
        words = ["run", str(file), "--results", str(self._results), *(["--runs", str(runs)] if runs else [])]
        command, nothing = python_command("vastflow.flows.cli", *words), subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdin=nothing, stdout=nothing, env=own_environment())
        told = {name: found[name] for name in ("configurations", "runs_in_all", "estimate_s")}
        return {**told, "next_step": "campaigns(limit=1), which is this one once it has begun"}

    def close(self) -> None:
        """End what still runs; what it computed is in the store."""
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_S)
            self._process.kill()
        self._folder.cleanup()

    def _planned(self, file: Path, runs: int) -> dict[str, Any]:
        question = {"file": str(file), "runs": runs, "permitted": self._results is not None}
        with Child(f"{__name__}:plan", memory_bytes=MEMORY_BYTES) as child:
            try:
                found: dict[str, Any] = child.ask(question, WALL_S)
            except NoAnswer as error:
                raise UserError(f"plan: {error}. Ask for less.") from None
        found["cut"] = []
        for name in ("faults", "notes"):
            # The file lies in a folder of a moment.
            said = [
                each.replace(f"{file.parent}{os.sep}", "").replace("--trust", "--allow-run") for each in found[name]
            ]
            found[name] = said[:_MOST_FAULTS]
            found["cut"] += [f"{len(said) - _MOST_FAULTS:,} more {name}"] * (len(said) > _MOST_FAULTS)
        return found

    def _laid_out(self, text: str, files_of: str) -> Path:
        """Write a campaign file beside what it may name: copies of a campaign's inputs, or links into the workspace."""
        folder = Path(self._folder.name, str(time.monotonic_ns()))
        folder.mkdir()
        if files_of:
            inputs = self._find(files_of).path / "inputs"
            for each in files_below(inputs):
                copy_file(each, folder / each.relative_to(inputs))
        for each in self._workspace.iterdir() if self._workspace and not files_of else ():
            (folder / each.name).symlink_to(each)
        (file := folder / _FILE).unlink(missing_ok=True)
        try:
            value = yaml_value(text)
            file.write_text(text, encoding="utf-8")
        except ValueError as error:
            raise UserError(f"text: expected a campaign file in YAML: {error}") from None
        roots = [Path(os.path.realpath(each)) for each in (folder, *([self._workspace] if self._workspace else []))]
        if outside := next((name for name in _names(value) if not _is_within(name, folder, roots)), None):
            where = "the campaign's inputs" if files_of else "the workspace"
            raise UserError(f"text: expected names of files in {where}, got {outside[:100]!r}")
        return file


def _names(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield from (value, *_BETWEEN.split(value))
    elif isinstance(value, Mapping | list):
        for each in (*value.keys(), *value.values()) if isinstance(value, Mapping) else value:
            yield from _names(each)


def _is_within(name: str, folder: Path, roots: list[Path]) -> bool:
    """True if a name leads below `roots`, is a topic of ROS, or has several lines."""
    if "\n" in name:
        return True  # its words are looked at
    with suppress(OSError, ValueError):
        place = Path(os.path.realpath(folder / name))
        is_topic = _TOPIC.fullmatch(name) is not None and not place.exists()
        return not name.startswith("~") and (is_topic or any(place.is_relative_to(root) for root in roots))
    return False


def plan(question: Mapping[str, Any]) -> dict[str, Any]:
    """Plan a campaign file in the process of its own."""
    from vastflow.flows.plan.plan import plan_of
    from vastflow.flows.plan.text import plan_json
    from vastflow.flows.request.campaign_file import read_campaign
    from vastflow.flows.request.run_request import request_of
    from vastflow.oracles.results.coverage import COUNTS, counts, parts
    from vastflow.sim.plug_ins.loading import code_from

    file = Path(question["file"])
    with nullcontext() if question["permitted"] else code_from(()), TemporaryDirectory(prefix="vastflow-") as folder:
        try:
            notes = [*map(str, read_campaign(file)[0].notes)]
            found = plan_of(request_of(file, {"runs": question["runs"] or None}), Path(folder), None)
        except FileError as error:
            return {"valid": False, "faults": [*map(str, error.faults)], "notes": []}
        told = plan_json(found, _FILE)
        names = ("faults", "configurations", "runs", "at_most", "stages", "estimate_s")
        return {
            "valid": not told["faults"],
            "notes": notes,
            **{name: told[name] for name in names},
            "runs_in_all": told["configurations"] * told["runs"],
            "families": {name: dict(zip(COUNTS, counts(part), strict=True)) for name, part in parts(found.coverage)},
            "power": [each["text"] for each in told["power"]],
        }
