"""Requests of a work pool's service: patient with a server that is away, and few."""

import uuid
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import httpx
import pytest
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError

from vastflow.flows.pool import service as pool_service
from vastflow.flows.pool.service import PoolService, Seen
from vastflow.flows.pool.work_pool import WorkPool, WorkPoolError
from vastflow.tasks import patience
from vastflow.tasks.execution.deployment import SHARD_ENTRYPOINT
from vastflow.tasks.execution.job import PoolType
from vastflow.tasks.server import PrefectUnavailable

PARENT = uuid.uuid4()


def refused(status):
    request = httpx.Request("POST", "http://api")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


class Client:
    """Prefect's client as far as it is asked; `away` are what it raises first, one a request."""

    api_url = "http://lab:4200/api"

    def __init__(self, kind="process", away=()):
        self.kind, self.away, self.asked, self.created = kind, list(away), [], []
        self.cancelling, self.ended, self.moved, self.entrypoint = [], [], [], SHARD_ENTRYPOINT

    def _maybe_away(self):
        if self.away:
            raise self.away.pop(0)

    def read_work_pool(self, name):
        if name != "lab":
            raise ObjectNotFound(RuntimeError())
        return SimpleNamespace(name=name, type=self.kind)

    def read_work_pools(self):
        return [SimpleNamespace(name="lab")]

    def read_deployment_by_name(self, name):
        assert name == "vastflow-shard/lab"
        return SimpleNamespace(id="the-deployment", entrypoint=self.entrypoint)

    def update_deployment(self, deployment, update):
        self.moved.append((deployment, update.model_dump(exclude_unset=True)))

    def create_task_run(self, task, flow_run_id, dynamic_key, name):
        return SimpleNamespace(id=f"task-{dynamic_key}")

    def create_flow_run_from_deployment(self, deployment, **named):
        self._maybe_away()
        self.created.append(named)
        return SimpleNamespace(id="the-run")

    def set_flow_run_state(self, flow_run, state, force):
        self.ended.append((flow_run, state.name, force))

    def request(self, method, path, json):
        self._maybe_away()
        if "deployment_id" not in json["flow_runs" if "flow_runs" in json else "artifacts"]:
            self.asked.append((path, json))
        if path == "/flow_runs/filter" and "deployment_id" in json["flow_runs"]:
            return SimpleNamespace(json=lambda: self.cancelling)
        if path == "/flow_runs/filter":
            ids = json["flow_runs"]["id"]["any_"]
            state = {"type": "RUNNING", "name": "Running", "message": None}
            return SimpleNamespace(json=lambda: [{"id": each, "state": state} for each in ids])
        return SimpleNamespace(json=lambda: [{"flow_run_id": "a", "description": "3 of 4"}])


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(patience, "_PAUSE_S", 0.01)
    monkeypatch.setattr(pool_service, "IN_BETWEEN_S", 0.2)


def service(client, name="lab", say=lambda line: None, ended=lambda: False):
    variables = {PoolType.kubernetes: {"cpu": "3"}}
    return PoolService(
        client,
        WorkPool(name),
        "Two rooms",
        PARENT,
        "s3://bucket/store",
        lambda kind: variables.get(kind, {}),
        lambda kind: 3 if kind is PoolType.kubernetes else None,
        say,
        ended,
    )


def test_a_shard_is_asked_for_by_name_tags_parcel_and_what_the_campaign_wants_of_its_container():
    client = Client("kubernetes")
    assert service(client).submit("parcel/ab/abc", "12–15 of hall") == "the-run"
    (asked,) = client.created
    assert asked["parameters"] == {"store": "s3://bucket/store", "parcel": "parcel/ab/abc", "workers": 3}
    assert (asked["name"], asked["tags"]) == ("12–15 of hall", ["vastflow", "two-rooms"])
    assert (asked["job_variables"], asked["parent_task_run_id"]) == ({"cpu": "3"}, "task-shard-1")


def test_workers_decide_how_many_processes_they_start_where_nobody_says():
    client = Client()
    service(client).submit("parcel/ab/abc", "1 of hall")
    assert "workers" not in client.created[0]["parameters"]


def test_a_request_whose_answer_got_lost_is_repeated_as_the_same_one():
    client = Client(away=[httpx.ReadTimeout("slow"), refused(503)])
    service(client).submit("parcel/ab/abc", "1 of hall")
    assert client.created[0]["idempotency_key"] == f"{PARENT} 1"


def test_states_and_signs_of_life_take_two_requests_for_all_shards():
    client = Client()
    seen = service(client).seen({"a", "b"})
    assert seen == {"a": Seen("running", "Running", "", "3 of 4"), "b": Seen("running", "Running", "", "")}
    assert [path for path, _ in client.asked] == ["/flow_runs/filter", "/artifacts/filter"]
    assert client.asked[1][1]["artifacts"]["key"] == {"any_": ["two-rooms-shard"]}


def test_shards_are_cancelled_fifty_a_request():
    client = Client()
    service(client).cancel({f"run-{k}" for k in range(120)})
    sizes = [len(json["flow_runs"]["id"]["any_"]) for _, json in client.asked]
    assert sizes == [50, 50, 20]


def test_a_server_that_stays_away_is_said_at_once_and_then_given_up_and_named():
    client, said = Client(), []
    found = service(client, say=said.append)
    client.away = [httpx.ConnectError("refused")] * 1000
    with pytest.raises(
        PrefectUnavailable, match=r"http://lab:4200/api has not answered for 0 s .ConnectError.; start it"
    ):
        found.seen({"a"})
    assert said == [
        "Prefect's API at http://lab:4200/api does not answer (ConnectError); the campaign waits 0 s for it"
    ]


def test_nobody_waits_for_a_server_when_the_campaign_was_ended():
    client = Client()
    found = service(client, ended=lambda: True)
    client.away = [httpx.ConnectError("refused")] * 2
    with pytest.raises(PrefectUnavailable):
        found.seen({"a"})
    assert len(client.away) == 1


def test_what_the_server_refuses_is_not_repeated():
    client = Client()
    found = service(client)
    client.away = [refused(409)] * 2
    with pytest.raises(PrefectHTTPStatusError, match="no"):
        found.seen({"a"})
    assert len(client.away) == 1


def test_a_pool_that_is_not_there_is_said_with_the_nearest_name():
    with pytest.raises(
        WorkPoolError, match=r"--pool: no work pool 'lap'; did you mean 'lab'.*prefect work-pool create lap"
    ):
        service(Client(), "lap")


def test_a_pool_of_another_kind_is_refused():
    with pytest.raises(WorkPoolError, match="--pool: the work pool 'lab' is of type 'ecs'; one of process, docker"):
        service(Client("ecs"))


def test_what_was_cancelled_as_it_ended_by_itself_is_ended_by_the_next_campaign():
    client, now = Client(), datetime.now(UTC)
    ages_s = {"just": 5.0, "stuck": 3600.0}
    client.cancelling = [
        {"id": name, "state": {"timestamp": (now - timedelta(seconds=age_s)).isoformat()}}
        for name, age_s in ages_s.items()
    ]
    service(client)
    assert client.ended == [("stuck", "Cancelled", True)]


def test_a_deployment_of_another_version_is_told_where_the_flow_is_now_and_else_left_alone():
    client = Client()
    service(client)
    assert client.moved == []
    client.entrypoint = "vastflow.flows.elsewhere.run_shard"
    service(client)
    assert client.moved == [("the-deployment", {"entrypoint": SHARD_ENTRYPOINT})]
