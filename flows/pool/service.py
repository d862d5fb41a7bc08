"""A work pool at Prefect's API: shards asked for, looked at and cancelled, few requests at a time. Importing it imports Prefect."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Literal, TypeAlias, TypeVar
from uuid import UUID

import httpx
from prefect import Task
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import DeploymentUpdate
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Cancelled, Crashed

from vastflow.flows.computing.artifacts import key_of
from vastflow.flows.pool.registration import OtherPool, register_shards, type_of_pool
from vastflow.flows.pool.work_pool import WorkPool, WorkPoolError
from vastflow.producers.faults import did_you_mean
from vastflow.tasks.execution.deployment import BAR, SHARD_ENTRYPOINT, SHARD_FLOW, TAG, ShardDeployment
from vastflow.tasks.execution.job import PoolType
from vastflow.tasks.ledger import CALLED_OFF_S, LATE
from vastflow.tasks.patience import IN_BETWEEN_S, is_away, patiently
from vastflow.tasks.server import PrefectUnavailable

_WAITING: Final = ("SCHEDULED", "PENDING", "PAUSED")
_ENDED: Final = ("COMPLETED", "FAILED", "CRASHED", "CANCELLED")
_PAGE: Final = 200
_AT_A_TIME: Final = 50
"""Most flow runs whose state one request may change."""
_LATE: Final = timedelta(seconds=2 * CALLED_OFF_S)
"""After so long no worker will end what was cancelled, whatever the clocks of server and campaign."""

Standing: TypeAlias = Literal["waiting", "taken", "running", "ended"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Seen:
    """A shard's flow run, as the server has it.

    Attributes:
        standing: `taken` is what a worker has and has not begun yet.
        state: Name of the state, such as `Completed`.
        beat: What the flow run said last of itself; it changes every few seconds while it lives.
    """

    standing: Standing
    state: str
    message: str
    beat: str


class PoolService:
    """One campaign's flow runs in a work pool.

    Args:
        campaign: The campaign's name.
        parent: Id of the flow run whose children the shards are.
        job_variables: Kind of the pool to what the campaign sets of its template.
        workers: Kind of the pool to the worker processes of a shard; None for one a core.
        say: Writes a line for the user.
        ended: Whether nobody waits for an answer any more.

    Attributes:
        kind: Of the pool.

    Raises:
        WorkPoolError: there is no such pool, or it is of a kind that vastflow has no shards for.
        PrefectUnavailable: the API does not answer.
    """

    def __init__(
        self,
        client: SyncPrefectClient,
        pool: WorkPool,
        campaign: str,
        parent: UUID,
        store: str,
        job_variables: Callable[[PoolType], Mapping[str, Any]],
        workers: Callable[[PoolType], int | None],
        say: Callable[[str], None],
        ended: Callable[[], bool] = lambda: False,
    ) -> None:
        self._client = client
        self._pool = pool
        self._campaign = campaign
        self._parent = parent
        self._store = store
        self._say = say
        self._ended = ended
        self._asked_for = 0
        self.kind = self._kind()
        self._workers = workers(self.kind)
        self._job_variables = dict(job_variables(self.kind))
        self._deployment = self._asked(self._registered)
        self._end_cancelled()

    def submit(self, parcel: str, name: str) -> str:
        """Ask for a shard; gives the id of its flow run."""
        self._asked_for += 1
        number = self._asked_for
        deployment = f"{SHARD_FLOW}/{self._pool.name}"
        shown = self._asked(
            lambda: self._client.create_task_run(
                Task(lambda: None, name=deployment), self._parent, dynamic_key=f"shard-{number}", name=name
            )
        )
        parameters = {"store": self._store, "parcel": parcel, "workers": self._workers}
        asked = self._asked(
            lambda: self._client.create_flow_run_from_deployment(
                self._deployment,
                parameters={key: value for key, value in parameters.items() if value is not None},
                name=name,
                tags=[TAG, key_of(self._campaign)],
                idempotency_key=f"{self._parent} {number}",  # should the answer get lost
                parent_task_run_id=shown.id,
                job_variables=self._job_variables,
            )
        )
        return str(asked.id)

    def seen(self, ids: Collection[str]) -> dict[str, Seen]:
        """Flow runs as they are now, in two requests for each 200; one that somebody deleted is missing."""
        found: dict[str, Seen] = {}
        every = sorted(ids)
        for begin in range(0, len(every), _PAGE):
            some = every[begin : begin + _PAGE]
            wanted: dict[str, Any] = {"flow_runs": {"id": {"any_": some}}, "limit": _PAGE}
            runs = self._asked(lambda wanted=wanted: self._client.request("POST", "/flow_runs/filter", json=wanted))
            key = {"any_": [f"{key_of(self._campaign)}-{BAR}"]}
            bars = {"artifacts": {"flow_run_id": {"any_": some}, "key": key}, "limit": _PAGE, "sort": "UPDATED_DESC"}
            answer = self._asked(lambda bars=bars: self._client.request("POST", "/artifacts/filter", json=bars))
            beats = {bar["flow_run_id"]: bar["description"] for bar in reversed(answer.json())}
            found |= {run["id"]: _seen(run, beats.get(run["id"], "")) for run in runs.json()}
        return found

    def cancel(self, ids: Collection[str]) -> None:
        """Cancel flow runs that have not ended; asked for once, for the caller is about to end."""
        every = sorted(ids)
        for begin in range(0, len(every), _AT_A_TIME):
            some = {"id": {"any_": every[begin : begin + _AT_A_TIME]}, "state": {"type": {"not_any_": list(_ENDED)}}}
            wanted = {"flow_runs": some, "state": {"type": "CANCELLING"}, "limit": _AT_A_TIME}
            self._client.request("POST", "/flow_runs/bulk_set_state", json=wanted)

    def give_up(self, flow_run: str, why: str) -> None:
        """Say that a flow run has crashed which can't say so itself."""
        self._asked(lambda: self._client.set_flow_run_state(flow_run, Crashed(message=why), force=True))

    def workers_online(self) -> int:
        """How many workers of the pool have been heard of lately."""
        workers = self._asked(lambda: self._client.read_workers_for_work_pool(self._pool.name))
        return sum(str(worker.status.value) == "ONLINE" for worker in workers if worker.status is not None)

    def _kind(self) -> PoolType:
        try:
            kind = self._asked(lambda: type_of_pool(self._client, self._pool.name))
        except OtherPool as error:
            raise WorkPoolError(f"--pool: {error}") from None
        if kind is None:
            names = [pool.name for pool in self._asked(self._client.read_work_pools)]
            make = f"make it: prefect work-pool create {self._pool.name} --type process"
            near = f"{did_you_mean(self._pool.name, names)}, or " if names else ""
            raise WorkPoolError(f"--pool: no work pool {self._pool.name!r}; {near}{make}")
        return kind

    def _registered(self) -> UUID:
        """The pool's deployment; made if it is missing, else left as `vastflow deploy` or somebody else made it.

        Only the place of the flow is set anew where another version of vastflow had it elsewhere.
        """
        try:
            found = self._client.read_deployment_by_name(f"{SHARD_FLOW}/{self._pool.name}")
        except ObjectNotFound:
            return UUID(register_shards(self._client, ShardDeployment(self._pool.name)))
        if found.entrypoint != SHARD_ENTRYPOINT:
            self._client.update_deployment(found.id, DeploymentUpdate(entrypoint=SHARD_ENTRYPOINT))
        return found.id

    def _end_cancelled(self) -> None:
        """End what an earlier campaign cancelled as it ended by itself: Prefect would show it as `Cancelling` for ever."""
        some = {"deployment_id": {"any_": [str(self._deployment)]}, "state": {"type": {"any_": ["CANCELLING"]}}}
        wanted = {"flow_runs": some, "limit": _PAGE}
        for run in self._asked(lambda: self._client.request("POST", "/flow_runs/filter", json=wanted)).json():
            since = datetime.fromisoformat(run["state"]["timestamp"])
            if datetime.now(UTC) - since > _LATE:
                state = Cancelled(message=LATE)
                self._asked(lambda of=run, to=state: self._client.set_flow_run_state(of["id"], to, force=True))

    def _asked(self, request: Callable[[], T]) -> T:
        """Ask the API, again and again while it is away.

        Raises:
            PrefectUnavailable: it stayed away.
        """
        try:
            return patiently(request, IN_BETWEEN_S, self._ended, self._missed)
        except (httpx.TransportError, PrefectHTTPStatusError) as error:
            if not is_away(error):
                raise
            raise PrefectUnavailable(
                f"Prefect's API at {self._client.api_url} has not answered for {IN_BETWEEN_S:.0f} s "
                f"({type(error).__name__}); start it again"
            ) from None

    def _missed(self, error: Exception) -> None:
        away = f"Prefect's API at {self._client.api_url} does not answer ({type(error).__name__})"
        self._say(f"{away}; the campaign waits {IN_BETWEEN_S:.0f} s for it")


def _seen(run: Mapping[str, Any], beat: str) -> Seen:
    state = run["state"] or {"type": "SCHEDULED", "name": "Scheduled", "message": ""}
    standing: Standing = "running"
    if state["type"] in _ENDED:
        standing = "ended"
    elif state["type"] in _WAITING:
        standing = "taken" if state["type"] == "PENDING" else "waiting"
    return Seen(standing, state["name"], state["message"] or "", beat)
