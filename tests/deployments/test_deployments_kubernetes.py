"""`vastflow deploy --kubernetes`: a campaign with a Dask cluster for `kubectl apply -k`."""

import kubernetes_validate
import pytest
import yaml
from command_line import called, refused

from vastflow.flows.request.run_request import command_line, request_of
from vastflow.tasks.prefect.kustomization import SCHEDULER, SECRET_FILE

STORE = ("--store", "s3://lab/store")


@pytest.fixture
def file(campaign_file, tmp_path, monkeypatch):
    """A campaign file below the working directory with resources, variables, and labels."""
    monkeypatch.chdir(tmp_path)
    campaign_file(
        "  resources: {cpu: 2, memory: 6Gi}\n  env: [PRICE: $5]\n  kubernetes: {jobs: {node_labels: {disk: ssd}}}\n"
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


def test_deploy_writes_folder_for_kubectl(file, tmp_path):
    folder = tmp_path / "cluster"
    said = written(folder, file, "--workers", "20", "--image", "lab/vastflow:7", "--queue", "night", "--runs", "3")
    assert f"kubectl apply -k {folder}" in said and "logs -f job/two-rooms" in said
    (kustomization,) = documents(folder, "kustomization.yaml")
    resources = [each for name in kustomization["resources"] for each in documents(folder, name)]
    for each in resources:
        valid(each)
    assert len({(each["kind"], each["metadata"]["name"]) for each in resources}) == len(resources)
    namespace, scheduler, service, workers, campaign = resources
    assert namespace["metadata"]["name"] == kustomization["namespace"]
    assert service["spec"]["selector"].items() <= scheduler["spec"]["template"]["metadata"]["labels"].items()
    (port,) = service["spec"]["ports"]
    assert f"tcp://{service['metadata']['name']}:{port['port']}" == SCHEDULER
    assert container_of(workers)["args"][:3] == ["dask", "worker", SCHEDULER]
    for each in (scheduler, workers):  # else Dask serves HTTP to the whole network
        assert container_of(each)["args"][-3:] == ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    assert workers["spec"]["completions"] == workers["spec"]["parallelism"] == 20
    assert container_of(workers)["resources"] == {
        "requests": {"cpu": "2", "memory": "6Gi"},
        "limits": {"memory": "6Gi"},
    }
    assert {"name": "PRICE", "value": "$$5"} in container_of(workers)["env"]
    assert workers["spec"]["template"]["spec"]["nodeSelector"] == {"disk": "ssd"}
    places = {"cluster": SCHEDULER, "store": "s3://lab/store", "results": "s3://lab/store-results", "workers": 1}
    assert container_of(campaign)["args"] == ["vastflow", "run", *command_line(request_of(file, {**places, "runs": 3}))]
    images = {container_of(each)["image"] for each in (scheduler, workers, campaign)}
    assert images == {"lab/vastflow:7"}
    _, cluster, local = documents(folder, "queues.yaml")
    queued = {each["metadata"]["labels"]["kueue.x-k8s.io/queue-name"] for each in (workers, campaign)}
    assert queued == {local["metadata"]["name"]} == {"night"}
    (quota,) = cluster["spec"]["resourceGroups"][0]["flavors"]
    cpu, memory = (each["nominalQuota"] for each in quota["resources"])
    assert (cpu, memory) == ("41", "124Gi")


def test_secret_is_template_that_is_kept(file, tmp_path):
    folder = tmp_path / "cluster"
    written(folder, file)
    secret = folder / SECRET_FILE
    assert "AWS_SECRET_ACCESS_KEY=\n" in secret.read_text() and secret.stat().st_mode & 0o077 == 0
    (kustomization,) = documents(folder, "kustomization.yaml")
    (generated,) = kustomization["secretGenerator"]
    assert generated["envs"] == [SECRET_FILE]
    (container,) = (container_of(each) for each in documents(folder, "campaign.yaml"))
    assert container["envFrom"][0]["secretRef"]["name"] == generated["name"]
    secret.write_text("AWS_ACCESS_KEY_ID=mine\n")
    written(folder, file, "--workers", "2")
    assert secret.read_text() == "AWS_ACCESS_KEY_ID=mine\n"


def test_operator_gets_pods_of_scheduler_and_workers(file, tmp_path):
    written(tmp_path / "cluster", file, "--operator")
    (cluster,) = documents(tmp_path / "cluster", "dask.yaml")
    assert (cluster["apiVersion"], cluster["kind"]) == ("kubernetes.dask.org/v1", "DaskCluster")
    scheduler, worker = cluster["spec"]["scheduler"], cluster["spec"]["worker"]
    for pod in (scheduler["spec"], worker["spec"]):  # the operator makes a Deployment of each
        labels = {"app": "dask"}
        template = {"metadata": {"labels": labels}, "spec": pod}
        spec = {"replicas": 1, "selector": {"matchLabels": labels}, "template": template}
        valid({"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": "dask"}, "spec": spec})
    (port,) = scheduler["service"]["ports"]
    assert port["targetPort"] in {each["name"] for each in scheduler["spec"]["containers"][0]["ports"]}
    assert f"tcp://{cluster['metadata']['name']}-scheduler:{port['port']}" == SCHEDULER
    assert worker["replicas"] == 8


def test_deploy_refuses_options_that_exclude_each_other(file, tmp_path):
    for options, said in (
        ((), "expected one of --pool, --format, and --kubernetes, got none"),
        (("--pool", "lab", "--format", "compose"), "--kubernetes, got --pool and --format"),
        (("--pool", "lab", "--operator"), "--operator: requires --kubernetes"),
        (("--kubernetes", tmp_path / "k"), "--store: expected an address that all pods reach"),
        (("--kubernetes", tmp_path / "k", *STORE, "--cluster", "local:2"), "--cluster: --kubernetes makes a cluster"),
    ):
        assert said in refused("deploy", file, *options)
    assert not (tmp_path / "k").exists()
