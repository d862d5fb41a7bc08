"""Options and fixtures of all tests: quick and slow ones, golden files, servers and workers of Prefect."""

import contextlib
import difflib
import gc
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest
import yaml
from hypothesis import settings

# A change is judged by what it changes, not by the examples of the day; `--hypothesis-profile=other` looks for new ones, and
# `--hypothesis-seed=N` with it for those of a seed. Deadlines are of wall time: they fail on a machine that others use.
settings.register_profile("same", derandomize=True, deadline=None, max_examples=50)
settings.register_profile("other", deadline=None)
settings.load_profile("same")

API_S = 300
"""Most seconds until an API answers, on a machine that others use."""
GOLDEN = Path(__file__).with_name("golden")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect tests without garbage collection, which takes a sixth of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run only the tests that are marked slow, and not the others")
    parser.addoption("--update-golden", action="store_true", help="write the faults of tests/golden anew; with -n 0")


def pytest_ignore_collect(collection_path, config):
    """Do not import files without a slow test only to deselect all that is in them."""
    if config.getoption("slow") and collection_path.name.startswith("test_"):
        return "pytest.mark.slow" not in collection_path.read_text(encoding="utf-8") or None
    return None


def pytest_collection_modifyitems(config, items):
    """Select the quick tests, or with --slow the slow ones."""
    wanted, others = [], []
    for item in items:
        (wanted if bool(item.get_closest_marker("slow")) == config.getoption("slow") else others).append(item)
    config.hook.pytest_deselected(items=others)
    items[:] = wanted


def pytest_configure(config):
    """The tests' processes have a Prefect of their own: not the user's, and not another worker's of pytest-xdist.

    Caches are the user's: what is in them is named by its content, and the compiled kernels take a minute to make.
    """
    folder = tempfile.TemporaryDirectory(prefix="vastflow-tests-", ignore_cleanup_errors=True)
    config.add_cleanup(folder.cleanup)
    os.environ["PREFECT_HOME"] = str(Path(folder.name, "prefect"))
    os.environ["XDG_STATE_HOME"] = str(Path(folder.name, "state"))  # what this user made and permitted


@pytest.hookimpl(tryfirst=True)
def pytest_report_teststatus(report):
    """Report skipped rows of a case; pytest drops skipped subtests where it doesn't show those that passed."""
    if isinstance(report, pytest.SubtestReport) and report.skipped and not hasattr(report, "wasxfail"):
        return "skipped", "s", f"SUBSKIPPED [{report.context.msg}]"
    return None


class GoldenDumper(yaml.SafeDumper):
    """YAML that shows texts of several lines as they are."""


GoldenDumper.add_representer(
    str,
    lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None),
)


def golden_text(sections):
    return yaml.dump(sections, Dumper=GoldenDumper, sort_keys=False, allow_unicode=True, width=10**6)


@pytest.fixture
def golden(request):
    """Compare the faults of each input in a section of a language's golden file with those that the file holds.

    To add an input, write it there without `faults` and run its test with `--update-golden`.
    """

    def compare(language, section, faults_of, key="faults"):
        file = GOLDEN / f"{language}.yaml"
        expected = yaml.safe_load(file.read_text(encoding="utf-8"))
        found = {**expected, section: [{**case, key: faults_of(case["input"])} for case in expected[section]]}
        assert [case["input"] for case in found[section] if not case[key]] == [], f"expected {key}, got none"
        texts = [golden_text(sections).splitlines() for sections in (expected, found)]
        if request.config.getoption("update_golden"):
            file.write_text(golden_text(found), encoding="utf-8")
        elif texts[0] != texts[1]:
            diff = difflib.unified_diff(*texts, "expected", "got", lineterm="", n=5)
            pytest.fail("\n".join([f"{file.name}, {section}:", *diff]), pytrace=False)

    return compare


@pytest.fixture(scope="session")
def loops():
    """Measure the CPU time of a call in empty loops of a million rounds, the least of some tries.

    A slow or busy machine is slow for both. A bound leaves a factor of four all the same.
    """

    def empty_loop():
        for _ in range(1_000_000):
            pass

    def cpu_s(work):
        began_s = time.process_time()
        work()
        return time.process_time() - began_s

    def measured(work, tries=3):
        return min(cpu_s(work) / max(cpu_s(empty_loop), cpu_s(empty_loop)) for _ in range(tries))

    return measured


@pytest.fixture(scope="session")
def prefect_home(tmp_path_factory):
    """Make a folder a home of Prefect with an empty database, which takes a server 6 CPU-s."""
    from vastflow.tasks.prefect.server import ApiServer, PrefectUnavailable

    template = tmp_path_factory.mktemp("prefect") / "prefect.db"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_HOME", str(template.parent))
        server = ApiServer(template.with_name("server.log"))
        with contextlib.suppress(PrefectUnavailable):  # the server of the test makes it, or says why not
            server.url(API_S)
        server.stop(30)

    def made(folder):
        folder.mkdir(exist_ok=True)
        if template.exists():
            with (
                contextlib.closing(sqlite3.connect(template)) as kept,
                contextlib.closing(sqlite3.connect(folder / "prefect.db")) as new,
            ):
                kept.backup(new)
        return folder

    return made


@pytest.fixture(scope="session")
def one_server(prefect_home):
    """Give campaigns of this process one embedded API over the database in a folder.

    The first campaign starts it, as it would without; later ones find it started, and none ends it.
    """
    from vastflow.flows.run import flow_call

    @contextlib.contextmanager
    def shared(home):
        servers = []

        class Shared:
            def __init__(self, log):
                if not servers:
                    servers.append(flow_call_server(log))

            def __getattr__(self, name):
                return getattr(servers[0], name)

            def stop(self, grace_s=3.0):
                """Keep the server for later campaigns."""

        flow_call_server = flow_call.ApiServer
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PREFECT_HOME", str(home if home.exists() else prefect_home(home)))
            patch.delenv("PREFECT_API_URL", raising=False)
            patch.setattr(flow_call, "ApiServer", Shared)
            yield
        for server in servers:
            server.stop()

    return shared


@pytest.fixture(scope="session")
def started_api(prefect_home):
    """Start an API over the database in a folder, and configure it in that context.

    Gives a client of it.
    """
    from prefect.client.orchestration import get_client
    from prefect.settings import temporary_settings

    from vastflow.tasks.prefect.adapter import end_services, unsent
    from vastflow.tasks.prefect.server import ApiServer, PrefectUnavailable

    @contextlib.contextmanager
    def started(home, log):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PREFECT_HOME", str(home if home.exists() else prefect_home(home)))
            server = ApiServer(log)
            try:
                url = server.url(API_S)
            except PrefectUnavailable as error:
                server.stop(0)
                pytest.fail(str(error))
            try:
                patch.setenv("PREFECT_API_AUTH_STRING", server.auth)  # for workers and commands
                settings = temporary_settings({"api.url": url, "api.auth_string": server.auth})
                with settings, get_client(sync_client=True) as client:
                    yield client
            finally:
                end_services(
                    1.0
                )  # else later campaigns of this process send their events to this server, which is gone
                assert unsent() == 0
                server.stop()

    return started


@pytest.fixture(scope="session")
def started_worker():
    """Start a worker of a work pool in a folder of its own, and end all its processes afterwards."""

    @contextlib.contextmanager
    def started(api, folder, pool="lab", limit=2, **variables):
        folder.mkdir(exist_ok=True)
        environment = {
            **os.environ,
            "PREFECT_API_URL": str(api.api_url),
            "PREFECT_HOME": str(folder / "prefect"),
            "PREFECT_WORKER_QUERY_SECONDS": "1",
            **variables,
        }
        command = [sys.executable, "-m", "prefect", "worker", "start", "--pool", pool, "--limit", str(limit)]
        with open(folder / "log", "wb") as log:
            worker = subprocess.Popen(
                command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        try:
            yield worker
        finally:
            below = psutil.Process(worker.pid).children(recursive=True) if worker.poll() is None else []
            worker.send_signal(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                worker.wait(5)
            for process in below:
                with contextlib.suppress(psutil.Error):
                    process.kill()
            worker.kill()
            worker.wait(10)

    return started
