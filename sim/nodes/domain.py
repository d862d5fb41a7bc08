"""Domains of ROS 2: each run has one of its own on this machine while it lives."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from vastflow.sim.model.faults import ScenarioError

DOMAINS: Final = range(1, 102)
"""Ids whose UDP ports lie below Linux's ephemeral ones; 0 is everybody's."""


@contextmanager
def own_domain() -> Iterator[tuple[int, int]]:
    """Yield the id of a domain that no other run on this machine has, and the descriptor that holds it.

    It is free again when every copy of the descriptor is closed, however their processes end.

    Raises:
        ScenarioError: all are taken.
    """
    folder = Path(tempfile.gettempdir()) / "vastflow-ros-domains"
    folder.mkdir(exist_ok=True)
    with suppress(PermissionError):  # another user made it
        folder.chmod(0o1777)
    for number in DOMAINS:
        try:
            descriptor = os.open(folder / str(number), os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        except PermissionError:  # another user's
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            continue
        try:
            yield number, descriptor
        finally:
            os.close(descriptor)
        return
    raise ScenarioError(f"all {len(DOMAINS)} domains of ROS 2 on this machine are taken by other runs")
