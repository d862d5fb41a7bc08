"""Domains of ROS 2: each run has one of its own on this machine while it lives."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from vastflow.sim.model.faults import ScenarioError

DOMAINS: Final = range(1, 102)
"""Ids whose UDP ports lie below Linux's ephemeral ones; 0 is everybody's."""
NAME: Final = "\0vastflow-ros-domain-{}"
"""An abstract socket's, which is taken in the network in which nodes of the domain would meet, whatever folders runs have."""


@contextmanager
def own_domain() -> Iterator[tuple[int, int]]:
    """Yield the id of a domain that no other run on this machine has, and the descriptor that holds it.

    It is free again when every copy of the descriptor is closed, however their processes end.

    Raises:
        ScenarioError: all are taken.
    """
    for number in DOMAINS:
        with socket.socket(socket.AF_UNIX) as holding:
            try:
                holding.bind(NAME.format(number))
            except OSError:  # another run has it
                continue
            yield number, holding.fileno()
            return
    raise ScenarioError(f"all {len(DOMAINS)} domains of ROS 2 on this machine are taken by other runs")
