"""Base job templates of Prefect's work pools, and what of a campaign file goes into them.

A flow run that a worker starts runs the whole campaign in one container of vastflow's own image. Containers that the campaign
file asks for beside it are sidecars of that one.
"""

from enum import StrEnum
from typing import Any, Final

from vastflow.tasks.execution.description import (
    CONFIG,
    MAIN,
    OUT,
    SHARED_MEMORY,
    SHARED_MEMORY_BYTES,
    SOCKETS,
    Container,
    RunDescription,
)
from vastflow.tasks.execution.kueue import QUEUE_LABEL
from vastflow.tasks.execution.leak import OF_THE_WORKER
from vastflow.tasks.execution.memory import compose_memory, kubernetes_memory
from vastflow.tasks.execution.pod import GPU, READ_AND_EXECUTE, config_map_keys, config_map_name, pod_spec


class PoolType(StrEnum):
    """Kinds of work pools, under Prefect's own names."""

    process = "process"
    docker = "docker"
    kubernetes = "kubernetes"


NAME: Final = "vastflow"
"""Of namespace, queue, secret and volume, where nobody says otherwise."""
IMAGE: Final = "vastflow:latest"
DATA: Final = "/data"
"""Where containers keep results and store."""
API_URL: Final = "http://prefect-server.vastflow.svc.cluster.local:4200/api"
USER: Final = 1000
"""Of vastflow's image."""
FLOW_RUN: Final = "prefect-job"
"""The container in which Prefect's worker looks for the flow run."""

DAY_S: Final = 24 * 3600
CPU: Final = 2
MEMORY_BYTES: Final = 4 * 2**30
"""What is requested for a campaign whose file says nothing."""


def base_job_template(kind: PoolType) -> dict[str, Any]:
    """The template of a pool as plain data: variables, which a deployment may set, and the job they go into.

    Raises:
        ValueError: a process pool; Prefect's own template is right for it.
    """
    if kind is PoolType.kubernetes:
        return {"variables": _schema(_kubernetes_variables()), "job_configuration": _kubernetes_job()}
    if kind is PoolType.docker:
        return {"variables": _schema(_docker_variables()), "job_configuration": _docker_job()}
    raise ValueError(f"found {kind.value!r}; Prefect has the template of a process pool")


def job_variables(kind: PoolType, description: RunDescription) -> dict[str, Any]:
    """What a deployment sets of its pool's template.

    Args:
        description: Of the campaign; its image is the sidecars', and its main container says only what the flow run needs.
    """
    needs = description.main.needs
    if kind is PoolType.docker:
        return {} if needs.memory_bytes is None else {"mem_limit": compose_memory(needs.memory_bytes)}
    if kind is PoolType.process:
        return {}
    found: dict[str, Any] = {}
    if needs.cpu is not None:
        found["cpu"] = str(needs.cpu)
    if needs.memory_bytes is not None:
        found["memory"] = kubernetes_memory(needs.memory_bytes)
    if needs.gpu:
        found["gpu"] = str(needs.gpu)
    if description.node_labels:
        found["node_selector"] = dict(description.node_labels)
    if description.files:
        found["files"] = config_map_name(description)
        found["file_items"] = [{"key": key, "path": file} for key, file in config_map_keys(description).items()]
    if description.sidecars:
        sidecars = pod_spec(description)["initContainers"]
        found["sidecars"] = [_sidecar(container, description.user) for container in sidecars]
    return found


def _sidecar(container: dict[str, Any], user: int) -> dict[str, Any]:
    own = {"runAsUser": user, "runAsNonRoot": user != 0}
    return {**container, "securityContext": {**container.get("securityContext", {}), **own}}


def _environment(api_url: str) -> dict[str, str | None]:
    """Variables of every job. None takes away what the worker would hand on."""
    own = {
        "PREFECT_API_URL": api_url,
        "PREFECT_HOME": "/tmp/prefect",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "VASTFLOW_STORE": f"{DATA}/store",
    }
    return {**dict.fromkeys(OF_THE_WORKER), **own}


def _kubernetes_job() -> dict[str, Any]:
    spec = pod_spec(RunDescription(NAME, IMAGE, Container(MAIN), user=USER))
    in_memory = {"medium": "Memory", "sizeLimit": kubernetes_memory(SHARED_MEMORY_BYTES)}
    files = {"name": "{{ files }}", "items": "{{ file_items }}", "defaultMode": READ_AND_EXECUTE, "optional": True}
    container = {
        "name": FLOW_RUN,
        "image": "{{ image }}",
        "imagePullPolicy": "{{ image_pull_policy }}",
        "args": "{{ command }}",
        # Credentials: whatever is in the secret, S3's and the API's, and nothing where there is none.
        "envFrom": [{"secretRef": {"name": "{{ secret }}", "optional": True}}],
        "resources": {
            "requests": {"cpu": "{{ cpu }}", "memory": "{{ memory }}"},
            "limits": {"memory": "{{ memory }}", GPU: "{{ gpu }}"},
        },
        "securityContext": spec["containers"][0]["securityContext"],
        "volumeMounts": [
            {"name": "data", "mountPath": DATA},
            {"name": "out", "mountPath": OUT},
            {"name": "sockets", "mountPath": SOCKETS},
            {"name": "shared-memory", "mountPath": SHARED_MEMORY},
            {"name": "config", "mountPath": CONFIG, "readOnly": True},
        ],
    }
    pod = {
        # Two keys that a PodSpec does not have; Prefect's worker (prefect-kubernetes 0.8) refuses a template without them.
        "parallelism": 1,
        "completions": 1,
        "restartPolicy": "Never",
        "automountServiceAccountToken": False,
        # Kubernetes' variables for a service called prefect-… would be taken for settings by Prefect.
        "enableServiceLinks": False,
        "securityContext": {**spec["securityContext"], "fsGroup": USER},
        "nodeSelector": "{{ node_selector }}",
        "initContainers": "{{ sidecars }}",
        "containers": [container],
        "volumes": [
            {"name": "data", "persistentVolumeClaim": {"claimName": "{{ volume_claim }}"}},
            {"name": "out", "emptyDir": {}},
            {"name": "sockets", "emptyDir": {}},
            {"name": "shared-memory", "emptyDir": in_memory},
            {"name": "config", "configMap": files},
        ],
    }
    return {
        "name": "{{ name }}",
        "namespace": "{{ namespace }}",
        "command": "{{ command }}",
        "env": _environment("{{ api_url }}"),
        "labels": {QUEUE_LABEL: "{{ queue }}"},
        "stream_output": "{{ stream_output }}",
        "job_watch_timeout_seconds": "{{ job_watch_timeout_seconds }}",
        "pod_watch_timeout_seconds": "{{ pod_watch_timeout_seconds }}",
        "job_manifest": {
            "apiVersion": "batch/v1",
            "kind": "Job",
            "metadata": {"namespace": "{{ namespace }}", "generateName": "{{ name }}-"},
            "spec": {
                # Prefect schedules an evicted flow run again only where Kubernetes does not repeat its Job.
                "backoffLimit": 0,
                "ttlSecondsAfterFinished": "{{ finished_job_ttl }}",
                "template": {"spec": pod},
            },
        },
    }


def _kubernetes_variables() -> dict[str, Any]:
    return {
        **_common_variables(),
        "namespace": _text("Where Jobs are made.", NAME),
        "image_pull_policy": {**_text("When nodes pull the image.", "IfNotPresent"), "enum": [*_PULL_POLICIES]},
        "api_url": _text("Prefect's API, as a pod reaches it.", API_URL),
        "queue": _text("LocalQueue of Kueue in which Jobs wait.", NAME),
        "cpu": _text("Cores that are requested; they are not limited.", str(CPU)),
        "memory": _text("Memory that is requested, and the limit.", kubernetes_memory(MEMORY_BYTES)),
        "gpu": _text("NVIDIA GPUs; none if left out."),
        "node_selector": {"type": "object", "description": "Labels that a node must have."},
        "secret": _text("Secret whose keys become variables: S3's credentials, the API's. It may be missing.", NAME),
        "volume_claim": _text(f"PersistentVolumeClaim for results and store, mounted at {DATA}.", NAME),
        "files": _text("ConfigMap with the campaign's run_files. It may be missing.", f"{NAME}-files"),
        "file_items": {**_list("Its keys and the paths they get."), "default": []},
        "sidecars": {
            **_list("Containers beside the campaign's, as initContainers that restart always."),
            "default": [],
        },
        "finished_job_ttl": _number("Seconds after its end when Kubernetes deletes a Job.", DAY_S),
        "job_watch_timeout_seconds": _number("Seconds until the worker gives up on a running Job; never if left out."),
        # Prefect's own default, a minute, is too short for a Job that waits for a queue's quota.
        "pod_watch_timeout_seconds": _number("Seconds until the worker gives up on a Job that has no pod.", 7 * DAY_S),
    }


def _docker_job() -> dict[str, Any]:
    taken = ("name", "command", "image", "image_pull_policy", "networks", "volumes", "mem_limit", "stream_output")
    return {
        **{name: f"{{{{ {name} }}}}" for name in taken},
        "env": _environment("{{ api_url }}"),
        "auto_remove": True,
        "privileged": False,
    }


def _docker_variables() -> dict[str, Any]:
    return {
        **_common_variables(),
        "image_pull_policy": {**_text("When the image is pulled.", "IfNotPresent"), "enum": [*_PULL_POLICIES]},
        "api_url": _text("Prefect's API, as a container reaches it.", "http://host.docker.internal:4200/api"),
        "networks": {**_list("Networks of Docker to join.", "string"), "default": []},
        "volumes": {**_list(f"Volumes; {DATA} is for results and store.", "string"), "default": [f"{NAME}:{DATA}"]},
        "mem_limit": _text("Memory that ends a container which takes more; no limit if left out."),
    }


_PULL_POLICIES: Final = ("IfNotPresent", "Always", "Never")


def _common_variables() -> dict[str, Any]:
    return {
        "name": _text("Of what is started; Prefect finds one if left out."),
        "command": _text("Instead of Prefect's own command."),
        "image": _text("Image with vastflow in it.", IMAGE),
        "env": {"type": "object", "description": "More variables.", "additionalProperties": {"type": "string"}},
        "stream_output": {
            "type": "boolean",
            "description": "Whether the worker prints what it says.",
            "default": False,
        },
    }


def _schema(variables: dict[str, Any]) -> dict[str, Any]:
    titled = {name: {"title": name.replace("_", " ").capitalize(), **about} for name, about in variables.items()}
    return {"type": "object", "properties": titled}


def _text(description: str, default: str | None = None) -> dict[str, Any]:
    about = {"type": "string", "description": description}
    return about if default is None else {**about, "default": default}


def _number(description: str, default: int | None = None) -> dict[str, Any]:
    about = {"type": "integer", "description": description, "minimum": 1}
    return about if default is None else {**about, "default": default}


def _list(description: str, items: str = "object") -> dict[str, Any]:
    return {"type": "array", "items": {"type": items}, "description": description}
