"""Prefect's API, as a process of its own: `python -m vastflow.tasks.prefect.api_server [PORT]`.

It prints lines for the user and then its port. It ends with its standard input, and so with the process that started it;
Prefect's own temporary server outlives a killed flow, and dies of the flow's Ctrl-C.
"""

import contextlib
import gc
import os
import socket
import sqlite3
import sys
import threading
from datetime import datetime
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from vastflow.tasks.prefect.adapter import SERVER_APPLICATION, database_url

_SQLITE: Final = "sqlite+aiosqlite:///"


def set_aside_if_damaged(connection_url: str, now: datetime) -> str | None:
    """Rename a database that SQLite can't read, so that Prefect makes a new one.

    Returns:
        A sentence about it; None for a sound database, and for one that is no file.
    """
    place = connection_url.removeprefix(_SQLITE).partition("?")[0]
    database = Path(unquote(place))
    if place == connection_url or not database.is_file():
        return None
    if (damage := _damage(database)) is None:
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
    found = set_aside_if_damaged(connection_url, datetime.now()) if connection_url else None
    if found:
        print(found, flush=True)
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
    config.load()
    gc.freeze()
    gc.enable()
    uvicorn.Server(config).run(sockets=[listener])


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main()
