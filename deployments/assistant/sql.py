"""SQL over the tables of campaign directories, answered by a child process, as DuckDB keeps no limits."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import is_inside
from vastflow.tasks.engine.child import Child, NoAnswer

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

WALL_S: Final = 2.5
MEMORY_BYTES: Final = 1_200_000_000
MOST_BYTES: Final = 60_000
"""Size of an answer's rows as JSON."""
MOST_TEXT: Final = 2_000
"""Characters of one value."""
MOST_CAMPAIGNS: Final = 20
MOST_SQL: Final = 20_000

TABLES: Final[Mapping[str, tuple[str, str, str]]] = {
    "runs": (
        "runs_wide.parquet",
        "*",
        "a row for each run: outcome, verdicts, metrics, factors; `weight` of its configuration's rate where a rule ended runs",
    ),
    "verdicts": (
        "verdicts.parquet",
        "configuration, run_index, oracle, COLUMNS('^judge?ment$') AS judgment, reason, metrics",
        "a row for each run and oracle: pass, fail, or not judged, with the reason, and metrics as JSON",
    ),
    "configurations": (
        "configurations.parquet",
        "name AS configuration, COLUMNS('^(family|duplicate_of|environment|timeout_s|factors|provenance)$')",
        "a row for each configuration, with its factors and the notes of producers as JSON",
    ),
    "rejections": ("rejections.parquet", "*", "a row for each instance that can't be realized, with the reason"),
}
"""Name of a table to its file, the columns that are taken of it, and its meaning."""

_TABLE_FUNCTIONS: Final = frozenset({"range", "generate_series", "unnest", "json_each"})
_REFUSED: Final = re.compile(
    r"current_setting|get_?(env|variable)|write_log|nextval|currval|setseed|json_(de)?serialize.*|json_execute.*|"
    r"in_search_path|current_(schemas?|catalog|database|query.*|connection_id|user|role)|inet_.*|pg_(?!typeof).*|"
    r"(query|read_|parquet_|pragma_|duckdb_|sniff_|glob|has_\w+_privilege).*|sleep_ms|version|(session_)?user"
)
"""Functions that tell of settings, the connection, or the machine, or that read text as SQL."""
_SETTINGS: Final = (
    "python_enable_replacements=false",
    "python_scan_all_frames=false",
    "autoinstall_known_extensions=false",
    "autoload_known_extensions=false",
    "memory_limit='500MB'",
    "temp_directory=''",
)


def answer_sql(campaigns: Mapping[str, Path], sql: str, limit: int, offset: int) -> dict[str, Any]:
    """Answer one SELECT over campaigns by their ids: `columns`, `rows`, and what was `cut`.

    Raises:
        UserError: the text is no single SELECT, names what it may not, is wrong, or takes too much.
    """
    if len(sql) > MOST_SQL or not all(each.isprintable() or each in "\n\r\t" for each in sql):
        raise UserError(f"query: expected printable text of at most {MOST_SQL:,} characters")
    chosen = dict([*campaigns.items()][:MOST_CAMPAIGNS])
    files = [str(at) for path in chosen.values() for file, *_ in TABLES.values() if is_inside(at := path / file, path)]
    question = {"sql": sql, "views": [*_views(chosen)], "files": files, "limit": limit, "offset": offset}
    # DuckDB's threads would reserve most of the address space, each an arena of its own.
    environment = {"LC_ALL": "C.UTF-8", "MALLOC_ARENA_MAX": "1"}
    answer = f"{__name__}:answer"
    with Child(answer, memory_bytes=MEMORY_BYTES, file_bytes=0, environment=environment) as child:
        try:
            found: dict[str, Any] = child.ask(question, WALL_S)
        except NoAnswer as error:
            raise UserError(f"query: {error}. Ask for less.") from None
    if len(chosen) < len(campaigns):
        found["cut"].append(f"the newest {len(chosen)} of {len(campaigns):,} campaigns were read: name one")
    return found


def _views(campaigns: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    for table, (file, columns, _) in TABLES.items():
        there = {
            id: path / file
            for id, path in campaigns.items()
            if (path / file).is_file() and is_inside(path / file, path)
        }
        read = [f"SELECT {_text(id)} AS campaign, {columns} FROM read_parquet({_text(at)})" for id, at in there.items()]
        if read:
            yield table, " UNION ALL BY NAME ".join(read)


def _text(value: object) -> str:
    return "'" + str(value).replace("'", "''") + "'"


def answer(question: dict[str, Any]) -> dict[str, Any]:
    """Answer one SELECT in the process of its own."""
    import duckdb

    connection = duckdb.connect(":memory:", config={"threads": 1})
    system = {row[0] for row in connection.execute("SELECT view_name FROM duckdb_views()").fetchall()}
    try:
        for name, select in question["views"]:
            connection.execute(f"CREATE VIEW {name} AS {select}")
        paths = f"allowed_paths=[{', '.join(map(_text, question['files']))}]"  # which nothing but the views can name
        for setting in (*_SETTINGS, paths, "enable_external_access=false", "lock_configuration=true"):
            connection.execute(f"SET {setting}")
        _check(connection, question["sql"], system)
        return _table(connection.execute(question["sql"]), question["limit"], question["offset"])
    except duckdb.Error as error:
        raise UserError(f"query: {str(error).partition(chr(10))[0][:500]}") from None


def _check(connection: "DuckDBPyConnection", sql: str, system: set[str]) -> None:
    """Raise `UserError` unless a text is one SELECT over the tables alone; `system` has DuckDB's own views."""
    import duckdb

    kinds = [each.type for each in duckdb.extract_statements(sql)]
    if kinds != [duckdb.StatementType.SELECT]:
        raise UserError(f"query: expected one SELECT, got {', '.join(kind.name for kind in kinds)[:100] or 'nothing'}")
    (text,) = connection.execute("SELECT json_serialize_sql(?::VARCHAR)", [sql]).fetchall()[0]
    nodes = [*_nodes(json.loads(text))]
    maps = [node["cte_map"]["map"] for node in nodes if node.get("cte_map")]
    named = {str(each["key"]).casefold() for each in (each for found in maps for each in found)}
    if not nodes or nodes[0]["error"] or named & system:  # outside of its WITH such a name is the system's
        raise UserError("query: expected one SELECT without names of the system")
    tables = f"expected one of the tables {', '.join(TABLES)}"
    for node in nodes:
        kind, function = node.get("type"), str(node.get("function_name", "")).casefold()
        if kind == "SHOW_REF":
            raise UserError("query: expected one SELECT. The tool `tables` describes the tables.")
        if kind == "BASE_TABLE":
            path = [part for part in (node.get("catalog_name"), node.get("schema_name"), node["table_name"]) if part]
            if len(path) > 1 or path[0].casefold() not in named.union(TABLES):
                raise UserError(f"query: {tables}, got {'.'.join(path)[:100]!r}")
        elif (
            kind == "TABLE_FUNCTION" and (name := node["function"]["function_name"].casefold()) not in _TABLE_FUNCTIONS
        ):
            raise UserError(f"query: {tables}, got the function {name!r}")
        elif kind != "TABLE_FUNCTION" and _REFUSED.fullmatch(function):
            raise UserError(f"query: the function {function!r} is not available")


def _nodes(value: Any) -> Iterator[dict[str, Any]]:
    waiting = [value]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            yield value
        waiting += value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _table(found: "DuckDBPyConnection", limit: int, offset: int) -> dict[str, Any]:
    """Return rows within the bounds, and what was cut."""
    columns = [{"name": str(name), "type": str(kind)} for name, kind, *_ in found.description or ()]
    left, size, shortened = offset, 0, 0
    while left and (skipped := found.fetchmany(min(left, 2048))):
        left -= len(skipped)
    rows: list[list[Any]] = []
    cut: list[str] = []
    while some := found.fetchmany(1):
        row = [_plain(value) for value in some[0]]
        for k, value in enumerate(row):
            if len(text := value if isinstance(value, str) else json.dumps(value)) > MOST_TEXT:
                row[k], shortened = text[:MOST_TEXT] + "…", shortened + 1
        size += len(json.dumps(row))
        if len(rows) == limit or size > MOST_BYTES:
            cut.append(f"rows from row {offset + len(rows):,} on: ask on with this `offset` and an ORDER BY")
            break
        rows.append(row)
    cut += [f"{shortened:,} values to {MOST_TEXT:,} characters"] * (shortened > 0)
    return {"columns": columns, "rows": rows, "cut": cut}


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | str) or (isinstance(value, int) and abs(value) < 1 << 53):
        return value
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value[:MOST_TEXT]]
    return {str(key): _plain(each) for key, each in value.items()} if isinstance(value, dict) else str(value)
