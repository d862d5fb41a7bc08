"""Verification of a publication: digests of all files, and a random sample of runs that are executed again."""

import json
import random
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from vastflow.flows.publication.bag import MANIFEST, PAYLOAD, TAG_MANIFEST, Bag
from vastflow.flows.publication.contents import CAMPAIGN
from vastflow.flows.publication.crate import CRATE
from vastflow.flows.publication.publish import PROVENANCE
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.headline import percent_text
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import json_value
from vastflow.tasks.engine.child import Child

FILES: Final = f"{PAYLOAD}{CAMPAIGN}"
LEVEL: Final = 0.95
MOST_SILENT_S: Final = 1800.0
"""Most seconds for one run, the compilation of kernels with it."""
_MOST_BYTES: Final = 16 * 2**30
"""Address space of the process that executes; the simulator takes 2 GiB of it."""
_UNNEEDED: Final = ("figures/", "traces/", "logs/", "outputs/", "postprocessing/")
"""Folders that no execution reads."""


def check_files(bag: Bag, folder: Path | None) -> tuple[int, dict[str, str]]:
    """Compare each file with manifests, crate, and provenance; return the number of equal ones and what is wrong of others.

    Args:
        folder: Where what an execution needs of the campaign directory is unpacked; None to unpack nothing.

    Raises:
        UserError: a manifest is missing, too large, or no manifest.
    """
    listed = bag.manifest(MANIFEST) | bag.manifest(TAG_MANIFEST)
    wrong = dict.fromkeys(listed.keys() - bag.files.keys(), "missing")
    found: dict[str, str] = {}
    for name in bag.files:
        place = name.removeprefix(FILES)
        is_needed = folder is not None and name != place and not place.startswith(_UNNEEDED)
        entry = bag.measured(name, folder / place if folder is not None and is_needed else None)
        found |= {} if entry is None else {name: entry.sha256}
        if name not in listed and name != TAG_MANIFEST:
            wrong[name] = "extra"
        elif entry is None or entry.sha256 != listed.get(name, entry.sha256):
            wrong[name] = "differs"
    for description, digests in ((CRATE, _crated), (PROVENANCE, _proven)):
        name = f"{PAYLOAD}{description}"
        if name not in found or name in wrong:
            continue
        try:
            promised = digests(json_value(bag.archive.read(bag.files[name])))
        except (ValueError, TypeError, AttributeError, KeyError):
            wrong[name] = "no description of files"
        else:
            differ = (each for each, digest in promised.items() if found.get(each) != digest)
            wrong |= {each: f"not as {description} has it" for each in differ if each not in wrong}
    return len(bag.files.keys() - wrong.keys() - {TAG_MANIFEST}), dict(sorted(wrong.items()))


def _crated(crate: Any) -> dict[str, str]:
    files = (each for each in crate["@graph"] if "sha256" in each)
    return {f"{PAYLOAD}{unquote(each['@id'])}": each["sha256"] for each in files}


def _proven(provenance: Any) -> dict[str, str]:
    files = {name: each for name, each in provenance["entity"].items() if each.get("vastflow:published")}
    return {f"{FILES}{name.removeprefix('file:')}": each["vastflow:sha256"] for name, each in files.items()}


@dataclass(frozen=True)
class Population:
    """The runs of a campaign directory that an execution can repeat, as configurations and indices, and numbers of the others.

    Attributes:
        programs: Number of runs of programs, which need not write the same bytes twice.
        unrecorded: Number of runs whose recordings were left out.
    """

    runs: Sequence[tuple[str, int]] = field(repr=False)
    programs: int
    unrecorded: int


def population_of(directory: Path) -> Population:
    """Return the runs that can be executed again; raises `UnusableDirectory` if the tables are damaged."""
    with reading(directory):
        rows = table_rows(directory / "configurations.parquet", "name", "scenario")
        programs = {row["name"] for row in rows if "programs" in json.loads(row["scenario"])}
        known = [(str(row["configuration"]), int(row["run_index"])) for row in table_rows(directory / "runs.parquet")]
        simulated = sorted({each for each in known if each[0] not in programs})
        recorded = {name for name, _ in simulated if (directory / "recordings" / f"{name}.parquet").is_file()}
        runs = [each for each in simulated if each[0] in recorded]
        by_programs = sum(name in programs for name, _ in known)
        return Population(runs, by_programs, len(simulated) - len(runs))


def sample_of(runs: Sequence[tuple[str, int]], number: int | None, seed: int) -> list[tuple[str, int]]:
    """Return `number` distinct runs drawn by a seed, all of them for None, in order."""
    if number is None or number >= len(runs):
        return [*runs]
    return sorted(random.Random(seed).sample(runs, number))


def undetected_share(drawn: int, of: int) -> float:
    """Return the greatest share of wrong runs that a sample without one leaves possible, at 95 %.

    The sample is drawn without replacement: the count of wrong ones in it is hypergeometric, and the bound is the greatest count W of
    wrong runs for which C(of - W, drawn) / C(of, drawn), the probability of drawing none, is at least 5 %.
    """
    wrong, probability = 0, 1.0
    while wrong < of - drawn:
        probability *= (of - wrong - drawn) / (of - wrong)
        if probability < 1 - LEVEL:
            break
        wrong += 1
    return wrong / of if of else 1.0


@dataclass(frozen=True, slots=True)
class ExecutedRun:
    """A run that was executed again: `equal`, `different`, or `unusable`, and in words why."""

    configuration: str
    run_index: int
    outcome: str
    words: str


def execute_again(directory: Path, runs: Sequence[tuple[str, int]], permitted: bool) -> Iterator[ExecutedRun]:
    """Execute runs again in a process of its own, and yield each once it is compared.

    Args:
        permitted: Whether the user permitted the code of the directory; without it none is executed.
    """
    with Child("vastflow.flows.publication.execution:answer", folder=directory, memory_bytes=_MOST_BYTES) as child:
        for configuration, run_index in runs:
            about = {"configuration": configuration, "run_index": run_index, "permitted": permitted}
            try:
                outcome, words = child.ask({"directory": str(directory), **about}, MOST_SILENT_S)
            except UserError as error:
                outcome, words = "unusable", str(error).replace(f"{directory}: ", "")
            yield ExecutedRun(configuration, run_index, str(outcome), str(words))


def shown_text(population: Population, executed: Sequence[ExecutedRun]) -> str:
    """Return in one paragraph what an execution has shown, and what not."""
    of, outcomes = len(population.runs), Counter(each.outcome for each in executed)
    counts = f"{outcomes['equal']} equal bit for bit, {outcomes['different']} different"
    counts += f", {outcomes['unusable']} could not be executed" if outcomes["unusable"] else ""
    said = [f"{len(executed)} of {count_text(of, 'run')} executed again: {counts}."]
    if executed and outcomes["equal"] == len(executed) and (share := undetected_share(len(executed), of)):
        said.append(f"At 95 % confidence, at most {percent_text(share)} of the runs would differ.")
    if number := population.programs:
        said.append(f"Not executed: {count_text(number, 'run')} of programs, which need not repeat their bytes.")
    if number := population.unrecorded:
        said.append(f"Not compared: {count_text(number, 'run')} without recordings.")
    return " ".join([*said, "Traces, verdicts, and figures were compared by digest alone."])
