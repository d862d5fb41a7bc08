"""Write `tasks/prefect/schema.sql`: what the migrations of the installed Prefect make of an empty database.

python tests/proofs/prefect_schema.py
"""

import contextlib
import os
import sqlite3
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

FILE = Path(__file__).parents[2] / "tasks" / "prefect" / "schema.sql"
MIGRATE = "import asyncio; from prefect.server.database import provide_database_interface as of; asyncio.run(of().create_db())"


def migrated(home: Path) -> Path:
    """Migrate the database of an empty home of Prefect."""
    subprocess.run([sys.executable, "-c", MIGRATE], env={**os.environ, "PREFECT_HOME": str(home)}, check=True)
    return home / "prefect.db"


def main() -> None:
    """Write the schema."""
    with (
        tempfile.TemporaryDirectory() as home,
        contextlib.closing(sqlite3.connect(migrated(Path(home)))) as connection,
    ):
        (revision,) = connection.execute("select version_num from alembic_version").fetchone()
        origin = "`python tests/proofs/prefect_schema.py`"
        head = f"-- An empty database of Prefect {version('prefect')} at revision {revision}, by {origin}."
        FILE.write_text("\n".join([head, *connection.iterdump()]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
