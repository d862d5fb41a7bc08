"""Damaged campaign directories in the explorer: they take no other away, and no request waits for them."""

import json
import os
import shutil
import threading

import pytest
from damages import BEGAN, DEEP, EVENTS, FAMILY, PROGRESS, lines_of, of_another_kind
from explored import addresses_of
from table import each_row

from vastflow.deployments.explorer import directories as listed
from vastflow.deployments.explorer import opened
from vastflow.deployments.explorer.directories import Directories

pytestmark = pytest.mark.timeout(120)
HUGE = 10**400


def with_metadata(path, **values):
    file = path / "metadata.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def unfinished(events):
    """Put events in place of a whole directory."""

    def changed(path):
        shutil.rmtree(path)
        place = path.with_name(f".{path.name}.running")
        place.mkdir()
        file = place / "events.jsonl"
        file.write_bytes(events) if isinstance(events, bytes) else of_another_kind(file, events)

    return changed


@each_row(
    "damage",
    [
        *map(unfinished, (EVENTS[0], EVENTS[4], "pipe", "loop", "/dev/zero")),
        unfinished(lines_of([BEGAN, {**PROGRESS, "families": [{**FAMILY, "passed": HUGE}]}])),
        lambda path: (path / "metadata.json").write_text("[" * DEEP),
        lambda path: with_metadata(path, counts={"passed": HUGE, "failed": 0, "not_judged": 0}),
        lambda path: with_metadata(path, created=HUGE, faults=[HUGE, {"a": "\ud800"}]),
        *(lambda path, kind=kind: of_another_kind(path / "metadata.json", kind) for kind in ("pipe", "socket", "loop")),
        lambda path: of_another_kind(path / "recordings", "loop"),
        lambda path: of_another_kind(path / "campaign.vast", "pipe"),
        lambda path: path.rename(os.fsdecode(os.fsencode(path) + b"\xff\xfe")),
    ],
)
def test_list_keeps_campaign_beside_a_damaged_one(client, add_campaign, results, id_of, damage):
    shutil.rmtree(results)
    results.mkdir()
    whole = add_campaign(20, {"room": [1]})
    damage(add_campaign(21, {"room": [1]}))
    page = client.get("/")
    assert page.status_code == 200 and page.text.count("<tr>") == 3 and id_of(whole) in page.text
    assert client.get("/campaign", params={"c": id_of(whole)}).status_code == 200


TABLES = (
    "runs_wide.parquet",
    "configurations.parquet",
    "verdicts.parquet",
    "recordings/room-1.parquet",
    "traces/room-1.parquet",
)


@pytest.mark.slow
@each_row(("file", "kind"), [(file, kind) for file in TABLES for kind in ("pipe", "folder")] + [(TABLES[0], "loop")])
def test_pages_refuse_table_that_is_no_regular_file(client, add_campaign, results, id_of, file, kind):
    shutil.rmtree(results)
    results.mkdir()
    whole, path = add_campaign(20, {"room": [1]}), add_campaign(21, {"room": [1]})
    (environment,) = os.listdir(path / "environments")
    of_another_kind(path / file, kind)
    replies = {
        client.get(address, params=query).status_code
        for address, query in addresses_of(id_of(path), id_of(whole), environment)
        if address != "/compare"
    }
    assert replies <= {200, 400, 409}
    assert client.get("/campaign", params={"c": id_of(whole)}).status_code == 200


def test_page_does_not_wait_for_tables_of_another_campaign(client, add_campaign, id_of, monkeypatch):
    slow, quick = add_campaign(20, {"room": [1]}), add_campaign(21, {"room": [1]})
    read, begun, go_on = opened._opened, threading.Event(), threading.Event()

    def waiting(directory, written_ns):
        if directory.path == slow:
            begun.set()
            assert go_on.wait(60)
        return read(directory, written_ns)

    monkeypatch.setattr(opened, "_opened", waiting)
    campaigns = opened.OpenedCampaigns(Directories([slow, quick]))
    first = threading.Thread(target=campaigns.of, args=(id_of(slow),))
    first.start()
    try:
        assert begun.wait(60)
        assert campaigns.of(id_of(quick)).directory.path == quick
    finally:
        go_on.set()
        first.join()


def test_metadata_is_read_once_until_it_changes(add_campaign, results, monkeypatch):
    path, reads, read_json = add_campaign(20, {"room": [1]}), [], listed.read_json

    def counted(file, *kind):
        reads.append(file)
        return read_json(file, *kind)

    monkeypatch.setattr(listed, "read_json", counted)
    directories = Directories([results])
    (found,) = directories.all()
    assert directories.find(found.id) == found and len(reads) == 1
    with_metadata(path, name="renamed")
    assert directories.find(found.id).name == "renamed" and len(reads) == 2
