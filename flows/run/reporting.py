"""From judged runs to evidence: a campaign directory with its tables, its report, and where both are seen."""

import importlib.metadata
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.asked import SEARCH
from vastflow.flows.results.answer import Basis, keep_answer
from vastflow.flows.results.cached_report import REPORT_LIBRARIES, KeptParts, KeptReport, part_source, report_key
from vastflow.flows.results.directory import NewDirectory
from vastflow.flows.results.inputs import Inputs
from vastflow.flows.results.results import Assessed, write_report, write_tables
from vastflow.flows.results.summary import Results
from vastflow.flows.run.campaign_run import CampaignRun
from vastflow.flows.search.tables import search_record, write_search
from vastflow.oracles.judgement.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.sim.nav2.controllers.registry import CONTROLLER_PLUG_INS
from vastflow.sim.nav2.parameter_files.parameter_file import plug_ins_in
from vastflow.sim.nav2.planners.registry import PLANNER_PLUG_INS
from vastflow.sim.plug_ins.loading import OWN, snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot
from vastflow.sim.world.noise_registry import NOISE_PLUG_INS
from vastflow.tasks.engine.evaluation import content_of, producers_in
from vastflow.tasks.keys.source import NUMERIC_LIBRARIES, live_source
from vastflow.tasks.store.store import store_address

_LIBRARIES: Final = frozenset(
    {"vastflow", "prefect", *REPORT_LIBRARIES, *(name for of in NUMERIC_LIBRARIES.values() for name in of)}
)


def basis_of(campaign: Campaign, oracles: Iterable[Oracle[Any]], inputs: Inputs) -> Basis | None:
    """What a run of `campaign` follows from; None where that can't be told from files.

    So it is where programs are run, where files are missing that may come, and of plug-ins that are no Python files beside the campaign or
    use modules that are installed nowhere.
    """
    if campaign.programs is not None or campaign.unavailable:
        return None
    if steps_of(campaign.spec.results_processing.postprocessing):
        return None
    installed = (
        entry for kind in (CONTROLLER_PLUG_INS, NOISE_PLUG_INS, PLANNER_PLUG_INS) for entry in kind.known.values()
    )
    if not all(entry.module.startswith(OWN) for entry in installed):
        return None
    snapshots: list[Snapshot] = []
    for plug_in in (*_producers(campaign), *oracles):
        if (snapshot := snapshot_behind(type(plug_in))) is not None:
            snapshots.append(snapshot)
        elif not type(plug_in).__module__.startswith(OWN):
            return None
    varied = (content_of(producer.parameters) for producer in _producers(campaign))
    for file in plug_ins_in([*(dict(family.values) for family in campaign.families), *varied]):
        snapshots += file.plug_ins.values()
    outside = {top for snapshot in snapshots for top in snapshot.outside}
    if any(not each.entry.endswith(".py") for each in snapshots) or any(map(live_source, outside)):
        return None
    plug_ins = sorted({os.path.abspath(each.origin / each.entry) for each in snapshots})
    return Basis(inputs.read, plug_ins, sorted(_LIBRARIES | _installed(outside)))


def _producers(campaign: Campaign) -> Iterator[Any]:
    for family in campaign.families:
        for producer in family.producers:
            yield from (producer, *producers_in(producer.parameters))


def _installed(outside: Iterable[str]) -> set[str]:
    """The distributions that have these modules."""
    others = [top for top in outside if top not in NUMERIC_LIBRARIES]
    known = importlib.metadata.packages_distributions() if others else {}
    return {name for top in others for name in known.get(top, [top])}


_LOCAL_READERS: Final = 1
_REMOTE_READERS: Final = 16


def assess(run: CampaignRun, directory: NewDirectory) -> Assessed:
    """Write what all runs come to into the campaign directory: recordings, traces, verdicts and tables.

    Raises:
        Lost: an artifact is damaged or gone; it is computed again where it is asked for again.
    """
    assert run.instantiated is not None
    run.engine.rest()
    instantiation = run.instantiated.instantiation
    whole = not run.campaign_faults and not run.engine.faults

    def kept(metadata: Mapping[str, Any]) -> KeptReport:
        contents, campaign = run.contents(), run.inputs.campaign
        key = report_key(
            run.keys, run.tree, campaign, metadata, instantiation, contents.values(), run.runs, run.oracles
        )
        return KeptReport(
            run.store, key, run.keys.sources, KeptParts(run.store, run.keys, part_source(run.tree), contents)
        )

    record = run.record
    if run.search is not None:
        write_search(directory.partial, run.search)
        record = {**record, SEARCH: search_record(run.search)}
    return write_tables(
        directory,
        run.campaign,
        run.inputs,
        instantiation,
        run.result_of,
        runs=run.runs,
        oracles=[oracle.name for oracle in run.oracles],
        keys=run.keys,
        record=record,
        faults=run.campaign_faults,
        created=run.created,
        work=lambda: run.work,
        kept=kept if whole else None,
        threads=_LOCAL_READERS if store_address(run.request.store) is None else _REMOTE_READERS,
    )


def report(run: CampaignRun, assessed: Assessed) -> Results:
    """Write evidence, figures and report of a campaign directory, and its log."""
    run.tally.begin("reporting")
    if run.log.exists():
        logs = assessed.directory.partial / "logs"
        logs.mkdir(exist_ok=True)
        (logs / "campaign.log").write_bytes(run.log.read_bytes())
    return write_report(assessed, _report, lambda: run.work)


def deliver(run: CampaignRun, written: Results) -> Results:
    """Run the campaign file's steps of postprocessing over the finished directory, and bring it where it belongs.

    Where nothing can make another of it, the same request is answered with it the next time.
    """
    if steps := steps_of(run.campaign.spec.results_processing.postprocessing):
        from vastflow.flows.postprocessing.postprocess import postprocessed

        run.tally.begin("postprocessing")
        written = postprocessed(written, steps, run.campaign.path.parent)
    run.results = run.delivery.delivered(written)
    if run.delivery.address is None and (basis := basis_of(run.campaign, run.oracles, run.inputs)) is not None:
        keep_answer(run.request, basis, run.results, run.created.timestamp())
    return run.results


def _report(directory: Path) -> None:
    from vastflow.oracles.page.report import write_report as write_page

    write_page(directory)
