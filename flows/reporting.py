"""From judged runs to evidence: a campaign directory with its tables, its report, and where both are seen."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vastflow.flows.campaign_run import CampaignRun
from vastflow.flows.request.asked import SEARCH
from vastflow.flows.results.basis import basis_of
from vastflow.flows.results.directory import NewDirectory
from vastflow.flows.results.kept_answer import keep_answer
from vastflow.flows.results.kept_parts import KeptParts, part_source
from vastflow.flows.results.kept_report import KeptReport
from vastflow.flows.results.report_key import report_key
from vastflow.flows.results.results import Assessed, write_report, write_tables
from vastflow.flows.results.summary import Results
from vastflow.flows.search.tables import search_record, write_search
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.tasks.store import store_address

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
