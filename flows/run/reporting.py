"""From judged runs to evidence: a campaign directory with its tables, its report, and where both are seen."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.campaign_file import terminal_lines
from vastflow.flows.request.run_request import SEARCH
from vastflow.flows.results.current_report import (
    KEY,
    drawing_digest,
    newest,
    newest_sealed,
    report_key,
    seal,
    written_by,
)
from vastflow.flows.results.directory import NewDirectory
from vastflow.flows.results.kept_report import copy_report, drawn_before, keep_report, kept_report_key
from vastflow.flows.results.results import metadata_of, write_results
from vastflow.flows.results.rows import KeptRows, StoredResult, copies_in
from vastflow.flows.results.summary import Results, summary_of
from vastflow.flows.results.trust import remember_made
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.due import WHY
from vastflow.flows.run.event_log import EventLog, log_end
from vastflow.flows.run.judged import Judged
from vastflow.flows.run.prepared import PreparedCampaign
from vastflow.flows.run.search_tables import search_record, write_search
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.producers.campaign_file.visualization import visualization_of
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.files import read_json
from vastflow.tasks.store.store import StoreError, store_address

_REMOTE_READERS: Final = 16


def write_campaign(run: PreparedCampaign, computing: Computing, judged: Judged, log: EventLog) -> Results:
    """Write the campaign directory of judged runs, and bring it where it belongs.

    Args:
        log: Event log of the directory that the campaign began with.

    Raises:
        Lost: an artifact is damaged or gone; it is computed again where it is asked for again.
        PoolClosed: the campaign was ended.
    """
    engine = computing.engine
    engine.check()
    engine.rest()
    for fault in judged.faults:
        computing.tally.fault(fault.configuration, fault.run_index, fault.stage, fault.error)
    record = _record(run)
    kept = None
    if _is_by_its_source(run):
        kept = KeptRows(run.store, _oracles(run))
        if not judged.faults and not engine.faults:
            record[KEY] = _key(run, computing)

    def report(place: Path) -> Mapping[str, Any]:
        computing.tally.begin("reporting")
        if computing.log.exists():
            (place / "logs").mkdir(exist_ok=True)
            (place / "logs" / "campaign.log").write_bytes(computing.log.read_bytes())
        key = None
        if kept is not None and kept.keys is not None and KEY in record and not run.forced.stages:
            key = kept_report_key(place, _lasting_key(run, computing, record), kept.keys)
        return _report(place, key)

    with log.directory.writing() as place:
        if run.search is not None:
            write_search(place, run.search)
        written = write_judged(run, computing, judged, log.directory, record, report, kept)
    steps = steps_of(run.campaign.spec.results_processing.postprocessing)
    notebooks = visualization_of(run.campaign.spec.evaluation.visualization)
    if steps or notebooks:
        from vastflow.flows.run.postprocess import run_steps

        computing.tally.begin("postprocessing")
        written = run_steps(written, steps, run.campaign.path.parent, notebooks, run.store)
    log_end(log, written)
    remember_made(written.directory)
    results = run.delivery.delivered(written)
    if run.delivery.address is None and not (steps or notebooks) and not written.faults:
        seal(written.directory)
        if KEY in record:
            run.store.put(_complete(record[KEY]), {})
    return results


def write_judged(
    run: PreparedCampaign,
    computing: Computing,
    judged: Judged,
    directory: NewDirectory,
    record: Mapping[str, Any],
    report: Callable[[Path], Mapping[str, Any] | None],
    kept: KeptRows | None = None,
) -> Results:
    """Write the tables of judged runs into a directory, and whatever `report` makes of them.

    Args:
        kept: See `write_results`.

    Raises:
        Lost: an artifact is damaged or gone.
        PoolClosed: the campaign was ended.
    """
    engine = computing.engine
    faults = engine.faults
    is_remote = store_address(run.request.store) is not None
    before = newest(run.delivery.folder, run.name) if is_remote else None  # nothing is asked for that this machine has

    def found(configuration: Configuration) -> StoredResult:
        engine.check()
        own = judged.found[configuration.name]
        theirs = [fault for fault in faults if fault.configuration == configuration.name]
        copies = copies_in(before, configuration.name) if before is not None else None
        return StoredResult(run.store, own.stored, own.configuration.runs, theirs, copies)

    return write_results(
        directory,
        run.campaign,
        run.inputs,
        judged.instantiated.instantiation,
        found,
        runs=judged.runs,
        oracles=_oracles(run),
        keys=run.keys,
        record=record,
        faults=judged.faults,
        created=computing.created,
        work=run.work,
        report=report,
        threads=_REMOTE_READERS if is_remote else 1,
        kept=kept,
    )


def _report(place: Path, key: str | None) -> Mapping[str, Any]:
    """Write the report of a key, possibly an earlier one with the facts of this call, and return its headline."""
    headline = None if key is None else copy_report(place, key)
    if headline is None:
        from vastflow.oracles.page.report import write_lasting

        if key is None:
            headline = write_lasting(place).headline
        else:
            made_by = drawing_digest()
            lasting = write_lasting(place, drawn_before(made_by))
            headline = lasting.headline
            keep_report(place, key, made_by, headline, lasting.drawn)
    from vastflow.oracles.page.call import finish_report

    finish_report(place)
    return headline


def _oracles(run: PreparedCampaign) -> list[str]:
    return [oracle.name for oracle in run.opened.oracles]


def find_current(run: PreparedCampaign, computing: Computing) -> Results | None:
    """The campaign's newest directory, if this run would write the same and the store had everything behind it.

    It costs the same for any number of runs. A forced stage takes the store's word for that away. A campaign with steps of postprocessing
    has none: what they follow from is not known.
    """
    key = _key(run, computing)
    if run.forced.stages:
        run.store.remove([_complete(key)])
    directory = newest_sealed(run.delivery.folder, run.name, key) if run.delivery.address is None else None
    if directory is None or run.store.find(_complete(key)) is None:
        return None
    counts = read_json(directory / "metadata.json")["counts"]
    work = asdict(replace(run.work(), reused=counts["runs"]))
    return Results(directory, summary_of({**counts, **work}, directory), (), tuple(terminal_lines(run.campaign.notes)))


def _complete(key: str) -> str:
    """Key in the store that says that all artifacts behind a report were there."""
    return f"report/{key[:2]}/{key}"


def _record(run: PreparedCampaign) -> dict[str, Any]:
    searched = {} if run.search is None else {SEARCH: search_record(run.search)}
    return {**run.record, WHY: run.due.rows(), **searched}


def _key(run: PreparedCampaign, computing: Computing) -> str:
    metadata = {**metadata_of(run.campaign, run.keys, computing.created), **run.record}
    return report_key(run.keys, run.inputs, metadata, run.opened.oracles, run.store.place)


def _lasting_key(run: PreparedCampaign, computing: Computing, record: Mapping[str, Any]) -> str:
    """Return the digest of all that a report follows from beside tables, without the text of the campaign file."""
    said = repr(run.campaign.spec.metadata).encode()
    lasting = {name: value for name, value in record.items() if name not in (KEY, WHY)}
    metadata = {**metadata_of(run.campaign, run.keys, computing.created), **lasting}
    return report_key(run.keys, replace(run.inputs, campaign=said), metadata, run.opened.oracles, "")


def _is_by_its_source(run: PreparedCampaign) -> bool:
    """Whether the imported source is the one in the key, as it may have been edited since."""
    try:
        if run.keys.sources is not None:
            run.keys.sources.check_since_start(written_by())
    except StoreError:
        return False
    return True
