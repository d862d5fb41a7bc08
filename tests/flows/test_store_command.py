"""`vastflow store`: its artifacts, damaged ones, and those of no kept campaign."""

import json
import os
import re
import shutil
import time

import pytest
from command_line import DOCS, called, options_of, refused

from vastflow.flows.results.cleaning import clean, cleaning
from vastflow.tasks.store.store import open_store

DAY_S = 24 * 3600.0


def reported(*arguments):
    result = called("store", *arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


@pytest.fixture
def store(tmp_path, monkeypatch):
    store = open_store(tmp_path / "store")
    monkeypatch.setenv("VASTFLOW_STORE", str(store.local))
    return store


def grow_old(store, days=2.0):
    """Let everything have been written some days ago."""
    then_s = time.time() - days * DAY_S
    for file in store.local.rglob("*"):
        os.utime(file, (then_s, then_s))


def keys_in(store):
    return {holding.key for holding in store.holdings()}


def spoil(store, stage):
    key = min(key for key in keys_in(store) if key.startswith(stage))
    (file,) = (store.local / key).glob("*.parquet")
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    return key


def test_info_counts_artifacts_and_bytes_by_stage(ran, store):
    assert reported("info")["artifacts"] == 0
    assert called("store", "info").exit_code == 0
    ran()
    grow_old(store, 3)
    ran("0.02", "0.05")
    found = reported("info")
    counts = {"evaluate": 2, "search": 0, "execute": 3, "observe": 3, "judge": 3, "bundle": 0, "rows": 0, "report": 0}
    assert {stage: row["artifacts"] for stage, row in found["stages"].items()} == counts
    assert (found["artifacts"], found["unfinished"]) == (11, 0)
    assert found["bytes"] == sum(row["bytes"] for row in found["stages"].values()) > 0
    assert 2.9 < found["oldest_days"] < 3.1 and found["newest_days"] < 0.1
    printed = called("store", "info").stdout
    assert str(store.local) in printed and "execute" in printed and "3 d" in printed


def test_verify_names_damage_and_repair_discards_it(ran, store):
    ran()
    result = called("store", "verify")
    assert (result.exit_code, result.stdout) == (0, "7 artifacts read, 0 damaged\n")
    before, key = keys_in(store), spoil(store, "execute")
    result = called("store", "verify")
    assert result.exit_code == 1
    assert result.stdout == f"{key}: recordings.parquet is not what was written\n7 artifacts read, 1 damaged\n"
    assert keys_in(store) == before
    damaged = json.loads(called("store", "verify", "--json").stdout)["damaged"]
    assert damaged == {key: "recordings.parquet is not what was written"}
    keys = {key, spoil(store, "observe")}
    result = called("store", "verify", "--repair")
    assert (result.exit_code, "2 damaged, deleted to be computed again" in result.stdout) == (0, True)
    assert keys_in(store) == before - keys
    one, other, *_ = sorted(key for key in keys_in(store) if key.startswith("judge"))
    shutil.rmtree(store.local / one)
    shutil.copytree(store.local / other, store.local / one)
    result = called("store", "verify")
    assert result.exit_code == 1
    assert result.stdout == f"{one}: it is a copy of {other}\n5 artifacts read, 1 damaged\n"


def test_gc_keeps_artifacts_of_campaigns_and_deletes_others(ran, store):
    first = ran()
    of_first = keys_in(store)
    grow_old(store)
    second = ran("0.02", "0.05")
    of_both = keys_in(store)
    assert reported("gc", "--keep", first)["artifacts"] == 0  # younger than a day
    grow_old(store)
    assert reported("gc", "--keep", second.parent)["keys"] == []
    said = reported("gc", "--keep", first, "--dry-run")
    assert "3 artifacts would be deleted, 8 kept" in called("store", "gc", "--keep", first, "--dry-run").stdout
    assert keys_in(store) == of_both
    found = reported("gc", "--keep", first)
    assert set(found["keys"]) == {key for key in of_both - of_first if not key.startswith("evaluate/")}
    assert keys_in(store) == of_both - set(found["keys"])
    assert (found["deleted"], found["artifacts"], found["kept"]) == (True, 3, 8)
    assert found == {**said, "deleted": True}


def test_gc_by_age_deletes_only_older_artifacts(ran, store):
    ran()
    grow_old(store, 20)
    old = keys_in(store)
    ran("0.02", "0.05")
    assert reported("gc", "--older-than", "30")["artifacts"] == 0
    assert set(reported("gc", "--older-than", "10")["keys"]) == old
    assert not keys_in(store) & old


def test_gc_deletes_rows_after_a_day(ran, store):
    kept, key = ran(), f"rows/ab/{'ab' * 32}"
    store.put(key, {"content": b"x"})
    assert reported("gc", "--keep", kept)["keys"] == []
    grow_old(store)
    assert reported("gc", "--keep", kept)["keys"] == [key]


def test_gc_keeps_bundles_of_long_campaigns_for_a_month(store):
    key = f"bundle/ab/{'ab' * 32}"
    store.put(key, {"content": b"x"})
    for age_days, left in ((20, [key]), (40, [])):
        clean(store, cleaning(store, None, DAY_S, time.time() + age_days * DAY_S))
        assert [each.key for each in store.holdings()] == left


def test_gc_deletes_environments_of_no_kept_producer(ran, store):
    first = ran()
    named, unnamed = ("ab" * 32, "cd" * 32)
    for name in (named, unnamed):
        (store.local / "environments" / name).mkdir(parents=True)
        (store.local / "environments" / name / "map.pgm").write_bytes(bytes(1000))
    fragments = json.dumps([{"file": [f"/x/environments/{named}/map.yaml", "0"]}]).encode()
    store.put("evaluate/ab/of-plans", {"fragments.json": fragments})
    grow_old(store)
    os.utime(store.local / "evaluate" / "ab" / "of-plans" / "manifest")  # younger than a day: it stays
    found = reported("gc", "--keep", first)
    assert (found["environments"], found["environments_bytes"]) == (1, 1000)
    assert [folder.name for folder in (store.local / "environments").iterdir()] == [named]


def test_gc_deletes_nothing_if_a_campaign_directory_is_damaged(ran, store):
    first = ran()
    grow_old(store)
    before = keys_in(store)
    metadata = json.loads((first / "metadata.json").read_text())
    without_seed = json.dumps({key: metadata[key] for key in metadata if key != "seed"})
    for file, content, words in (
        ("metadata.json", without_seed, "damaged campaign directory"),
        ("configurations.parquet", "nonsense", f"{first}: damaged campaign directory"),
        ("metadata.json", "nonsense", f"{first}: damaged campaign directory"),
    ):
        (first / file).write_text(content)
        assert words in refused("store", "gc", "--keep", first)
        assert keys_in(store) == before


def test_page_of_store_describes_every_option():
    rows = re.findall(r"^\| `(--[a-z-]+)[^|]*\| (all|`\w+`) \|", (DOCS / "keep-the-store.md").read_text(), re.MULTILINE)
    of = {name: options_of("store", name) for name in ("info", "verify", "gc")}
    common = set.intersection(*of.values())
    own = {(option, f"`{name}`") for name, options in of.items() for option in options - common}
    assert set(rows) == own | {(option, "all") for option in common}
