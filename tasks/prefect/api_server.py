"""Prefect's API, as a process of its own: `python -m vastflow.tasks.prefect.api_server [PORT]`.

It prints lines for the user and then its port. It ends with its standard input, and so with the process that started it;
Prefect's own temporary server outlives a killed flow, and dies of the flow's Ctrl-C.
"""

import contextlib
import gc
import os
import re
import socket
import sqlite3
import sys
import tempfile
import threading
from datetime import datetime
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from vastflow.tasks.prefect.adapter import SERVER_APPLICATION, database_url, expect_one_application, migrating_at_start

_SQLITE: Final = "sqlite+aiosqlite:///"
_OF_SCHEMA: Final = re.compile(r"Prefect (\S+) at revision (\w+)")


def database_file(connection_url: str) -> Path | None:
    """Return the file of a database, or None for another kind."""
    place = connection_url.removeprefix(_SQLITE).partition("?")[0]
    return None if place == connection_url or place.startswith(":") else Path(unquote(place))


def make_database(database: Path) -> bool:
    """Make a missing database from the shipped schema, as Prefect's migrations take 6 CPU-s.

    Returns:
        True if the database needs no migration by the installed Prefect.
    """
    schema = files("vastflow.tasks.prefect").joinpath("schema.sql").read_text(encoding="utf-8")
    release, revision = _OF_SCHEMA.findall(schema)[0]
    if not database.exists():
        database.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=database.parent, prefix=database.name) as folder:
            new = Path(folder, "new")
            with contextlib.closing(sqlite3.connect(new)) as connection:
                connection.executescript(schema)
            with contextlib.suppress(FileExistsError):  # another server was faster
                os.link(new, database)
    try:
        with contextlib.closing(sqlite3.connect(database, timeout=1.0)) as connection:
            found = connection.execute("select version_num from alembic_version").fetchall()
    except sqlite3.Error:
        return False
    return found == [(revision,)] and version("prefect") == release


def set_aside_if_damaged(database: Path, now: datetime) -> str | None:
    """Rename a database that SQLite can't read.

    Returns:
        A sentence about it; None for a sound database.
    """
    if not database.is_file() or (damage := _damage(database)) is None:
        return None
    aside = database.with_name(f"{database.name}.damaged-{now:%Y-%m-%d-%H%M%S}")
    for suffix in ("", "-wal", "-shm"):
        with contextlib.suppress(FileNotFoundError):
            database.with_name(database.name + suffix).rename(aside.with_name(aside.name + suffix))
    return f"Prefect's database {database} is damaged ({damage}). It is now {aside.name}, and a new one is made"


def _damage(database: Path) -> str | None:
    """Return SQLite's description of the damage; a locked database has none."""
    try:
        with contextlib.closing(sqlite3.connect(database, timeout=1.0)) as connection:
            (found,) = connection.execute("pragma quick_check(1)").fetchone()
    except sqlite3.OperationalError:
        return None
    except sqlite3.DatabaseError as error:
        return str(error)
    return None if found == "ok" else " ".join(str(found).split())


def main() -> None:
    """Serve until standard input ends."""
    gc.disable()  # until all is imported, which leaves no garbage: looking for some takes an eighth of the start
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection_url = database_url()
    database, current = database_file(connection_url or ""), False
    if database is not None:
        if found := set_aside_if_damaged(database, datetime.now()):
            print(found, flush=True)
        with contextlib.suppress(OSError):  # Prefect says what is wrong
            current = make_database(database)
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # elsewhere this means that two may listen at once
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the port of one that was killed just now
    listener.bind(("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 0))  # 0: any free port, held from now on
    print(listener.getsockname()[1], flush=True)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    import uvicorn

    config = uvicorn.Config(
        SERVER_APPLICATION,
        factory=True,
        log_level="error",
        lifespan="on",
        timeout_graceful_shutdown=1,
    )
    expect_one_application()
    config.load()
    gc.freeze()
    gc.enable()
    with migrating_at_start(not current):
        uvicorn.Server(config).run(sockets=[listener])


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main()
