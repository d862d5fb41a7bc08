"""The Python API: a campaign from its file to the campaign directory, in one call that blocks."""

import os
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TypeAlias

from vastflow.flows.asked import Asked
from vastflow.flows.campaign_file import read_campaign
from vastflow.flows.campaign_keys import campaign_keys
from vastflow.flows.directory import directory_name
from vastflow.flows.inputs import inputs_of
from vastflow.flows.origin_code import code_row
from vastflow.flows.results import Results, RunFault, campaign_name, write_results
from vastflow.flows.session import Session
from vastflow.flows.summary import Work
from vastflow.producers.faults import CampaignError
from vastflow.tasks import chatter, ending
from vastflow.tasks.instantiation import Instantiator
from vastflow.tasks.progress import Observer, Reporter, Tally
from vastflow.tasks.shelf import Shelf
from vastflow.tasks.source import installed_tree
from vastflow.tasks.store import Lost, StoreError, open_store

CampaignResult: TypeAlias = Results


def run_campaign(
    path: str | os.PathLike[str],
    *,
    runs: int | None = None,
    results: str | os.PathLike[str] | None = None,
    store: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    only: str | Sequence[str] | None = None,
    observer: Observer | None = None,
) -> CampaignResult:
    """Run a campaign and write its report; what is in the store is not computed again.

    Works from a plain script (no `__main__` guard) and from a notebook. Prefect starts only if something is missing.
    Ctrl-C and SIGTERM raise `KeyboardInterrupt`, and end a process that does not end by itself within seconds.

    Args:
        path: The campaign file.
        runs: Runs of each configuration, instead of the file's.
        results: Folder the campaign directory is made in, `results` if not given.
        store: Folder of the store or address such as `s3://bucket/prefix`, else the variable `VASTFLOW_STORE`, else a
            user cache folder.
        workers: Worker processes, else one a core.
        only: Names of families or configurations; nothing else is run.
        observer: Is shown the progress, from one thread.

    Raises:
        CampaignError: faults of the file, or a name in `only` that nothing has.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    if runs is not None and runs < 1:
        raise ValueError(f"runs is at least 1, got {runs}")
    clock = _Clock()
    created = datetime.now()
    tally = Tally()
    with ending.terminable(), Reporter(tally, observer):
        campaign, oracles = read_campaign(Path(path))
        if campaign.unexecutable:
            raise CampaignError(campaign.unexecutable)
        inputs = inputs_of(campaign, oracles)
        kept = open_store(store)
        name = campaign_name(campaign)
        log = chatter.new_log(kept.local / "logs", directory_name(name), created)
        with chatter.own_log(log):
            tree = installed_tree()
            keys = campaign_keys(tree, campaign.seed, oracles)
            selection = [only] if isinstance(only, str) else list(only or ())
            asked = Asked(campaign.path.name, runs or campaign.runs, tuple(selection), inputs.places)
            record = {"asked": asked.as_json(), **code_row(tree, campaign.families, oracles)}
            session = Session(
                title=f"{name} {created:%Y-%m-%d %H:%M:%S}",
                instantiator=Instantiator(campaign, kept, keys, tree),
                shelf=Shelf(kept, keys),
                oracles=oracles,
                runs=asked.runs,
                only=selection,
                workers=workers or _cores(),
                tally=tally,
                prefect_results=kept.local / "prefect",
                log=log,
            )

            def work() -> Work:
                counted = tally.progress()
                return Work(counted.executed, counted.reused, counted.simulated_s, clock.cpu_s(), clock.wall_s())

            def report(directory: Path) -> None:
                from vastflow.oracles.report import write_report

                tally.begin("reporting")
                if log.exists():
                    (directory / "logs").mkdir(exist_ok=True)
                    (directory / "logs" / "campaign.log").write_bytes(log.read_bytes())
                write_report(directory)

            for _ in range(_TRIES):
                instantiation = session.complete()
                try:
                    return write_results(
                        Path(results or "results"),
                        campaign,
                        inputs,
                        instantiation,
                        session.found,
                        runs=session.runs,
                        oracles=[oracle.name for oracle in oracles],
                        keys=keys,
                        record=record,
                        faults=[RunFault("", None, fault.stage, fault.error) for fault in session.campaign_faults],
                        created=created,
                        work=work,
                        report=report,
                    )
                except Lost:  # found out when it was read: the damaged artifact is gone now, so it gets computed
                    continue
            raise StoreError(f"store: {kept.place!r} loses what is written to it; is the disk full or broken?")


_TRIES = 3


class _Clock:
    """Time since it was made: on the wall, and of the CPU for this process and its children that have ended."""

    def __init__(self) -> None:
        self._began_s = time.perf_counter()
        self._before_s = sum(os.times()[:4])

    def wall_s(self) -> float:
        return time.perf_counter() - self._began_s

    def cpu_s(self) -> float:
        return sum(os.times()[:4]) - self._before_s


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
