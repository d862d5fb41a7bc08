"""The failed run of a campaign directory that is reported, as a campaign of its own that repeats it."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from vastflow.flows.analysis.candidate_file import FILE as MINIMAL
from vastflow.flows.analysis.candidate_file import candidate_files
from vastflow.flows.analysis.failing import MESH_KEY, Failing, failing_configuration
from vastflow.flows.failure.small_map import with_small_map
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.provenance import versions
from vastflow.oracles.judgment.verdict import Judgment, run_judgment
from vastflow.oracles.query.frames import facts_of, stored_run
from vastflow.oracles.replay.recorded import RecordedRun, recorded_run
from vastflow.oracles.results.schema import read_columns
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.minimization.minimize import Candidate, NotBuilt
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_bytes
from vastflow.sim.model.recording import Outputs, Recording
from vastflow.sim.plug_ins.loading import code_from
from vastflow.sim.replay import Difference, first_difference
from vastflow.sim.run import run
from vastflow.sim.system.keys import FILE_KEY, RECORDING_KEY
from vastflow.sim.system.system import system_of

CAMPAIGN: Final = "campaign.vast"
RECORDING: Final = "recording.parquet"


@dataclass(frozen=True)
class FailedRun:
    """A failed run.

    Attributes:
        failing: Its configuration; its oracle is the first one that failed the run.
        facts: See `facts_of`.
        failed, judged: Runs of the configuration.
        parameters: Parameters of robot and Nav2 that the campaign sets, and those of its Nav2 file that differ from the defaults.
        nav2_file: Name of a Nav2 parameter file that keys can't express; there are no `parameters` beside it.
    """

    recorded: RecordedRun
    failing: Failing
    facts: Mapping[str, Any] = field(repr=False)
    failed: int
    judged: int
    parameters: Mapping[str, Any] = field(repr=False)
    nav2_file: str = ""

    @property
    def run_index(self) -> int:
        return self.recorded.recording.run.run_index

    @property
    def rate_text(self) -> str:
        """Share of the configuration's runs that failed, with the interval of confidence."""
        bounds = interval(clopper_pearson_intervals(self.failed, self.judged))
        share = f"{100 * self.failed / self.judged:.0f} %, 95 % interval {100 * bounds.low:.0f} to {100 * bounds.high:.0f} %"
        return f"{self.failed} of {self.judged} runs ({share})"

    def files(self) -> dict[str, bytes]:
        """Return the campaign of the run with its files and its recording, by place; it repeats the run.

        The map is whole: the random numbers of a run follow from the map's cells.

        Raises:
            UnusableDirectory: the configuration can't be written as a campaign.
        """
        whole = Candidate(frozenset(each for each in self.failing.subject.circumstances if each.can_be_left_out))
        name = f"{self.recorded.configuration}, run {self.run_index}, of {self.failing.directory.resolve().name}"
        with candidate_files(self.failing) as folder:
            try:
                built = folder.built(whole, self.run_index + 1, f"# {name}\n\n")
            except NotBuilt as error:
                place = f"{self.failing.directory}: {self.failing.name}"
                raise UnusableDirectory(f"{place} can't be built from its inputs: {error}") from None
            text = built.text.replace("-minimal\n", "\n", 1).replace("- name: minimal", "- name: failure", 1)
            files = {**built.inputs.files, CAMPAIGN: text.encode()}
        files.pop(MINIMAL, None)
        return with_small_map(files) | {RECORDING: write_recordings([self.recorded.recording])}


def failed_run(directory: Path, configuration: str, run_index: int) -> FailedRun:
    """Read a failed run.

    Raises:
        UnusableDirectory: an unknown configuration or run, one that did not fail, has no robot, was imported, or is on a floor plan,
            or a damaged directory.
    """
    recorded = recorded_run(directory, configuration, run_index)
    name, place = recorded.configuration, f"{directory}: {configuration}/{run_index}"
    with reading(directory):
        said: dict[int, list[Judgment]] = {}
        for row in read_columns(directory / "verdicts.parquet").to_pylist():
            if row["configuration"] == name:
                said.setdefault(row["run_index"], []).append(row["judgment"])
    together = {index: run_judgment(judgments) for index, judgments in sorted(said.items())}
    failed = [index for index, judgment in together.items() if judgment == "fail"]
    if recorded.judgment != "fail":
        got = "passed" if recorded.judgment == "pass" else "was not judged"
        others = f"Runs {', '.join(map(str, failed[:8]))} of it failed." if failed else "None of its runs failed."
        raise UnusableDirectory(f"{place}: expected a run that failed, got one that {got}. {others}")
    if not recorded.recording.columns:
        raise UnusableDirectory(
            f"{place}: expected a run of a robot, got one of programs alone, which need not repeat. "
            f"`vastflow export` with `--only {configuration}` writes what they printed and wrote."
        )
    if recorded.scenario.programs is not None and recorded.scenario.programs.nodes is not None:
        raise UnusableDirectory(
            f"{place}: expected a run of the built-in stack, got one that nodes drove, which need not repeat. "
            f"`vastflow export` with `--only {configuration}` writes its recording, logs, and messages."
        )
    if RECORDING_KEY in recorded.scenario.system:
        raise UnusableDirectory(f"{place}: expected a simulated run, got an imported one, which nobody can repeat")
    if MESH_KEY in recorded.scenario.environment:
        what = "a run on a map, got one on a floor plan: its random numbers follow from the mesh too, which no campaign file can name"
        raise UnusableDirectory(f"{place}: expected {what}")
    facts = facts_of(stored_run(directory, configuration, run_index), configuration)
    oracle = next(each["oracle"] for each in facts["verdicts"] if each["judgment"] == "fail")
    failing = failing_configuration(directory, name, oracle, 0.0)
    execution = {**(failing.campaign.get("execution") or {}), "seed": recorded.seed}
    failing = replace(failing, campaign={**failing.campaign, "execution": execution})
    system = system_of(recorded.scenario.system)
    spelled, assumed = system.spelled_out(), system.assumed_keys()
    judged = sum(each != "not judged" for each in together.values())
    own, file = {key: value for key, value in spelled.items() if key not in assumed}, spelled.get(FILE_KEY)
    if isinstance(file, FileContent):
        return FailedRun(recorded, failing, facts, len(failed), judged, {}, Path(file.path).name)
    return FailedRun(recorded, failing, facts, len(failed), judged, own)


def repeat_run(folder: Path, trust: bool = True) -> tuple[Recording, Difference | None]:
    """Execute the run of a reported failure again; return its recording, and how the executed one differs.

    Args:
        trust: False to execute no code of the folder.

    Raises:
        UserError: the folder has no such run, or needs code that is not trusted.
    """
    with reading(folder), nullcontext() if trust else code_from(()):
        try:
            (recorded,) = read_recordings(read_bytes(folder / RECORDING))
        except ValueError as error:
            raise UserError(f"{folder}: expected the folder of a reported failure: {error}") from None
        campaign, _ = read_campaign(folder / CAMPAIGN)
        made = instantiate(campaign).configurations
        if len(made) != 1:
            raise UserError(f"{folder / CAMPAIGN}: expected one configuration, got {len(made)}")
        executed = run(made[0].scenario, recorded.run.run_index, campaign.seed)
    executed = replace(executed, behaviors=recorded.behaviors, outputs=Outputs())  # which the file does not have
    return recorded, first_difference(recorded, executed)


def check_repeats(folder: Path, failed: FailedRun) -> None:
    """Raise `UnusableDirectory` unless the campaign in a folder gives the recorded run, byte for byte."""
    _, difference = repeat_run(folder)
    if difference is not None:
        place = f"{failed.failing.directory}: {failed.recorded.configuration}/{failed.run_index}"
        made = versions(failed.recorded.metadata, same_origin=False)
        raise UnusableDirectory(
            f"{place}: expected a run that repeats, but executed here it differs: {difference} ({made})"
        )
