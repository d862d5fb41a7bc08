"""Parts of tables that are kept: the rows of configurations that an edit does not reach, with the bytes of a run from nothing."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from vastflow.flows.results import campaign_tables, results
from vastflow.flows.results.cached_report import PART_SOURCE, KeptParts, KeptReport, part_source, parts_of
from vastflow.flows.results.cleaning import _of_report
from vastflow.flows.results.found import ConfigurationResult, RunFault
from vastflow.flows.results.results import write_rows
from vastflow.flows.results.summary import OutcomeTally
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.judgement.verdict import Metric, Verdict
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import StoreError, open_store

KEYS = Keys("x86_64; glibc 2.36; avx2 fma; ", "e" * 64, "o" * 64, "j" * 64, 0, [])
ORACLES = ("success", "safety")
RUNS = 2


def log(first, stop):
    return json.dumps({"runs": [{"run_index": k} for k in range(first, stop)], "host": {}}).encode()


def behaviors(runs):
    return write_behaviors({k: {"t_s": np.array([0.5 * k]), "name": np.array(["drive"], object)} for k in runs})


@pytest.fixture(autouse=True)
def parts_of_any_size(monkeypatch):
    monkeypatch.setattr(results, "LEAST", 1)


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


def configurations(levels, family="room"):
    return [
        Configuration(f"{family}-{k}", family, Scenario("builtin:nothing", 1.0, {}, {}, {"level": level}), {}, {}, ())
        for k, level in enumerate(levels, 1)
    ]


def level_of(configuration):
    return configuration.scenario.system["level"]


def found_of(configuration):
    """Verdicts and behaviors that differ between configurations; some have no behaviors, some no reason."""
    level = level_of(configuration)
    verdicts = [
        Verdict(oracle, k, "fail" if (level + k) % 3 == 0 else "pass", "σ" * (level % 2), {"t": Metric(level / 7, "s")})
        for k in range(RUNS)
        for oracle in ORACLES
    ]
    blocks = [behaviors(range(RUNS))] if level % 5 else []
    return ConfigurationResult(verdicts=verdicts, behaviors=blocks, logs=[log(0, RUNS)], exact=True)


class Unread:
    """What was found of a configuration whose rows nobody may ask for."""

    logs, faults = (log(0, RUNS),), ()

    @property
    def verdicts(self):
        raise AssertionError("its rows are in a part that is kept")

    recordings = behaviors = causes = verdicts


def unread(_):
    return Unread()


def kept_in(store, asked, changed=()):
    contents = {each.name: [f"judge/{level_of(each)}", f"{level_of(each) in changed}"] for each in asked}
    return KeptParts(store, KEYS, "s" * 64, contents)


def written(place, asked, parts=None, found=found_of):
    place.mkdir()
    rows = write_rows(place, asked, ((each, found(each)) for each in asked), RUNS, ORACLES, parts)
    return rows, {
        file.relative_to(place).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in place.rglob("*.*")
        if file.is_file()
    }


def test_tables_of_kept_parts_have_the_bytes_of_a_run_from_nothing(tmp_path, store):
    asked = configurations(range(300))
    rows, files = written(tmp_path / "nothing", asked)
    first, made = written(tmp_path / "first", asked, kept_in(store, asked))
    again, restored = written(tmp_path / "again", asked, kept_in(store, asked), unread)
    assert files.keys() == {"runs.parquet", "verdicts.parquet", "behaviors.parquet", "logs/runs.jsonl"}
    assert files == made == restored
    assert rows.tally == first.tally == again.tally
    assert first.kept == again.kept and len(first.kept) == len(parts_of(asked)) > 20


def test_an_edit_makes_the_part_anew_that_it_reaches_and_no_other(tmp_path, store):
    asked = configurations(range(300))
    written(tmp_path / "first", asked, kept_in(store, asked))
    (reached,) = [part for part in parts_of(asked) if asked[150] in part]

    def found(configuration):
        return found_of(configuration) if configuration in reached else Unread()

    written(tmp_path / "edited", asked, kept_in(store, asked, changed=[150]), found)
    with pytest.raises(AssertionError, match="its rows are in a part that is kept"):
        written(tmp_path / "other", asked, kept_in(store, asked, changed=[151, 20]), found)


def test_a_value_more_renames_what_follows_and_keeps_its_rows(tmp_path, store):
    before, after = configurations(range(1, 300)), configurations(range(300))
    rows_before, _ = written(tmp_path / "before", before, kept_in(store, before))
    rows, files = written(tmp_path / "after", after, kept_in(store, after))
    assert len({*rows.kept} - {*rows_before.kept}) <= 2
    assert files == written(tmp_path / "nothing", after)[1]


def test_configurations_of_another_family_have_its_name(tmp_path, store):
    rooms, halls = configurations(range(40)), configurations(range(40), "hall")
    written(tmp_path / "rooms", rooms, kept_in(store, rooms))
    _, files = written(tmp_path / "halls", halls, kept_in(store, halls), unread)
    assert files == written(tmp_path / "nothing", halls)[1]


CHANGES = {
    "the verdicts of a configuration": lambda key: key(contents={"room-1": ["judge/0", "other"]}),
    "the keys of verdicts": lambda key: key(contents={"room-1": ["judge/9", "False"]}),
    "the number of runs": lambda key: key(runs=[3, 2]),
    "whose number of runs": lambda key: key(runs=[2, 3]),
    "the oracles": lambda key: key(oracles=["success"]),
    "the order of oracles": lambda key: key(oracles=["safety", "success"]),
    "the order of configurations": lambda key: key(order=-1),
    "the code that makes them": lambda key: key(source="t" * 64),
    "the machine": lambda key: key(keys=replace(KEYS, numeric="aarch64; glibc 2.36; ; ")),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_whatever_rows_follow_from_gives_another_key(store, change):
    asked = configurations(range(2))
    all_contents = kept_in(store, asked).contents

    def key(contents=None, runs=(2, 2), oracles=ORACLES, order=1, keys=KEYS, source="s" * 64):
        parts = KeptParts(store, keys, source, {**all_contents, **(contents or {})})
        return parts.key(asked[::order], runs, oracles)

    assert key() == key()
    assert change(key) != key()


def test_the_code_that_makes_rows_is_all_that_rows_pass():
    tree = installed_tree()
    made_by = tree.with_packages("vastflow.flows.request", "vastflow.flows.results").code(PART_SOURCE)
    assert made_by.digest == part_source(tree)
    passed = (
        "flows.results.tables",
        "flows.results.found",
        "oracles.results.schema",
        "oracles.judgement.verdict",
        "sim.model.blocks",
    )
    assert {f"vastflow.{name}" for name in passed} <= made_by.modules.keys()
    assert {"numpy", "pyarrow"} <= made_by.libraries.keys()


@pytest.mark.parametrize("file", ["runs.arrow", "verdicts.arrow", "behaviors.arrow", "manifest"])
def test_a_damaged_part_is_made_again(tmp_path, store, file):
    asked = configurations(range(3))
    rows, files = written(tmp_path / "first", asked, kept_in(store, asked))
    damaged = store.local / rows.kept[1] / file
    damaged.write_bytes(damaged.read_bytes()[:-3] + b"???")
    assert written(tmp_path / "again", asked, kept_in(store, asked))[1] == files
    assert store.fault(rows.kept[1]) is None


def test_run_logs_that_were_read_whole_once_are_not_read_again(tmp_path, store, monkeypatch):
    asked = configurations(range(3))
    _, files = written(tmp_path / "first", asked, kept_in(store, asked))
    monkeypatch.setattr(campaign_tables, "_is_log", lambda log: pytest.fail("it is read again"))
    assert written(tmp_path / "again", asked, kept_in(store, asked), unread)[1] == files


@pytest.mark.parametrize("damaged", [log(0, RUNS)[:-1], log(0, RUNS).replace(b":", b";", 1), b"", b"[]"])
def test_a_run_log_that_was_damaged_since_is_left_out_as_in_a_run_from_nothing(tmp_path, store, damaged):
    asked = configurations(range(3))
    written(tmp_path / "first", asked, kept_in(store, asked))

    def found(configuration):
        whole = found_of(configuration)
        return replace(whole, logs=[damaged]) if configuration is asked[1] else whole

    _, files = written(tmp_path / "again", asked, kept_in(store, asked), found)
    assert files == written(tmp_path / "nothing", asked, found=found)[1]


def test_rows_with_a_fault_are_not_kept(tmp_path, store):
    asked = configurations(range(3))
    broken = ConfigurationResult(faults=[RunFault("room-1", None, "judge", "MemoryError: 3 GB")])
    written(tmp_path / "first", asked, kept_in(store, asked), lambda c: broken if c is asked[0] else found_of(c))
    assert store.find(kept_in(store, asked).key(asked[:1], [RUNS], ORACLES)) is None


class FullStore:
    def find(self, key):
        return None

    def put(self, *_):
        raise StoreError("store: can't write to 'x' (No space left on device)")


def test_a_store_that_takes_no_rows_costs_the_next_call_time_and_no_more(tmp_path, caplog):
    asked = configurations(range(3))
    assert written(tmp_path / "a", asked, kept_in(FullStore(), asked))[1] == written(tmp_path / "b", asked)[1]
    assert "rows of tables are not kept for the next time: store: can't write" in caplog.text


def test_few_configurations_are_no_part_worth_keeping(tmp_path, store, monkeypatch):
    monkeypatch.undo()
    asked = configurations(range(20))
    rows, _ = written(tmp_path / "first", asked, kept_in(store, asked))
    assert rows.kept == () and not (store.local / "report").exists()


def test_what_a_report_was_made_of_is_kept_with_it(tmp_path, store):
    (tmp_path / "directory").mkdir()
    tally = OutcomeTally(Counts(1), {"success": Counts(1)}, 0)
    KeptReport(store, "report/aa/aa").keep(tmp_path / "directory", tally, ["report/bb/bb"])
    assert [*_of_report(store, "report/aa/aa")] == ["report/aa/aa", "report/bb/bb"]
    assert [*_of_report(store, "report/cc/cc")] == ["report/cc/cc"] and [*_of_report(store, None)] == []
