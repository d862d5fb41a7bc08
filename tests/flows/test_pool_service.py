"""Requests of a work pool's service: patient with a server that is away, and few."""

import uuid
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import httpx
import pytest
from prefect.client.schemas.objects import FlowRun
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Cancelling, Completed, Crashed, Failed, Pending, Running, Scheduled
from table import each_row

from vastflow.flows.campaign import campaign
from vastflow.flows.pool import service as pool_service
from vastflow.flows.pool.service import Asking, PoolService, Seen, pool_type
from vastflow.sim.model.faults import UserError
from vastflow.tasks.prefect import retry
from vastflow.tasks.prefect.deployment import ShardDeployment
from vastflow.tasks.prefect.server import PrefectUnavailable

PARENT = "the-campaign"
DEPLOYMENT = uuid.uuid4()
RUNS = {"a": uuid.UUID(int=1), "b": uuid.UUID(int=2)}


def refused(status):
    request = httpx.Request("POST", "http://api")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


class Client:
    """Prefect's client as far as it is asked; `away` are what it raises first, one a request."""

    api_url = "http://lab:4200/api"

    def __init__(self, kind="process", away=()):
        self.kind, self.away, self.asked, self.created = kind, list(away), [], []
        self.cancelling, self.ended = [], []

    def maybe_away(self):
        if self.away:
            raise self.away.pop(0)

    def read_work_pool(self, name):
        if name != "lab":
            raise ObjectNotFound(RuntimeError())
        return SimpleNamespace(name=name, type=self.kind)

    def read_work_pools(self):
        return [SimpleNamespace(name="lab")]

    def read_deployment_by_name(self, name):
        assert name == ShardDeployment("lab").path
        return SimpleNamespace(id=DEPLOYMENT)

    def run(self, deployment, **named):
        assert deployment == DEPLOYMENT
        self.maybe_away()
        self.created.append(named)
        return SimpleNamespace(id=RUNS["a"])

    def set_flow_run_state(self, flow_run, state, force):
        self.ended.append((flow_run, state.name, force))

    def read_flow_runs(self, flow_run_filter, limit):
        self.maybe_away()
        if flow_run_filter.deployment_id is not None:
            return self.cancelling
        self.asked.append(flow_run_filter.id.any_)
        return [flow_run(each, Running()) for each in flow_run_filter.id.any_]

    def read_artifacts(self, artifact_filter, limit, sort):
        self.asked.append(artifact_filter.key.any_)
        return [SimpleNamespace(flow_run_id=RUNS["a"], description="3 of 4")]

    def request(self, method, path, json):
        self.maybe_away()
        self.asked.append(json)
        return SimpleNamespace(json=dict)


def flow_run(identity, state):
    return FlowRun(id=identity, flow_id=uuid.uuid4(), state=state)


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(retry, "_PAUSE_S", 0.01)
    monkeypatch.setattr(pool_service, "IN_BETWEEN_S", 0.2)


def service(client, monkeypatch, say=lambda line: None, ended=lambda: False, **asked):
    monkeypatch.setattr(pool_service, "run_deployment", client.run)
    asking = Asking(client, say, ended)
    return PoolService(
        asking, "lab", PARENT, "two-rooms", campaign, {"store": "s3://bucket/store", **asked}, {"cpu": "3"}
    )


def test_shard_is_requested_with_name_tags_bundle_and_container(monkeypatch):
    client = Client("kubernetes")
    assert service(client, monkeypatch, workers=3).submit("bundle/ab/abc", "12–15 of hall") == str(RUNS["a"])
    (asked,) = client.created
    assert asked["parameters"] == {"request": {"store": "s3://bucket/store", "bundle": "bundle/ab/abc", "workers": 3}}
    assert (asked["flow_run_name"], asked["tags"]) == ("12–15 of hall", ["vastflow", "two-rooms"])
    assert (asked["job_variables"], asked["timeout"]) == ({"cpu": "3"}, 0)


def test_request_whose_answer_got_lost_is_repeated_as_the_same_one(monkeypatch):
    client = Client()
    found = service(client, monkeypatch)
    client.away = [httpx.ReadTimeout("slow"), refused(503)]
    found.submit("bundle/ab/abc", "1 of hall")
    assert client.created[0]["idempotency_key"] == f"{PARENT} 1"


def test_states_and_signs_of_life_take_two_requests_for_all_shards(monkeypatch):
    client = Client()
    seen = service(client, monkeypatch).seen({str(each) for each in RUNS.values()})
    assert seen == {
        str(RUNS["a"]): Seen("running", "Running", "", "3 of 4"),
        str(RUNS["b"]): Seen("running", "Running", "", ""),
    }
    assert client.asked == [sorted(RUNS.values()), ["two-rooms-shard"]]


@pytest.mark.parametrize(
    ("state", "standing"),
    [
        (Scheduled(), "waiting"),
        (Pending(), "taken"),
        (Running(), "running"),
        (Cancelling(), "running"),
        (Completed(), "ended"),
        (Failed(name="OtherCode", message="arm"), "ended"),
        (Crashed(), "ended"),
    ],
)
def test_state_of_prefects_says_where_a_shard_stands(monkeypatch, state, standing):
    client = Client()
    client.read_flow_runs = lambda flow_run_filter, limit: (
        [flow_run(RUNS["b"], state)] if flow_run_filter.id is not None else []
    )
    (seen,) = service(client, monkeypatch).seen({str(RUNS["b"])}).values()
    assert seen == Seen(standing, state.name, state.message or "", "")


def test_shards_are_cancelled_fifty_a_request(monkeypatch):
    client = Client()
    service(client, monkeypatch).cancel({f"run-{k}" for k in range(120)})
    sizes = [len(asked["flow_runs"]["id"]["any_"]) for asked in client.asked]
    assert sizes == [50, 50, 20]


def test_absent_server_is_reported_at_once_and_given_up_later(monkeypatch):
    client, said = Client(), []
    found = service(client, monkeypatch, say=said.append)
    client.away = [httpx.ConnectError("refused")] * 1000
    with pytest.raises(
        PrefectUnavailable, match=r"http://lab:4200/api has not answered for 0 s .ConnectError.; start it"
    ):
        found.seen({str(RUNS["a"])})
    assert said == [
        "Prefect's API at http://lab:4200/api does not answer (ConnectError); the campaign waits 0 s for it"
    ]


@each_row(
    ("ended", "error", "kind", "words"),
    [
        (True, httpx.ConnectError("refused"), PrefectUnavailable, "http://lab:4200/api"),
        (False, refused(409), PrefectHTTPStatusError, "no"),
    ],
)
def test_request_is_not_repeated_when_campaign_ended_or_server_refuses(monkeypatch, ended, error, kind, words):
    client = Client()
    found = service(client, monkeypatch, ended=lambda: ended)
    client.away = [error] * 2
    with pytest.raises(kind, match=words):
        found.seen({str(RUNS["a"])})
    assert len(client.away) == 1


@each_row(
    ("kind", "name", "words"),
    [
        (
            "process",
            "lap",
            r"--pool: expected an existing work pool, got 'lap'; did you mean 'lab'.*prefect work-pool create lap",
        ),
        ("ecs", "lab", r"--pool: expected a work pool of type process, docker.*, got 'lab' of type 'ecs'"),
    ],
)
def test_pool_that_is_missing_or_of_another_kind_is_refused(kind, name, words):
    with pytest.raises(UserError, match=words):
        pool_type(Asking(Client(kind), print), name)


def test_flow_run_cancelled_at_its_end_is_ended_by_the_next_campaign(monkeypatch):
    client, now = Client(), datetime.now(UTC)
    ages_s = {"a": 5.0, "b": 3600.0}
    client.cancelling = [
        flow_run(RUNS[name], Cancelling(timestamp=now - timedelta(seconds=age_s))) for name, age_s in ages_s.items()
    ]
    service(client, monkeypatch)
    assert client.ended == [(RUNS["b"], "Cancelled", True)]
