"""A work pool at Prefect's API: its deployments and shards. Importing it imports Prefect."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, TypeVar, cast
from uuid import UUID

import httpx
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import DeploymentScheduleCreate, WorkPoolCreate, WorkPoolUpdate
from prefect.client.schemas.filters import (
    ArtifactFilter,
    ArtifactFilterFlowRunId,
    ArtifactFilterKey,
    FlowRunFilter,
    FlowRunFilterDeploymentId,
    FlowRunFilterId,
    FlowRunFilterState,
    FlowRunFilterStateType,
)
from prefect.client.schemas.objects import (
    TERMINAL_STATES,
    ConcurrencyLimitStrategy,
    ConcurrencyOptions,
    FlowRun,
    StateType,
)
from prefect.client.schemas.schedules import CronSchedule
from prefect.client.schemas.sorting import ArtifactSort
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Cancelled, Crashed

from vastflow.flows.request.campaign_file import campaign_name
from vastflow.producers.campaign import Campaign
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.prefect.adapter import flow_schema, post, process_pool_template
from vastflow.tasks.prefect.container_keys import describe
from vastflow.tasks.prefect.deployment import (
    BAR,
    CPU,
    IMAGE,
    TAG,
    PoolType,
    ShardDeployment,
    base_job_template,
    job_variables,
)
from vastflow.tasks.prefect.orphans import CALLED_OFF_S
from vastflow.tasks.prefect.retry import IN_BETWEEN_S, is_away, retried
from vastflow.tasks.prefect.server import PrefectUnavailable, redacted

if TYPE_CHECKING:
    from vastflow.tasks.prefect.containers import RunDescription


def described(campaign: Campaign, context: str | None) -> "RunDescription":
    """Return the run description of a campaign, with the image of its additional containers.

    Args:
        context: Cluster whose resources count; the first that the file names if None.

    Raises:
        FileError: what the file asks can't be described.
    """
    execution = campaign.spec.execution
    if execution.image is None and not execution.secondary_containers:
        execution = execution.model_copy(update={"image": IMAGE})
    spec = campaign.spec.model_copy(update={"execution": execution})
    return describe(replace(campaign, spec=spec), campaign_name(campaign), context)


def requested_cores(kind: PoolType, description: "RunDescription") -> int | None:
    """Return the cores that a Job requests; None for other kinds of pool."""
    return description.main.needs.cpu or CPU if kind is PoolType.kubernetes else None


def asked_of_containers(
    kind: PoolType, campaign: Campaign, workers: int | None
) -> tuple[Mapping[str, Any], int | None]:
    """Return job variables and worker processes of the containers that compute shards.

    Args:
        workers: Worker processes of a shard, if the caller says so; else as many as a Job requests.
    """
    if kind is PoolType.process:
        return {}, workers
    description = described(campaign, None)
    return job_variables(kind, description), workers or requested_cores(kind, description)


def pool_template(kind: PoolType) -> dict[str, Any]:
    """The base job template of a pool."""
    if kind is PoolType.process:
        return process_pool_template()
    return base_job_template(kind)


def register_pool(client: SyncPrefectClient, name: str, kind: PoolType) -> bool:
    """Create the pool, or update its template; an existing process pool is not changed.

    Returns:
        Whether it is new.

    Raises:
        UserError: the pool is of another type.
    """
    try:
        pool = client.read_work_pool(name)
    except ObjectNotFound:
        client.create_work_pool(WorkPoolCreate(name=name, type=kind.value, base_job_template=pool_template(kind)))
        return True
    if pool.type != kind.value:
        raise UserError(
            f"--pool: expected a work pool of type {kind.value!r}, got {name!r} of type {pool.type!r}; give --type {pool.type}"
        )
    if kind is not PoolType.process:
        client.update_work_pool(name, WorkPoolUpdate(base_job_template=pool_template(kind)))
    return False


def type_of_pool(client: SyncPrefectClient, name: str) -> PoolType | None:
    """Return the type of a pool, or None if no pool has this name.

    Raises:
        UserError: vastflow has no use for its type.
    """
    try:
        found = client.read_work_pool(name).type
    except ObjectNotFound:
        return None
    if found not in list(PoolType):
        raise UserError(f"--pool: expected a work pool of type {', '.join(PoolType)}, got {name!r} of type {found!r}")
    return PoolType(found)


def register_flow(client: SyncPrefectClient, entry: Mapping[str, Any], flow: Flow[..., Any]) -> str:
    """Create or update a deployment of a flow, and return its id.

    Args:
        entry: As `prefect.yaml` has it.
    """
    limit = entry.get("concurrency_limit")
    options = limit and ConcurrencyOptions(collision_strategy=ConcurrencyLimitStrategy(limit["collision_strategy"]))
    return str(
        client.create_deployment(
            flow_id=client.create_flow_from_name(flow.name),
            name=entry["name"],
            description=entry["description"],
            tags=entry["tags"],
            entrypoint=entry["entrypoint"],
            parameters=entry["parameters"],
            parameter_openapi_schema=flow_schema(flow),
            enforce_parameter_schema=entry["enforce_parameter_schema"],
            concurrency_limit=limit and limit["limit"],
            concurrency_options=options,
            schedules=[schedule(each["cron"], each["timezone"]) for each in entry["schedules"]],
            pull_steps=entry["pull"],
            work_pool_name=entry["work_pool"]["name"],
            job_variables=entry["work_pool"]["job_variables"],
        )
    )


def schedule(cron: str, timezone: str) -> DeploymentScheduleCreate:
    """A schedule of Prefect's."""
    return DeploymentScheduleCreate(schedule=CronSchedule(cron=cron, timezone=timezone))


def is_cron(text: str) -> bool:
    """Whether `text` is five fields of cron that Prefect can read."""
    try:
        CronSchedule(cron=text)
    except ValueError:
        return False
    return len(text.split()) == 5


_PAGE: Final = 200
_AT_A_TIME: Final = 50
"""Most flow runs whose state one request may change."""
_LATE_AFTER: Final = timedelta(seconds=2 * CALLED_OFF_S)
"""After so long no worker will end what was cancelled, whatever the clocks of server and campaign."""
_LATE: Final = "Its worker is gone, or it ended while it was canceled. What was finished is in the store."

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


@dataclass(frozen=True, slots=True)
class Asking:
    """Prefect's API, asked again and again while it is away.

    Attributes:
        say: Writes a line for the user.
        ended: Whether nobody waits for an answer any more.
    """

    client: SyncPrefectClient
    say: Callable[[str], None]
    ended: Callable[[], bool] = lambda: False

    def __call__(self, request: Callable[[], T]) -> T:
        """The answer to a request.

        Raises:
            PrefectUnavailable: the API stayed away.
        """
        try:
            return retried(request, IN_BETWEEN_S, self.ended, self._missed)
        except (httpx.TransportError, PrefectHTTPStatusError) as error:
            if not is_away(error):
                raise
            raise PrefectUnavailable(
                f"Prefect's API at {redacted(str(self.client.api_url))} has not answered for {IN_BETWEEN_S:.0f} s "
                f"({type(error).__name__}); start it again"
            ) from None

    def _missed(self, error: Exception) -> None:
        away = f"Prefect's API at {redacted(str(self.client.api_url))} does not answer ({type(error).__name__})"
        self.say(f"{away}; the campaign waits {IN_BETWEEN_S:.0f} s for it")


def pool_type(asking: Asking, pool: str) -> PoolType:
    """The type of a work pool that is to compute shards.

    Raises:
        UserError: there is no such pool, or it is of a type that vastflow has no shards for.
        PrefectUnavailable: the API does not answer.
    """
    found = asking(lambda: type_of_pool(asking.client, pool))
    if found is None:
        names = [each.name for each in asking(asking.client.read_work_pools)]
        near = f"{did_you_mean(pool, names)}, or " if names else ""
        make = f"make it: prefect work-pool create {pool} --type process"
        raise UserError(f"--pool: expected an existing work pool, got {pool!r}; {near}{make}")
    return found


class PoolService:
    """One campaign's flow runs in a work pool. To be used in the flow run whose children they are.

    Args:
        pool: Name of the work pool.
        parent: Id of the flow run.
        label: The campaign's name, as the keys of its artifacts have it.
        flow: What a shard's flow run runs.
        request: What every shard is asked beside its bundle.
        job_variables: What the campaign sets of the pool's template.

    Raises:
        PrefectUnavailable: the API does not answer.
    """

    def __init__(
        self,
        asking: Asking,
        pool: str,
        parent: str,
        label: str,
        flow: Flow[..., Any],
        request: Mapping[str, Any],
        job_variables: Mapping[str, Any],
    ) -> None:
        self._asking = asking
        self._client = asking.client
        self._pool = pool
        self._parent = parent
        self._label = label
        self._flow = flow
        self._request = request
        self._job_variables = dict(job_variables)
        self._asked_for = 0
        self._deployment = asking(self._registered)
        self._end_cancelled()

    def submit(self, bundle: str, name: str) -> str:
        """Request a shard, and return the id of its flow run."""
        self._asked_for += 1
        ask = partial(
            run_deployment,
            self._deployment,
            parameters={"request": {**self._request, "bundle": bundle}},
            flow_run_name=name,
            timeout=0,
            tags=[TAG, self._label],
            idempotency_key=f"{self._parent} {self._asked_for}",  # should the answer get lost
            job_variables=self._job_variables,
        )
        return str(cast(FlowRun, self._asking(ask)).id)

    def seen(self, ids: Collection[str]) -> dict[str, Seen]:
        """Flow runs as they are now, in two requests for each 200; one that somebody deleted is missing."""
        found: dict[str, Seen] = {}
        every = sorted(map(UUID, ids))
        for some in (every[begin : begin + _PAGE] for begin in range(0, len(every), _PAGE)):
            chosen = FlowRunFilter(id=FlowRunFilterId(any_=some))
            bars = ArtifactFilter(
                flow_run_id=ArtifactFilterFlowRunId(any_=some), key=ArtifactFilterKey(any_=[f"{self._label}-{BAR}"])
            )
            runs = self._asking(partial(self._client.read_flow_runs, flow_run_filter=chosen, limit=_PAGE))
            latest = ArtifactSort.UPDATED_DESC
            shown = self._asking(partial(self._client.read_artifacts, artifact_filter=bars, limit=_PAGE, sort=latest))
            beats = {bar.flow_run_id: bar.description or "" for bar in reversed(shown)}
            found |= {str(run.id): _seen(run, beats.get(run.id, "")) for run in runs}
        return found

    def cancel(self, ids: Collection[str]) -> None:
        """Cancel flow runs that have not ended, without retries."""
        every = sorted(ids)
        ended = [state.value for state in TERMINAL_STATES]
        for begin in range(0, len(every), _AT_A_TIME):
            some = {"id": {"any_": every[begin : begin + _AT_A_TIME]}, "state": {"type": {"not_any_": ended}}}
            wanted = {"flow_runs": some, "state": {"type": "CANCELLING"}, "limit": _AT_A_TIME}
            post(self._client, "/flow_runs/bulk_set_state", wanted)

    def give_up(self, flow_run: str, why: str) -> None:
        """Say that a flow run has crashed which can't say so itself."""
        self._asking(lambda: self._client.set_flow_run_state(flow_run, Crashed(message=why), force=True))

    def workers_online(self) -> int:
        """Count the pool's online workers."""
        workers = self._asking(lambda: self._client.read_workers_for_work_pool(self._pool))
        return sum(str(worker.status.value) == "ONLINE" for worker in workers if worker.status is not None)

    def _registered(self) -> UUID:
        """The pool's deployment; made if it is missing, else left as `vastflow deploy` or somebody else made it."""
        deployment = ShardDeployment(self._pool)
        try:
            return self._client.read_deployment_by_name(deployment.path).id
        except ObjectNotFound:
            return UUID(register_flow(self._client, deployment.as_yaml(), self._flow))

    def _end_cancelled(self) -> None:
        """End what an earlier campaign cancelled as it ended by itself: Prefect would show it as `Cancelling` for ever."""
        cancelling = FlowRunFilter(
            deployment_id=FlowRunFilterDeploymentId(any_=[self._deployment]),
            state=FlowRunFilterState(type=FlowRunFilterStateType(any_=[StateType.CANCELLING])),
        )
        for run in self._asking(lambda: self._client.read_flow_runs(flow_run_filter=cancelling, limit=_PAGE)):
            if run.state is not None and datetime.now(UTC) - run.state.timestamp > _LATE_AFTER:
                self._asking(partial(self._client.set_flow_run_state, run.id, Cancelled(message=_LATE), force=True))


def _seen(run: FlowRun, beat: str) -> Seen:
    state = run.state
    if state is None:
        return Seen("waiting", "Scheduled", "", beat)
    standing: Standing = "running"
    if state.is_final():
        standing = "ended"
    elif state.is_pending():
        standing = "taken"
    elif state.is_scheduled() or state.is_paused():
        standing = "waiting"
    return Seen(standing, state.name or str(state.type.value), state.message or "", beat)
