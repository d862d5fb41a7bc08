"""SQL of an assistant: one SELECT over the tables, within 3 s and 1.5 GB."""

import json
import resource
import time
from pathlib import Path

import duckdb
import pandas as pd
import pytest
from table import each_row

from vastflow.deployments.assistant.sql import MOST_TEXT, TABLES, answer_sql
from vastflow.sim.model.faults import UserError

REFUSED = (
    "SELECT * FROM read_csv('/etc/passwd')",
    "SELECT * FROM read_text('/etc/hostname')",
    "SELECT content FROM read_blob('/proc/self/environ')",
    "SELECT * FROM '/etc/passwd'",
    'SELECT * FROM "/etc/passwd.csv"',
    "SELECT * FROM glob('/**')",
    "SELECT * FROM read_parquet('{file}')",
    "SELECT * FROM parquet_metadata('{file}')",
    "SELECT * FROM read_json('https://example.org/x.json')",
    "SELECT * FROM 'https://example.org/x.parquet'",
    "SELECT * FROM sniff_csv('/etc/passwd')",
    "COPY runs TO '/tmp/out.csv'",
    "COPY (SELECT 1) TO '/dev/stdout'",
    "ATTACH '/tmp/other.db' AS other",
    "INSTALL httpfs",
    "LOAD json",
    "PRAGMA database_list",
    "PRAGMA show_tables",
    "SET enable_external_access=true",
    "RESET memory_limit",
    "CALL duckdb_settings()",
    "CREATE TABLE t AS SELECT 1",
    "DROP VIEW runs",
    "UPDATE runs SET passed = true",
    "EXPLAIN ANALYZE SELECT 1",
    "PREPARE p AS SELECT 1",
    "EXPORT DATABASE '/tmp/x'",
    "SELECT 1; SELECT 2",
    "SELECT 1 /* ; */; DROP VIEW runs -- one",
    "",
    "-- nothing",
    "DESCRIBE runs",
    "SHOW ALL TABLES",
    "SELECT * FROM duckdb_settings()",
    "SELECT * FROM DuckDB_Secrets()",
    "SELECT * FROM duckdb_views",
    "SELECT * FROM information_schema.tables",
    "SELECT * FROM pg_catalog.pg_settings",
    "SELECT * FROM system.main.duckdb_databases",
    "SELECT (SELECT sql FROM sqlite_master LIMIT 1)",
    "SELECT current_setting('home_directory')",
    "SELECT system.main.current_setting('temp_directory')",
    "SELECT getvariable('x'), getenv('HOME')",
    "SELECT * FROM query('SELECT * FROM duckdb_' || 'settings()')",
    "SELECT * FROM query_table('duckdb_views')",
    "SELECT json_serialize_plan('SELECT 1')",
    "SELECT * FROM json_execute_serialized_sql(json_serialize_sql('SELECT 1'))",
    "WITH duckdb_views AS (SELECT 1) SELECT * FROM duckdb_views",
    "SELECT * FROM (WITH sqlite_master AS (SELECT 1) FROM sqlite_master), sqlite_master",
    "SELECT * FROM runs WHERE EXISTS (FROM pragma_database_list())",
    "SELECT * FROM connection",
    "SELECT * FROM question",
    "SELECT 1\0; DROP VIEW runs",
    "SELECT '\u202e' FROM runs",
    "ＳＥＬＥＣＴ * FROM runs",
    "SELECT * FROM ru\u200bns",
    "SELECT write_log('x')",
    "SELECT unknown FROM runs",
    "SELECT '" + "x" * 30_000 + "'",
    "SELECT " + "(" * 9_000 + "1" + ")" * 9_000,
)
"""Texts that are no question about the tables."""
ENDLESS = (
    "WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t) SELECT count(*) FROM t",
    "SELECT count(*) FROM range(1000000000000)",
    "SELECT count(*) FROM range(1000000) a, range(1000000) b, range(1000000) c",
    "SELECT sum(a.run_index + b.run_index) FROM runs a, runs b, runs c, runs d, runs e, runs f, runs g, runs h",
    "SELECT repeat('x', 2000000000)",
    "SELECT length(repeat(repeat('x', 100000), 100000))",
    "SELECT string_agg(repeat('y', 1000000), '') FROM range(100000)",
    "SELECT list(range) FROM range(100000000)",
    "SELECT unnest(range(1000000000))",
    "SELECT list_transform(range(100000000), x -> repeat('z', 1000))",
    "SELECT array_agg(a.range || b.range) FROM range(100000) a, range(100000) b",
    "SELECT regexp_replace(repeat('a', 100000000), '(a+)+$', 'b')",
    "SELECT lpad('', 2147483647, 'x')",
    "SELECT a.range, count(*) FROM range(100000000) a GROUP BY ALL ORDER BY random()",
    "SELECT factorial(30000), sleep_ms(100000)",
)
"""Texts that would take all time or memory."""

READS_BY_PATH = 'SELECT a.* FROM "{file}" a, (WITH "{file}" AS (SELECT 1) SELECT 1) b'
"""A file that a name of a WITH, of which another table of this name is out of scope, lets through the check."""


@pytest.fixture(scope="module")
def campaigns(results) -> dict[str, Path]:
    return {path.name: path for path in sorted(results.iterdir())}


def timed(campaigns, text):
    """Return the answer or the sentence for a text, and its time in s."""
    began_s = time.monotonic()
    try:
        return answer_sql(campaigns, text, 100, 0), time.monotonic() - began_s
    except UserError as error:
        return str(error), time.monotonic() - began_s


def peak_bytes():
    """Return the largest memory of a child process that has ended."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


@pytest.mark.slow
@pytest.mark.timeout(400)
@each_row("text", [*REFUSED, *ENDLESS])
def test_hostile_text_is_refused_or_cut_within_3_s_and_1500_mb(campaigns, text):
    file = campaigns[max(campaigns)] / "runs_wide.parquet"
    said, took_s = timed(campaigns, text.replace("{file}", str(file)))
    assert took_s < 3.0
    assert peak_bytes() < 1.5e9
    if isinstance(said, str):
        assert (len(said.splitlines()), "Traceback" in said) == (1, False)
        assert len(said) < 700
    else:
        assert (text in ENDLESS, len(json.dumps(said)) < 200_000) == (True, True)


@pytest.mark.timeout(120)
@each_row(
    "text, words",
    [
        ("SELECT * FROM read_text('/etc/hostname')", "read_text"),
        ("SELECT * FROM '/etc/passwd'", "one of the tables"),
        ("SELECT 1; SELECT 2", "expected one SELECT, got SELECT, SELECT"),
        ("COPY runs TO '/tmp/out.csv'", "expected one SELECT, got COPY"),
        ("SELECT current_setting('home_directory')", "current_setting"),
        ("WITH duckdb_views AS (SELECT 1) SELECT * FROM duckdb_views", "names of the system"),
        ("SELECT repeat('x', 2000000000)", "Out of Memory"),
        ("SELECT count(*) FROM range(1000000000000)", "more than 2.5 s"),
        ("SELECT unknown FROM runs", 'Referenced column "unknown" not found'),
        ("SELECT 1\0", "printable text"),
    ],
)
def test_sql_refusal_gives_reason(campaigns, text, words):
    assert words in str(timed(campaigns, text)[0])


def test_settings_and_files_are_out_of_reach_without_the_check(campaigns, monkeypatch):
    """DuckDB refuses by itself what the check of the text refuses before."""
    from vastflow.deployments.assistant import sql

    monkeypatch.setattr(sql, "_check", lambda *_: None)
    question = {"views": [*sql._views(campaigns)], "files": [], "limit": 5, "offset": 0}
    for text in (
        "SELECT * FROM read_text('/etc/hostname')",
        "COPY (SELECT 1) TO '/tmp/x.csv'",
        "INSTALL httpfs",
        "SET threads=2",
    ):
        with pytest.raises(UserError, match=r"disabled|locked|not allowed|Permission|lock"):
            sql.answer({**question, "sql": text})


def test_sql_tables_equal_parquet_files(campaigns):
    for table, (file, _, _) in TABLES.items():
        expected = sum(len(pd.read_parquet(path / file)) for path in campaigns.values())
        assert answer_sql(campaigns, f"SELECT count(*) FROM {table}", 1, 0)["rows"] == [[expected]]


def test_answer_equals_pandas(campaigns):
    query = "SELECT configuration, count(*), avg(passed::INT), max(simulated_s) FROM runs GROUP BY ALL ORDER BY 1"
    name, path = max(campaigns.items())
    runs = pd.read_parquet(path / "runs_wide.parquet").astype({"configuration": str, "passed": float})
    of_each = runs.groupby("configuration")
    columns = of_each.size(), of_each.passed.mean(), of_each.simulated_s.max()
    expected = [[each, *(column[each] for column in columns)] for each in sorted(of_each.groups)]
    assert answer_sql({name: path}, query, 100, 0)["rows"] == expected


def test_rows_beyond_the_limit_are_cut_and_said(campaigns):
    query = "SELECT campaign, configuration, run_index FROM runs ORDER BY ALL"
    first, rest = (answer_sql(campaigns, query, 10, offset) for offset in (0, 10))
    whole = answer_sql(campaigns, query, 200, 0)
    assert first["cut"] == ["rows from row 10 on: ask on with this `offset` and an ORDER BY"]
    assert (first["rows"] + rest["rows"], whole["cut"]) == (whole["rows"][:20], [])


def test_long_values_are_cut_and_said(campaigns):
    found = answer_sql(campaigns, "SELECT repeat('x', 10000), 1e999, 170141183460469231731687303715884105727", 5, 0)
    assert found["cut"] == [f"1 values to {MOST_TEXT:,} characters"]
    assert found["rows"][0][1:] == [None, str(2**127 - 1)]


def test_answer_as_a_whole_is_bounded(campaigns):
    found = answer_sql(campaigns, "SELECT repeat('x', 1900), range FROM range(1000)", 200, 0)
    assert len(json.dumps(found)) < 70_000
    assert found["cut"] == [f"rows from row {len(found['rows'])} on: ask on with this `offset` and an ORDER BY"]


def test_link_out_of_a_campaign_is_no_table(campaigns, tmp_path):
    stranger = tmp_path / "stranger-2026-11-28-060000"
    stranger.mkdir()
    secret = tmp_path / "secret.parquet"
    duckdb.sql("SELECT 'secret' AS name").write_parquet(str(secret))
    (stranger / "runs_wide.parquet").symlink_to(secret)
    with pytest.raises(UserError, match=r"runs.*does not exist|expected"):
        answer_sql({"stranger": stranger}, "SELECT * FROM runs", 5, 0)
    assert "secret" not in str(
        timed({"stranger": stranger}, READS_BY_PATH.format(file=stranger / "runs_wide.parquet"))[0]
    )
