"""`vastflow deploy --kubernetes`: a campaign with a Dask cluster for `kubectl apply -k`."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import kubernetes_validate
import pytest
import yaml
from command_line import called, refused
from table import each_row

from vastflow.flows.request.run_request import command_line, request_of
from vastflow.flows.terminal.ending import BAD_INPUT
from vastflow.tasks.prefect.deployment import NAME
from vastflow.tasks.prefect.kustomization import SECRET_FILE, scheduler_address

SCHEDULER = scheduler_address("two-rooms")
STORE = ("--store", "s3://lab/store")


@pytest.fixture
def file(campaign_file, tmp_path, monkeypatch):
    """A campaign file below the working directory with resources, variables, and labels."""
    monkeypatch.chdir(tmp_path)
    campaign_file(
        "  resources: {cpu: 2, memory: 6Gi}\n  env: [PRICE: $5]\n  kubernetes: {jobs: {node_labels: {disk: ssd}, tolerations: [{key: spot, operator: Exists}]}}\n"
    )
    return "rooms.vast"


def documents(folder, name):
    return list(yaml.safe_load_all((folder / name).read_text()))


def written(folder, file, *options):
    result = called("deploy", file, "--kubernetes", folder, *STORE, *options)
    assert result.exit_code == 0, result.output
    return result.stdout


def valid(manifest):
    kubernetes_validate.validate(manifest, kubernetes_validate.latest_version(), strict=True)


def container_of(manifest):
    (container,) = manifest["spec"]["template"]["spec"]["containers"]
    return container


def sidecar_of(manifest):
    (sidecar,) = (each for each in manifest["spec"]["template"]["spec"]["initContainers"] if "restartPolicy" in each)
    assert sidecar["restartPolicy"] == "Always"
    return sidecar


def resources_of(folder):
    """The kustomization, and what `kubectl apply -k` applies, and `kubectl delete -k` deletes."""
    (kustomization,) = documents(folder, "kustomization.yaml")
    return kustomization, [each for name in kustomization["resources"] for each in documents(folder, name)]


def selects(selector, manifest):
    return selector.items() <= manifest["spec"]["template"]["metadata"]["labels"].items()


def test_deploy_writes_folder_for_kubectl(file, tmp_path):
    folder = tmp_path / "cluster"
    said = written(folder, file, "--workers", "20", "--image", "lab/vastflow:7", "--queue", "night", "--runs", "3")
    assert f"kubectl apply -k {folder}" in said and "logs -f job/two-rooms -c campaign" in said
    _, resources = resources_of(folder)
    for each in resources:
        valid(each)
    assert len({(each["kind"], each["metadata"]["name"]) for each in resources}) == len(resources)
    campaign, _, service, workers = resources
    (port,) = service["spec"]["ports"]
    scheduler = sidecar_of(campaign)
    assert selects(service["spec"]["selector"], campaign) and not selects(service["spec"]["selector"], workers)
    assert f"tcp://{service['metadata']['name']}:{port['port']}" == SCHEDULER
    script, *options = container_of(workers)["args"][2:]
    assert "dask worker" in script and options[:2] == ["worker", SCHEDULER]
    for each in (scheduler, container_of(workers)):  # else Dask serves HTTP to the whole network
        assert each["args"][-3:] == ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    assert workers["spec"]["completions"] == workers["spec"]["parallelism"] == 20
    assert container_of(workers)["resources"] == {
        "requests": {"cpu": "2", "memory": "6Gi"},
        "limits": {"memory": "6Gi"},
    }
    assert {"name": "PRICE", "value": "$$5"} in container_of(workers)["env"]
    pod = workers["spec"]["template"]["spec"]
    assert (pod["nodeSelector"], pod["tolerations"]) == ({"disk": "ssd"}, [{"key": "spot", "operator": "Exists"}])
    places = {"cluster": SCHEDULER, "store": "s3://lab/store", "results": "s3://lab/store-results", "workers": 1}
    assert container_of(campaign)["args"] == ["vastflow", "run", *command_line(request_of(file, {**places, "runs": 3}))]
    images = {each["image"] for each in (scheduler, container_of(workers), container_of(campaign))}
    assert images == {"lab/vastflow:7"}
    _, cluster, local = documents(folder, "queues.yaml")
    queued = {each["metadata"]["labels"]["kueue.x-k8s.io/queue-name"] for each in (workers, campaign)}
    assert queued == {local["metadata"]["name"]} == {"night"}
    (quota,) = cluster["spec"]["resourceGroups"][0]["flavors"]
    cpu, memory = (each["nominalQuota"] for each in quota["resources"])
    assert (cpu, memory) == ("42", "126Gi")


def test_deleting_a_campaign_leaves_namespace_and_secrets_of_others(file, tmp_path):
    folder = tmp_path / "cluster"
    assert f"once: kubectl apply -f {folder / 'namespace.yaml'}" in written(folder, file)
    kustomization, resources = resources_of(folder)
    (namespace,) = documents(folder, "namespace.yaml")
    valid(namespace)
    assert namespace["metadata"]["name"] == kustomization["namespace"] == NAME
    assert "Namespace" not in {each["kind"] for each in resources}
    names = [each["metadata"]["name"] for each in (*kustomization["secretGenerator"], *resources) if "metadata" in each]
    names += [each["name"] for each in kustomization["secretGenerator"]]
    assert all(name.startswith("two-rooms") for name in names)  # and so two campaigns share the namespace


def test_campaign_ends_its_cluster_and_frees_its_quota(file, tmp_path):
    written(tmp_path / "cluster", file)
    _, resources = resources_of(tmp_path / "cluster")
    campaign, _, _, workers = resources
    assert {each["kind"] for each in resources} == {"Job", "NetworkPolicy", "Service"}  # nothing runs but Jobs
    for job in (campaign, workers):
        assert job["spec"]["ttlSecondsAfterFinished"] > 0
        assert job["spec"]["template"]["spec"]["restartPolicy"] == "Never"
    mistake = campaign["spec"]["podFailurePolicy"]["rules"][-1]
    assert (mistake["action"], mistake["onExitCodes"]["values"]) == ("FailJob", [BAD_INPUT])


def test_cluster_is_reached_by_pods_of_its_campaign_with_what_they_need(file, tmp_path):
    written(tmp_path / "cluster", file)
    kustomization, (campaign, policy, _, workers) = resources_of(tmp_path / "cluster")
    pods = policy["spec"]["podSelector"]["matchLabels"]
    ((peer,),) = (each["from"] for each in policy["spec"]["ingress"])
    assert selects(pods, campaign) and selects(pods, workers) and pods == peer["podSelector"]["matchLabels"]
    scheduler = sidecar_of(campaign)
    assert "envFrom" not in scheduler and "AWS" not in str(scheduler)
    assert scheduler["startupProbe"]["tcpSocket"] == scheduler["livenessProbe"]["tcpSocket"] == {"port": "tcp-comm"}
    (secret,) = (each["name"] for each in kustomization["secretGenerator"])
    for job in (campaign, workers):
        assert container_of(job)["envFrom"] == [{"secretRef": {"name": secret}}]
        pod = job["spec"]["template"]["spec"]
        assert pod["imagePullSecrets"] == [{"name": "vastflow-registry"}]
        for container in (*pod["initContainers"], *pod["containers"]):
            assert container["securityContext"]["readOnlyRootFilesystem"] is True
            if container["name"] != "cache":
                folders = {each["mountPath"] for each in container["volumeMounts"]}
                env = {each["name"]: each["value"] for each in container["env"]}
                assert {env["HOME"], env["XDG_CACHE_HOME"], "/dev/shm"} <= folders


def _script(file, folder, address, wait_s):
    """The workers' own command, with another address and short waits."""
    written(folder, file)
    *_, workers = resources_of(folder)[1]
    args = container_of(workers)["args"]
    for asked, short in (("86400", "60"), ("300", str(wait_s))):
        assert asked in args[2]
        args[2] = args[2].replace(asked, short)
    return [address if each == SCHEDULER else each for each in args]


@each_row(("waits_s", "code", "calls"), [("86400", 1, 1), ("0", 0, 2)])
def test_worker_that_fails_comes_back_and_one_whose_campaign_never_came_ends(
    file, tmp_path, monkeypatch, waits_s, code, calls
):
    stub, log = tmp_path / "bin" / "dask", tmp_path / "log"
    stub.parent.mkdir()
    stub.write_text(f"#!/bin/sh\necho called >> {log}\nexit 1\n")  # as a worker does at its --death-timeout
    stub.chmod(0o755)
    monkeypatch.setenv("PATH", str(stub.parent), prepend=os.pathsep)
    written(tmp_path / "cluster", file)
    args = [each.replace("86400", waits_s) for each in container_of(resources_of(tmp_path / "cluster")[1][-1])["args"]]
    assert subprocess.run(args, timeout=60, check=False).returncode == code
    assert log.read_text().count("called") == calls


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_worker_outlives_a_scheduler_that_comes_back_and_ends_after_the_last(file, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = _script(file, tmp_path / "cluster", f"tcp://127.0.0.1:{port}", 30)
    scheduler = ["dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--dashboard-address", "127.0.0.1:0"]
    log = tmp_path / "worker.log"
    with log.open("wb") as output:
        workers = [subprocess.Popen(command, stderr=output, start_new_session=True) for _ in range(2)]
    try:
        for expected in (2, 1):
            with subprocess.Popen(scheduler, stderr=subprocess.PIPE, text=True) as process:
                for _ in range(expected):
                    next(line for line in process.stderr if "Register worker" in line)
                # A nanny whose scheduler ends before it is registered fails, and its pod comes back.
                with distributed.Client(f"tcp://127.0.0.1:{port}", timeout=60) as client:
                    client.wait_for_workers(expected, timeout=60)
                    assert len(client.run(os.getpid)) == expected
                if expected == 2:
                    workers[1].terminate()
                    assert workers[1].wait(60) == 143  # an evicted pod has failed, and another one takes its place
                process.terminate()
                process.stderr.read()
        assert workers[0].wait(200) == 0
    finally:
        for each in workers:
            with suppress(ProcessLookupError):
                os.killpg(each.pid, signal.SIGKILL)


def test_secret_is_template_that_is_kept(file, tmp_path):
    folder = tmp_path / "cluster"
    written(folder, file)
    secret = folder / SECRET_FILE
    assert "AWS_SECRET_ACCESS_KEY=\n" in secret.read_text() and secret.stat().st_mode & 0o077 == 0
    (kustomization,) = documents(folder, "kustomization.yaml")
    (generated,) = kustomization["secretGenerator"]
    assert generated["envs"] == [SECRET_FILE]
    secret.write_text("AWS_ACCESS_KEY_ID=mine\n")
    written(folder, file, "--workers", "2")
    assert secret.read_text() == "AWS_ACCESS_KEY_ID=mine\n"


def test_operator_gets_pods_of_campaign_scheduler_and_workers(file, tmp_path):
    assert f"kubectl -n {NAME} logs -f two-rooms-runner" in written(tmp_path / "cluster", file, "--operator")
    _, (policy, job) = resources_of(tmp_path / "cluster")
    valid(policy)
    assert (job["apiVersion"], job["kind"]) == ("kubernetes.dask.org/v1", "DaskJob")
    cluster, campaign = job["spec"]["cluster"]["spec"], job["spec"]["job"]["spec"]
    scheduler, worker = cluster["scheduler"], cluster["worker"]
    labels = {"dask.org/cluster-name": job["metadata"]["name"]}  # which the operator gives all three
    assert policy["spec"]["podSelector"]["matchLabels"] == labels
    for kind, pod in (
        ("apps/v1 Deployment", scheduler["spec"]),
        ("apps/v1 Deployment", worker["spec"]),
        ("v1 Pod", campaign),
    ):
        version, _, kind = kind.partition(" ")
        template = {"metadata": {"labels": labels}, "spec": pod}
        spec = {"replicas": 1, "selector": {"matchLabels": labels}, "template": template}
        valid(
            {"apiVersion": version, "kind": kind, "metadata": {"name": "dask"}, "spec": pod if kind == "Pod" else spec}
        )
    (port,) = scheduler["service"]["ports"]
    assert port["targetPort"] in {each["name"] for each in scheduler["spec"]["containers"][0]["ports"]}
    assert f"tcp://{job['metadata']['name']}-scheduler:{port['port']}" == SCHEDULER
    assert worker["replicas"] == 8


def test_deploy_refuses_options_that_exclude_each_other(file, tmp_path):
    for options, said in (
        ((), "expected one of --pool and --kubernetes, got none"),
        (("--pool", "lab", "--kubernetes", "folder"), "--kubernetes, got --pool and --kubernetes"),
        (("--pool", "lab", "--operator"), "--operator: requires --kubernetes"),
        (("--kubernetes", tmp_path / "k"), "--store: expected an address that all pods reach"),
        (("--kubernetes", tmp_path / "k", *STORE, "--cluster", "local:2"), "--cluster: --kubernetes makes a cluster"),
    ):
        assert said in refused("deploy", file, *options)
    assert not (tmp_path / "k").exists()
