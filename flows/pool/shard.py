"""Computation of a bundle on a worker of a pool. Importing it imports Prefect."""

import itertools
import platform
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import platformdirs
from prefect import get_run_logger
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from vastflow.flows.flow_runs.pages import ProgressBar, key_of, tolerated
from vastflow.flows.flow_runs.task_runs import compute, task_runs_of
from vastflow.flows.request.campaign_file import campaign_keys
from vastflow.flows.request.run_request import RunRequest
from vastflow.oracles.judgement.registry import OracleError
from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.index import Index
from vastflow.tasks.engine.pool import Pool, cores
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.remote_shard import Bundle, BundleError, Report, differences, unpacked
from vastflow.tasks.engine.shards import missing_shards
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.prefect.deployment import BAR, OTHER_CODE, STORE_AWAY
from vastflow.tasks.store.store import WRITING_S, Lost, Store, StoreError, open_store, store_address

BEAT_S: Final = 5.0
"""Between two signs of life; without any, the campaign's flow gives the shard to another worker."""

REPORT_BEATS: Final = 3
"""Beats between two parts of a report."""

TASK_RUNS: Final = 8
"""Of a stage that are aimed at: a campaign has many bundles, and each task run costs Prefect's server some milliseconds."""

_FOLDER: Final = "bundles"


def compute_bundle(request: RunRequest, key: str) -> State[Any]:
    """Execute, observe, and judge a bundle's missing runs, and report to the store.

    A worker that can't compute it while another one might ends in a state of that name, see `OTHER_CODE` and `STORE_AWAY`.

    Args:
        request: Of the flow run; names the store as this machine finds it.
        key: Of the bundle.
    """
    place = request.store or ""
    try:
        store = _opened(place)
        with _folder() as folder:
            return _computed(store, unpacked(store, key, folder), request.workers or cores())
    except Lost:
        what = f"{platform.node()} finds no bundle in the store {place!r}"
        return _ended(STORE_AWAY, f"{what}; a folder that all machines share, or an address such as s3://bucket/prefix")
    except StoreError as error:
        return _ended(STORE_AWAY, f"on {platform.node()}: {error}")
    except (BundleError, OracleError) as error:
        return _ended(OTHER_CODE, f"{platform.node()} can't read the bundle: {' '.join(str(error).split())}")


def _computed(store: Store, bundle: Bundle, workers: int) -> State[Any]:
    own = campaign_keys(installed_tree(), bundle.seed, bundle.oracles)
    if others := differences(bundle.promise, own):
        right = "give all workers the campaign's own version of vastflow and its libraries, on one kind of machine"
        return _ended(OTHER_CODE, f"{platform.node()} differs in {', '.join(others)}; {right}")
    log = campaign_log.new_log(store.local / "logs", "shard", datetime.now())
    with campaign_log.own_log(log), ExitStack() as stack:
        # No listing: of a store with 10,000s of artifacts these are few, and a fresh container has copies of no manifest.
        tally = Tally()
        tally.expect({configuration.name: configuration.runs for configuration in bundle.configurations})
        engine = Engine(Index(store, own), Pool(workers, log), tally, bundle.oracles)
        stack.callback(engine.close)
        task_runs = stack.enter_context(task_runs_of(bundle.campaign, engine))
        missing = {name: each for name, each in engine.scan(bundle.configurations).items() if not each.complete}
        wanted, absent = tally.progress().runs_total, sum(each.missing_runs for each in missing.values())
        get_run_logger().info("%d configurations, %d of %d runs to execute", len(bundle.configurations), absent, wanted)
        report = Report(engine, str(flow_run.id))
        with _beating(bundle, tally, report):
            engine.begin(missing.values())
            shards = missing_shards(bundle.configurations, missing, TASK_RUNS)
            compute(task_runs, shards)
        report.add(bundle.configurations, last=True)
    done = tally.progress()
    verdict_counts = f"{done.passed} passed, {done.failed} failed, {done.not_judged} not judged"
    outcome = f"{done.executed} runs executed, {done.simulated_s:.0f} s of simulated time; {verdict_counts}"
    get_run_logger().info("%s", outcome)
    return Completed(message=outcome + _in_words(engine.faults))


def _in_words(faults: Sequence[RunFault]) -> str:
    if not faults:
        return ""
    return f"; {len(faults)} faults, the first of {faults[0].configuration} in {faults[0].stage}: {faults[0].error}"


def _opened(place: str) -> Store:
    """The store; a folder is not made, for then it would not be the one that is shared."""
    if store_address(place) is None and not Path(place).is_dir():
        raise Lost(place)
    return open_store(place)


@contextmanager
def _folder() -> Iterator[Path]:
    """Make a private folder for a bundle's files; remove folders left a day ago."""
    root = Path(platformdirs.user_cache_dir("vastflow")) / _FOLDER
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
    """Publish progress every few seconds on the flow run's page, as a heartbeat, and in the report."""
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
                    report.add(
                        [configuration for configuration in bundle.configurations if configuration.name in through]
                    )

    show()
    thread = threading.Thread(target=beat, name="vastflow beat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
    show()


def _ended(name: str, message: str) -> State[Any]:
    return Failed(name=name, message=message)
