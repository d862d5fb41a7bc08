"""A work pool of Prefect as the place where a campaign's shards are computed, and what can be wrong with it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vastflow.sim.model.faults import UserError

NO_API: Final = (
    "no API of Prefect is configured; start one by `prefect server start`, and name it by "
    "`prefect config set PREFECT_API_URL=http://127.0.0.1:4200/api`"
)

SHARDS: Final = 50
"""Most shards of a campaign that are aimed at where nobody says: each costs some seconds to start."""
RUNS_A_SHARD: Final = 20
"""For fewer runs no shard is made then."""


class WorkPoolError(UserError, ValueError):
    """A work pool that can't be used as it was asked for; says what was found and what would be right."""


class WorkersFailed(RuntimeError):
    """The workers of a pool can't compute the campaign; says why and what would help."""


@dataclass(frozen=True, slots=True)
class WorkPool:
    """Where a campaign's shards are computed.

    Attributes:
        name: Of the work pool at Prefect's API.
        shards: How many are aimed at; None for as many as the work is worth, see `SHARDS`.
        wait_s: Seconds after which a campaign ends of which no worker has taken anything; None waits on.
    """

    name: str
    shards: int | None = None
    wait_s: float | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise WorkPoolError("--pool: expected the name of a work pool, got an empty name")
        if self.shards is not None and self.shards < 1:
            raise WorkPoolError(f"--shards: expected 1 or more, got {self.shards}")


def check_api(log: Path) -> None:
    """See to it before anything is computed that there is an API whose workers could take shards.

    Args:
        log: File for what Prefect says when it is imported.

    Raises:
        WorkPoolError: none is configured.
    """
    from vastflow.tasks.prefect import campaign_log
    from vastflow.tasks.prefect.server import configured_url

    with campaign_log.prefect_log(log):
        if configured_url() is None:
            raise WorkPoolError(NO_API)


def shard_count(pool: WorkPool, configurations: int, runs: int) -> int:
    """How many shards to aim at.

    Args:
        configurations: With something missing.
        runs: That are missing, or whose verdicts are.
    """
    wanted = min(SHARDS, -(-runs // RUNS_A_SHARD)) if pool.shards is None else pool.shards
    return max(1, min(wanted, configurations))
