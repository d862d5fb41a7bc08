"""Prefect's API, as a process of its own: `python -m vastflow.tasks.api_server [PORT [RECORD IDLE_S]]`.

On standard output it says what a user should hear, a line each, and then its port. It ends when its standard input does: with
the process that started it, however that one died. Prefect's own temporary server outlives a killed flow, and dies of the flow's Ctrl-C.
With a record it is a kept server, see `vastflow.tasks.kept_server`, and says the same there.
"""

import gc
import os
import socket
import sys
import threading
from datetime import datetime
from pathlib import Path

from vastflow.tasks.prefect_adapter import SERVER_APPLICATION, database_url
from vastflow.tasks.prefect_database import set_aside_if_damaged


def main() -> None:
    """Serve until standard input ends, or a kept server is idle."""
    gc.disable()  # until all is imported, which leaves no garbage: looking for some takes an eighth of the start
    record = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    if record is None:
        threading.Thread(target=_end_with_parent, daemon=True).start()
    connection_url = database_url()
    found = set_aside_if_damaged(connection_url, datetime.now()) if connection_url else None
    if found:
        print(found, flush=True)
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # elsewhere this means that two may listen at once
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the port of one that was killed just now
    listener.bind(("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 0))  # 0: any free port, held from now on
    if record is not None:
        from vastflow.tasks.kept_server import end_when_idle, write_record

        write_record(record, listener.getsockname()[1], [found] if found else [])
        threading.Thread(target=end_when_idle, args=(record, float(sys.argv[3])), daemon=True).start()
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
