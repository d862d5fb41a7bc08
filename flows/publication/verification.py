"""Verification of a publication: digests of all files, and a random sample of runs that are executed again."""

import json
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal
from urllib.parse import unquote

from vastflow.flows.publication.bag import MANIFEST, PAYLOAD, TAG_MANIFEST, Bag
from vastflow.flows.publication.contents import CAMPAIGN
from vastflow.flows.publication.crate import CRATE
from vastflow.flows.publication.prov import FILE, PUBLISHED, SHA256
from vastflow.flows.publication.publish import PROVENANCE
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.headline import percent_text
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import Unreadable, json_value
from vastflow.tasks.engine.child import Child
from vastflow.tasks.store.artifact import FileEntry

FILES: Final = f"{PAYLOAD}{CAMPAIGN}"
LEVEL: Final = 0.95
MOST_SILENT_S: Final = 1800.0
"""Most seconds for one run, the compilation of kernels with it."""
_MOST_BYTES: Final = 16 * 2**30
"""Address space of the process that executes; the simulator takes 2 GiB of it."""
_UNNEEDED: Final = ("figures/", "traces/", "logs/", "outputs/", "postprocessing/")
"""Folders that no execution reads."""

Wrong = Literal["differs", "missing", "extra"]


@dataclass(frozen=True)
class CheckedFiles:
    """The files of an archive as its manifests, its crate, and its provenance have them.

    Attributes:
        equal: Number of files whose digests are those of BagIt's manifests.
        described: Number of digests in crate and provenance that were compared.
        wrong: Name of each wrong file, what is wrong of it, and by which list.
    """

    equal: int
    described: int
    wrong: Sequence[tuple[str, Wrong, str]]


def check_files(bag: Bag, folder: Path | None) -> CheckedFiles:
    """Compare every file with every list of digests, and unpack what an execution needs.

    Args:
        folder: Where the campaign directory is unpacked; None to unpack nothing.

    Raises:
        UnusableArchive: a manifest is missing, too large, or no manifest.
    """
    manifest, tags = bag.manifest(MANIFEST), bag.manifest(TAG_MANIFEST)
    listed = {TAG_MANIFEST, *manifest, *tags}
    found: dict[str, FileEntry | None] = {}
    wrong: dict[str, tuple[Wrong, str]] = {}

    def compare(by: str, digests: Iterable[tuple[str, str]]) -> None:
        for name, sha256 in digests:
            if name not in found:
                wrong.setdefault(name, ("missing", f"listed in {by}"))
            elif (entry := found[name]) is not None and entry.sha256 != sha256:
                wrong.setdefault(name, ("differs", f"by {by}"))

    for name in sorted(bag.files):
        place = name.removeprefix(FILES)
        is_needed = folder is not None and name != place and not place.startswith(_UNNEEDED)
        found[name] = bag.measured(name, folder / place if folder is not None and is_needed else None)
        if found[name] is None:
            wrong[name] = "differs", "its bytes are damaged in the archive"
        elif name not in listed:
            wrong[name] = "extra", "in no manifest"
    compare(MANIFEST, manifest.items())
    compare(TAG_MANIFEST, tags.items())
    described = [] if wrong.keys() & {f"{PAYLOAD}{CRATE}", f"{PAYLOAD}{PROVENANCE}"} else _described(bag)
    compare("crate and provenance", described)
    equal = len(found.keys() - wrong.keys() - {TAG_MANIFEST})
    return CheckedFiles(equal, len(described), [(name, *wrong[name]) for name in sorted(wrong)])


def _described(bag: Bag) -> list[tuple[str, str]]:
    """Return the digests that crate and provenance have; raises `UnusableArchive` if they have another form."""
    try:
        crate, provenance = (json_value(bag.read(f"{PAYLOAD}{name}")) for name in (CRATE, PROVENANCE))
        files = [(f"{PAYLOAD}{unquote(each['@id'])}", each["sha256"]) for each in crate["@graph"] if "sha256" in each]
        entities = [(name, each) for name, each in provenance["entity"].items() if each.get(PUBLISHED)]
        return files + [(f"{FILES}{name.removeprefix(FILE)}", each[SHA256]) for name, each in entities]
    except (Unreadable, LookupError, TypeError, AttributeError) as error:
        raise bag.fault(f"expected digests in {CRATE} and {PROVENANCE}, got {type(error).__name__}: {error}") from None


@dataclass(frozen=True)
class Population:
    """The runs of a campaign directory that an execution can repeat.

    Attributes:
        runs: Configuration and index of each.
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
        by_programs = [each for each in known if each[0] in programs]
        simulated = sorted({*known} - {*by_programs})
        recorded = {name for name, _ in simulated if (directory / "recordings" / f"{name}.parquet").is_file()}
        runs = [each for each in simulated if each[0] in recorded]
        return Population(runs, len(by_programs), len(simulated) - len(runs))


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
    of = len(population.runs)
    equal = sum(each.outcome == "equal" for each in executed)
    different = sum(each.outcome == "different" for each in executed)
    said = (
        f"{len(executed)} of {count_text(of, 'run')} executed again: {equal} equal bit for bit, {different} different"
    )
    if unusable := len(executed) - equal - different:
        said += f", {unusable} could not be executed"
    said += "."
    if executed and equal == len(executed):
        share = undetected_share(len(executed), of)
        said += f" At 95 % confidence, at most {percent_text(share)} of the runs would differ." if share else ""
    if population.programs:
        said += (
            f" Not executed: {count_text(population.programs, 'run')} of programs, which need not repeat their bytes."
        )
    if population.unrecorded:
        said += f" Not compared: {count_text(population.unrecorded, 'run')} without recordings."
    return f"{said} Traces, verdicts, and figures were compared by digest alone."
