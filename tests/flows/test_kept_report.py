"""The report as an artifact: made once for the same results, and given back with the facts of the call that asks."""

import json
import subprocess
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest
from whole_directory import write_results

from vastflow.flows import run_campaign
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.cached_report import KeptReport
from vastflow.flows.results.found import ConfigurationResult, RunFault
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.summary import Work
from vastflow.oracles.judgement.verdict import Metric, Verdict
from vastflow.oracles.page.work_section import with_work
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import manifest_of
from vastflow.tasks.store.store import StoreError, open_store

KEYS = Keys("x86_64; glibc 2.36; avx2 fma; ", "e" * 64, "o" * 64, "j" * 64, 0, [])
KEY = "report/ab/abc"
LOG = json.dumps({"runs": [{"run_index": 0, "wall_s": 1.0}], "host": {}, "versions": {}, "pid": 1}).encode()
HTML = "<p>made on<!-- when --><!-- /when --></p><dl><!-- work --><!-- /work --></dl>"


def found_of(configuration):
    verdicts = [Verdict("success", k, "pass", "", {"time": Metric(10.0, "s")}) for k in range(2)]
    return ConfigurationResult(verdicts=verdicts, logs=[LOG])


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


@pytest.fixture
def written(small_room, tmp_path, store):
    """Writes campaign directories of the same results; gives the results, and how often a report was made."""
    made = []

    def report(directory):
        made.append(directory)
        (directory / "report.html").write_text(
            with_work(HTML, json.loads((directory / "metadata.json").read_text())), encoding="utf-8"
        )
        (directory / "figures").mkdir()
        (directory / "figures" / "rates.png").write_bytes(b"picture")

    def write(found=found_of, second=1, executed=4, keep_in=store):
        campaign, oracles = read_campaign(small_room)
        results = write_results(
            tmp_path / "results",
            campaign,
            inputs_of(campaign, oracles),
            instantiate(campaign),
            found,
            runs=2,
            oracles=[oracle.name for oracle in oracles],
            keys=KEYS,
            created=datetime(2026, 11, 21, 6, 5, second),
            work=lambda: Work(executed, 4 - executed, 30.0, 2.0, 1.5),
            report=report,
            kept=lambda metadata: KeptReport(keep_in, KEY),
        )
        return results, len(made)

    return write


def files(directory):
    found = (path for path in directory.rglob("*") if path.is_file())
    return {path.relative_to(directory).as_posix(): path.read_bytes() for path in found}


def test_the_same_results_have_one_report_made_for_them(written):
    (first, _), (second, made) = written(second=1), written(second=2, executed=0)
    assert made == 1
    before, after = files(first.directory), files(second.directory)
    assert before.keys() == after.keys() >= {"figures/rates.png", "verdicts.parquet", "logs/runs.jsonl"}
    assert {name for name in before if before[name] != after[name]} == {"metadata.json", "report.html"}


def test_a_kept_report_says_the_facts_of_the_call_that_asks(written):
    written(second=1, executed=4)
    results, _ = written(second=2, executed=0)
    report = (results.directory / "report.html").read_text()
    assert "2026-11-21 06:05:02" in report and "06:05:01" not in report
    assert "0 executed, 4 from the store" in report
    metadata = json.loads((results.directory / "metadata.json").read_text())
    assert (metadata["counts"]["executed"], metadata["counts"]["passed"]) == (0, 4)
    assert metadata["created"] == "2026-11-21T06:05:02" and metadata["report"] == KEY


def test_the_summary_of_a_kept_report_is_that_of_a_new_one(written):
    (first, _), (second, _) = written(second=1), written(second=2)
    apart = {"results": ""}
    assert {**first.summary.as_json(), **apart} == {**second.summary.as_json(), **apart}


def test_a_damaged_report_is_made_again(written, store):
    first, _ = written(second=1)
    (file,) = (store.local / KEY).glob("verdicts.parquet")
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    second, made = written(second=2)
    assert made == 2
    assert files(first.directory)["verdicts.parquet"] == files(second.directory)["verdicts.parquet"]
    assert written(second=3)[1] == 2


def test_a_campaign_with_faults_keeps_nothing(written, store):
    fault = RunFault("room-1", 1, "execute", "MemoryError: 3 GB")
    written(lambda configuration: ConfigurationResult(faults=[fault]))
    assert store.find(KEY) is None


def test_runs_that_were_executed_anew_have_their_new_logs(written):
    written(second=1)
    log = LOG.replace(b'"pid": 1', b'"pid": 2')
    results, made = written(
        lambda c: ConfigurationResult(verdicts=found_of(c).verdicts, logs=[log]), second=2, executed=2
    )
    lines = (results.directory / "logs/runs.jsonl").read_text().splitlines()
    assert made == 1 and [json.loads(line)["pid"] for line in lines] == [2, 2]


class FullStore:
    def find(self, key):
        return None

    def put(self, *_):
        raise StoreError("store: can't write to 'x' (No space left on device)")


def test_a_store_that_takes_no_report_costs_the_next_call_time_and_no_more(written, caplog):
    results, _ = written(keep_in=FullStore())
    assert results.faults == () and (results.directory / "report.html").exists()
    assert "the report is not kept for the next time: store: can't write" in caplog.text


NOTHING = """\
import osc.helpers

scenario nothing:
    level: int
    do serial:
        log("done")
"""

CAMPAIGN = """\
version: 1
metadata: {name: nothing}
configuration:
- name: all
  variations:
  - ParameterVariationList: {name: level, values: [1, 2, 3]}
execution: {scenario_file: nothing.osc, runs: 2, timeout: 10}
"""


@pytest.fixture(scope="module")
def computed(tmp_path_factory, prefect_home):
    """A folder with a campaign, and what a run of it came to; all of it is in the store."""
    folder = tmp_path_factory.mktemp("nothing")
    (folder / "nothing.osc").write_text(NOTHING)
    (folder / "nothing.vast").write_text(CAMPAIGN)
    (folder / "work").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_HOME", str(prefect_home(folder / "prefect")))
        patch.delenv("PREFECT_API_URL", raising=False)
        first = run_campaign(folder / "nothing.vast", results=folder / "results", store=folder / "store", workers=1)
    return folder, first


HEAVY = "{'prefect', 'numba', 'scipy', 'matplotlib', 'pandas', 'jinja2', 'pymunk'}"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_where_nothing_is_missing_the_report_comes_from_the_store_and_nothing_is_drawn(computed, tmp_path):
    folder, first = computed
    campaign, store = folder / "nothing.vast", folder / "store"
    script = (
        "import sys; from vastflow.flows import run_campaign; "
        f"print(run_campaign({str(campaign)!r}, results={str(tmp_path / 'again')!r}, store={str(store)!r}).directory); "
        f"print(*{HEAVY} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True)
    directory, loaded = done.stdout.splitlines()
    before, after = files(first.directory), files(Path(directory))
    assert before.keys() - {"logs/campaign.log"} == after.keys()
    assert {name for name in after if before[name] != after[name]} == {"metadata.json", "report.html"}
    assert loaded == ""


def command(folder, *arguments):
    """What the command line prints in a folder, and which modules it loads for that."""
    script = (
        f"import sys; sys.argv = ['vastflow', *{[str(each) for each in arguments]!r}]\n"
        "from vastflow.flows.__main__ import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        f"print(*({HEAVY} | {{'lark', 'py_trees', 'vastflow.producers'}}) & sys.modules.keys())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, timeout=300, check=True
    )
    *said, loaded = done.stdout.splitlines()
    return said, loaded


@pytest.mark.timeout(900)
def test_a_command_that_is_given_again_is_answered_with_the_directory_that_is_there(computed):
    folder, _ = computed
    asked = ["run", folder / "nothing.vast", "--results", folder / "commands", "--store", folder / "store", "--json"]
    (said, _), (said_again, loaded) = command(folder / "work", *asked), command(folder / "work", *asked)
    made, again = json.loads(said[0]), json.loads(said_again[0])
    assert (made["executed"], again["executed"], again["reused"]) == (0, 0, 6)
    same = made.keys() - {"cpu_s", "wall_s"}
    assert {name: made[name] for name in same} == {name: again[name] for name in same}
    assert [each.name for each in (folder / "commands").iterdir()] == [Path(made["results"]).name]
    assert loaded == ""

    words, loaded = command(folder / "work", *asked[:-1])
    assert any("0 runs executed, 6 from the store" in line for line in words)
    assert f"report: {made['results']}/report.html" in words

    (Path(made["results"]) / "verdicts.parquet").unlink()
    (said, _) = command(folder / "work", *asked)
    assert json.loads(said[0])["results"] != made["results"]
    assert len(list((folder / "commands").iterdir())) == 2


def forged(store, key, **info):
    """Rewrite a manifest as somebody who may write the store can: its checksum is right."""
    artifact = store.find(key)
    (store.local / key / "manifest").write_bytes(manifest_of(replace(artifact, info={**artifact.info, **info})))


@pytest.mark.parametrize("place", ["../../away", "figures/../../../away", "{tmp_path}/away", ""])
def test_manifest_whose_place_leads_out_is_damaged(written, store, tmp_path, monkeypatch, place):
    written(second=1)
    forged(store, KEY, places={"verdicts.parquet": place.format(tmp_path=tmp_path)})
    assert "expected a path inside the folder, got" in store.fault(KEY)
    assert written(second=2)[1] == 2
    assert not list(tmp_path.rglob("away"))
    assert store.fault(KEY) is None


def test_kept_report_replaces_no_input(written, store):
    first, _ = written(second=1)
    forged(store, KEY, places={"verdicts.parquet": "campaign.vast", "runs.parquet": "inputs/judge.py"})
    second, made = written(second=2)
    assert made == 2
    assert files(second.directory)["campaign.vast"] == files(first.directory)["campaign.vast"]
    assert "inputs/judge.py" not in files(second.directory)
