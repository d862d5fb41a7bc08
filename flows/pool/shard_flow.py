"""The flow that a worker of a pool runs: one shard of a campaign, from a bundle in the store to results in the store."""

import itertools
import pickle
import platform
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

from prefect import flow, get_run_logger
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed, Failed
from pydantic import Field

from vastflow.flows.computing.artifacts import ProgressBar, key_of, tolerated
from vastflow.flows.computing.flow_call import entered
from vastflow.flows.computing.processors import cores
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.oracles.oracle import OracleError
from vastflow.tasks import campaign_log
from vastflow.tasks.bundle import Bundle, BundleError, differences, unpacked
from vastflow.tasks.bundle_report import Report
from vastflow.tasks.engine import Engine, MemberFault
from vastflow.tasks.execution.deployment import BAR, OTHER_CODE, SHARD_FLOW, STORE_AWAY
from vastflow.tasks.index import Index
from vastflow.tasks.pool import Pool
from vastflow.tasks.progress import Tally
from vastflow.tasks.shard_run import compute, missing_runs
from vastflow.tasks.source import installed_tree
from vastflow.tasks.store import WRITING_S, Lost, Store, StoreError, open_store, store_address

Text: TypeAlias = Annotated[str, Field(min_length=1)]
Positive: TypeAlias = Annotated[int, Field(ge=1)]

BEAT_S: Final = 5.0
"""Between two signs of life; without any, the campaign's flow gives the shard to another worker."""

REPORT_BEATS: Final = 3
"""Beats between two parts of a report."""

_FOLDER: Final = "bundles"


@flow(name=SHARD_FLOW, persist_result=False)
def run_shard(store: Text, bundle: Text, workers: Positive | None = None) -> State[Any]:
    """Compute a shard of a campaign. Campaigns that are run with this work pool ask for it; nobody else has to.

    Args:
        store: Where the campaign's results are kept, as this machine finds it.
        bundle: Key of what is to be computed.
        workers: Worker processes; one a core if left out.
    """
    try:
        kept = _opened(store)
        with entered(), _folder(kept) as folder:
            return _computed(kept, unpacked(kept, bundle, folder), workers or cores())
    except Lost:
        what = f"{platform.node()} finds no bundle in the store {store!r}"
        return _ended(STORE_AWAY, f"{what}; a folder that all machines share, or an address such as s3://bucket/prefix")
    except StoreError as error:
        return _ended(STORE_AWAY, f"on {platform.node()}: {error}")
    except (BundleError, OracleError) as error:
        return _ended(OTHER_CODE, f"{platform.node()} can't read the bundle: {' '.join(str(error).split())}")


def _computed(kept: Store, bundle: Bundle, workers: int) -> State[Any]:
    own = campaign_keys(installed_tree(), bundle.seed, bundle.oracles)
    if others := differences(bundle.promise, own):
        right = "give all workers the campaign's own version of vastflow and its libraries, on one kind of machine"
        return _ended(OTHER_CODE, f"{platform.node()} differs in {', '.join(others)}; {right}")
    log = campaign_log.new_log(kept.local / "logs", "shard", datetime.now())
    with campaign_log.own_log(log):
        # No survey: of a store with 10,000s of artifacts these are few, and a fresh container has copies of no manifest.
        tally, pool = Tally(), Pool(workers, log)
        engine = Engine(Index(kept, own), pool, tally, pickle.dumps(bundle.oracles))
        tally.expect({member.name: member.runs for member in bundle.members})
        wanted, absent = sum(member.runs for member in bundle.members), missing_runs(engine, bundle.members)
        _say("%d configurations, %d of %d runs to execute", len(bundle.members), absent, wanted)
        report = Report(engine, str(flow_run.id))
        with _beating(bundle, tally, report):
            faults = compute(engine, pool, bundle.members, workers)
        report.add(bundle.members, last=True)
    done = tally.progress()
    verdicts = f"{done.passed} passed, {done.failed} failed, {done.not_judged} not judged"
    outcome = f"{done.executed} runs executed, {done.simulated_s:.0f} s of simulated time; {verdicts}"
    _say("%s", outcome)
    return Completed(message=outcome + _in_words(faults))


def _in_words(faults: Sequence[MemberFault]) -> str:
    if not faults:
        return ""
    return f"; {len(faults)} faults, the first of {faults[0].member} in {faults[0].stage}: {faults[0].error}"


def _opened(place: str) -> Store:
    """The store; a folder is not made, for then it would not be the one that is shared."""
    if store_address(place) is None and not Path(place).is_dir():
        raise Lost(place)
    return open_store(place)


@contextmanager
def _folder(kept: Store) -> Iterator[Path]:
    """A folder for a bundle's files; those that killed flow runs left a day ago go."""
    root = kept.local / _FOLDER
    root.mkdir(parents=True, exist_ok=True)
    for old in root.iterdir():
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > WRITING_S:
                shutil.rmtree(old, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(dir=root)).resolve()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _beating(bundle: Bundle, tally: Tally, report: Report) -> Iterator[None]:
    """Say every few seconds how far it is, on the flow run's page, which is also the sign that it lives, and in its report."""
    ended = threading.Event()
    bar, began_s = ProgressBar(f"{key_of(bundle.campaign)}-{BAR}", str(flow_run.id)), time.monotonic()

    def show() -> None:
        done = tally.progress()
        share = done.runs_done / max(done.runs_total, 1)
        text = f"{done.runs_done} of {done.runs_total} runs judged after {time.monotonic() - began_s:.0f} s"
        with tolerated():
            bar.show(share, text, now=True)

    def beat() -> None:
        for beats in itertools.count(1):
            if ended.wait(BEAT_S):
                return
            show()
            if beats % REPORT_BEATS == 0:
                through = tally.through()
                with suppress(StoreError):  # whoever computes meets it too
                    report.add([member for member in bundle.members if member.name in through])

    show()
    thread = threading.Thread(target=beat, name="vastflow beat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
    show()


def _say(line: str, *values: object) -> None:
    get_run_logger().info(line, *values)


def _ended(name: str, message: str) -> State[Any]:
    return Failed(name=name, message=message)
