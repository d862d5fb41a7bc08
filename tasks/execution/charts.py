"""Prefect on a cluster: values of its Helm charts, and what vastflow needs beside them."""

from typing import Any, Final

from vastflow.tasks.execution.job import API_URL, NAME, PoolType
from vastflow.tasks.execution.memory import kubernetes_memory

PREFECT: Final = "3.8.8"
"""Version of server and worker; no older than what campaigns run with."""
DATABASE_SECRET: Final = "prefect-database"
RECORDER: Final = {
    # Prefect writes one task run a transaction by default; batches cost a quarter of the CPU time and lose fewer rows.
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_FLUSH_INTERVAL": "1",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_BATCH_SIZE": "500",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
}


def server_values() -> dict[str, Any]:
    """Values of the chart `prefect-server`: a database of the cluster's own, whose address is in a secret."""
    return {
        "global": {"prefect": {"image": {"prefectTag": f"{PREFECT}-python3.12"}}},
        "server": {
            "uiConfig": {"prefectUiApiUrl": "http://localhost:4200/api"},
            "env": [{"name": name, "value": value} for name, value in RECORDER.items()],
            "resources": {
                "requests": {"cpu": "1", "memory": "1Gi"},
                "limits": {"memory": "2Gi"},
            },
        },
        "postgresql": {"enabled": False},
        "secret": {"create": False, "name": DATABASE_SECRET},
    }


def worker_values(pool: str) -> dict[str, Any]:
    """Values of the chart `prefect-worker`, for the work pool `pool` that `vastflow deploy` made."""
    return {
        "worker": {
            "image": {"prefectTag": f"{PREFECT}-python3.12-kubernetes"},
            "config": {"workPool": pool, "type": PoolType.kubernetes.value},
            "apiConfig": "selfHostedServer",
            "selfHostedServerApiConfig": {"apiUrl": API_URL},
            "resources": {
                "requests": {"cpu": "100m", "memory": "512Mi"},
                "limits": {"memory": "1Gi"},
            },
        },
    }


def namespace_manifests(storage_bytes: int) -> list[dict[str, Any]]:
    """The namespace of the Jobs, and the volume for results and store."""
    return [
        {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAME}},
        {
            "apiVersion": "v1",
            "kind": "PersistentVolumeClaim",
            "metadata": {"name": NAME, "namespace": NAME},
            "spec": {
                # Pods on several nodes at once take ReadWriteMany, which not every cluster has.
                "accessModes": ["ReadWriteOnce"],
                "resources": {"requests": {"storage": kubernetes_memory(storage_bytes)}},
            },
        },
    ]
