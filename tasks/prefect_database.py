"""The database of Prefect's embedded API: one that is damaged is set aside, and a new one is made."""

import contextlib
import sqlite3
from datetime import datetime
from pathlib import Path
from typing import Final
from urllib.parse import unquote

_SQLITE: Final = "sqlite+aiosqlite:///"


def set_aside_if_damaged(connection_url: str, now: datetime) -> str | None:
    """Rename the database behind `connection_url` if SQLite can't read it; Prefect makes a new one where none is.

    Prefect's account of earlier flow runs is in it, and no result.

    Returns:
        What was found and done, in a sentence; None for a sound one, and for a database that is no file.
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
    return f"Prefect's database {database} is damaged ({damage}); it is now {aside.name}, and a new one is made"


def _damage(database: Path) -> str | None:
    """What SQLite says is wrong; a database that another process has locked is no damage."""
    try:
        with contextlib.closing(sqlite3.connect(database, timeout=1.0)) as connection:
            (found,) = connection.execute("pragma quick_check(1)").fetchone()
    except sqlite3.OperationalError:
        return None
    except sqlite3.DatabaseError as error:
        return str(error)
    return None if found == "ok" else " ".join(str(found).split())
