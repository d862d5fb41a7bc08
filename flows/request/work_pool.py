"""A work pool of Prefect that computes a campaign's shards."""

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


class WorkersFailed(RuntimeError):
    """The workers of a pool can't compute the campaign; says why and what would help."""


@dataclass(frozen=True, slots=True)
class WorkPool:
    """The work pool that computes a campaign's shards.

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
            raise UserError("--pool: expected the name of a work pool, got an empty name")
        if self.shards is not None and self.shards < 1:
            raise UserError(f"--shards: expected 1 or more, got {self.shards}")


def check_api(log: Path) -> None:
    """See to it before anything is computed that there is an API whose workers could take shards.

    Args:
        log: File for what Prefect says when it is imported.

    Raises:
        UserError: none is configured.
    """
    from vastflow.tasks.prefect import campaign_log
    from vastflow.tasks.prefect.server import configured_url

    with campaign_log.prefect_log(log):
        if configured_url() is None:
            raise UserError(NO_API)


def shard_count(pool: WorkPool, configurations: int, runs: int) -> int:
    """Return the target number of shards.

    Args:
        configurations: With something missing.
        runs: That are missing, or whose verdicts are.
    """
    wanted = min(SHARDS, -(-runs // RUNS_A_SHARD)) if pool.shards is None else pool.shards
    return max(1, min(wanted, configurations))
