"""The database of Prefect's embedded API: what SQLite can't read is set aside, and everything else left alone."""

import contextlib
import re
import sqlite3
import time
from datetime import datetime

import pytest
from prefect.client.orchestration import get_client
from prefect_schema import migrated
from table import each_row

from vastflow.tasks.prefect.api_server import database_file, make_database, set_aside_if_damaged
from vastflow.tasks.prefect.server import ApiServer, embedded

NOW = datetime(2026, 3, 4, 5, 6, 7)
ASIDE = "prefect.db.damaged-2026-03-04-050607"


@pytest.fixture
def database(tmp_path):
    """A database of 200 pages."""
    file = tmp_path / "prefect.db"
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("create table flow_run (name text)")
        connection.executemany("insert into flow_run values (?)", [("x" * 1000,) for _ in range(800)])
        connection.commit()
    return file


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (lambda content: b"garbage" * 1000, "file is not a database"),
        (lambda content: content[:40000], "malformed"),
        (lambda content: content[:8192] + bytes(40960) + content[49152:], "malformed|btreeInitPage"),
    ],
    ids=["overwritten", "truncated", "pages of zeros"],
)
def test_damaged_database_is_set_aside_with_its_cause(database, damaged, said):
    content = damaged(database.read_bytes())
    database.write_bytes(content)
    database.with_name("prefect.db-wal").write_bytes(b"")
    found = set_aside_if_damaged(database, NOW)
    assert found.startswith(f"Prefect's database {database} is damaged (")
    assert found.endswith(f"It is now {ASIDE}, and a new one is made")
    assert re.search(said, found)
    assert not database.exists() and not database.with_name("prefect.db-wal").exists()
    assert database.with_name(ASIDE).read_bytes() == content


def test_sound_database_is_kept(database):
    before = database.read_bytes()
    assert set_aside_if_damaged(database, NOW) is None
    assert database.read_bytes() == before


def test_locked_database_is_kept(database):
    with contextlib.closing(sqlite3.connect(database)) as connection:
        connection.execute("begin exclusive")
        assert set_aside_if_damaged(database, NOW) is None
    assert database.exists()


@each_row("connection_url", ["postgresql+asyncpg://me@host/prefect", "sqlite+aiosqlite:///:memory:"])
def test_database_without_file_is_ignored(connection_url):
    assert database_file(connection_url) is None


def objects_of(database):
    """Tables and indexes with their lines sorted, as migrations write constraints in another order each time."""
    with contextlib.closing(sqlite3.connect(database)) as connection:
        found = connection.execute("select type, name, tbl_name, sql from sqlite_master").fetchall()
    return {row[:3]: sorted(line.strip().rstrip(",") for line in (row[3] or "").splitlines()) for row in found}


def test_shipped_schema_equals_migrations_of_installed_prefect(tmp_path):
    assert make_database(tmp_path / "shipped" / "prefect.db")
    expected = objects_of(migrated(tmp_path))
    assert len(expected) > 100
    assert objects_of(tmp_path / "shipped" / "prefect.db") == expected


def test_existing_database_is_kept_and_migrated_unless_it_has_the_shipped_revision(tmp_path, monkeypatch, database):
    before = database.read_bytes()
    assert not make_database(database)
    assert database.read_bytes() == before
    made = tmp_path / "made.db"
    assert make_database(made) and make_database(made)
    monkeypatch.setattr("vastflow.tasks.prefect.api_server.version", lambda name: "3.8.999")
    assert not make_database(made)
    monkeypatch.undo()
    with contextlib.closing(sqlite3.connect(made)) as connection:
        connection.execute("update alembic_version set version_num = 'earlier'")
        connection.commit()
    assert not make_database(made)


def test_new_api_migrates_nothing_and_answers_over_the_shipped_database(tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['alembic.command'] = None")
    server = ApiServer(tmp_path / "log")
    try:
        with embedded(server.url(120), server.auth), get_client(sync_client=True) as client:
            assert client.read_flow_runs() == []
    finally:
        server.stop()
    assert not list(tmp_path.glob("prefect.db[!-]*"))


def test_api_reports_moved_database_before_serving(tmp_path, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    (tmp_path / "prefect.db").write_bytes(b"garbage" * 1000)
    server = ApiServer(tmp_path / "log")
    deadline = time.monotonic() + 120
    while not server.notices and not server.lost and time.monotonic() < deadline:
        time.sleep(0.05)
    server.stop(0)
    (notice,) = server.notices
    assert "is damaged (file is not a database)" in notice
    assert len(list(tmp_path.glob("prefect.db.damaged-*"))) == 1
