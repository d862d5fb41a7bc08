"""A campaign on a Dask cluster of its own, as a folder for `kubectl apply -k`."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.tasks.prefect.containers import Needs, RunDescription, kubernetes_memory
from vastflow.tasks.prefect.deployment import NAME
from vastflow.tasks.prefect.manifests import filled, literal_variables, template, yaml_text

SCHEDULER: Final = "tcp://dask-scheduler:8786"
"""Address of the scheduler inside of the namespace."""
SECRET_FILE: Final = "s3.env"
_SECRET: Final = """\
# Variables of all pods: fill in the credentials of S3, and keep this file out of version control.
AWS_ACCESS_KEY_ID=
AWS_SECRET_ACCESS_KEY=
AWS_ENDPOINT_URL=
"""
_GIB: Final = 2**30
_SCHEDULER_NEEDS: Final = Needs(1, 2 * _GIB)
_CAMPAIGN_NEEDS: Final = Needs(1, 4 * _GIB)
"""Resources of the campaign's own Job, which evaluates producers, waits for the workers, and writes the report."""
_WORKER_NEEDS: Final = Needs(1, 2 * _GIB)


def cluster_files(
    description: RunDescription,
    command: Sequence[str],
    workers: int,
    image: str,
    queue: str = NAME,
    *,
    operator: bool = False,
) -> Mapping[str, str]:
    """Return content of the folder's files by name; `queues.yaml` is for Kueue, and `kubectl apply -k` leaves it out.

    Args:
        description: Its resources, variables, and node labels are those of a worker.
        command: Command line of the campaign's Job, which drives the workers at `SCHEDULER`.
        workers: Number of workers, of one thread each.
        image: Image with vastflow and the campaign.
        queue: LocalQueue of Kueue; without Kueue the label has no effect.
        operator: Leave scheduler and workers to the Dask operator.
    """
    parts = template("templates/cluster.yaml")
    flavor, cluster, local = template("kueue/queues.yaml")
    place = ["--name", "$(DASK_WORKER_NAME)"] if operator else [SCHEDULER]
    # Without an address, Dask serves HTTP on all interfaces even if it has no dashboard.
    http = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    worker = ["dask", "worker", *place, "--nthreads", "1", "--memory-limit", "0", *http]
    scheduler = ["dask", "scheduler", "--port", "8786", *http]
    needs = description.main.needs
    needs = Needs(needs.cpu or _WORKER_NEEDS.cpu, needs.memory_bytes or _WORKER_NEEDS.memory_bytes, needs.gpu)
    total_bytes = (needs.memory_bytes or 0) * workers + (_CAMPAIGN_NEEDS.memory_bytes or 0)

    def pod(name: str, args: Sequence[str], needs: Needs, **own: Any) -> Any:
        values = {"name": name, "args": args, "image": image, "secret": NAME, **needs.quantities}
        return filled(parts["pod"], {**values, **own})

    values = {
        "name": description.name,
        "namespace": NAME,
        "queue": queue,
        "workers": workers,
        "secret_file": SECRET_FILE,
        "total_cpu": str((needs.cpu or 0) * workers + (_CAMPAIGN_NEEDS.cpu or 0)),
        "total_memory": kubernetes_memory(total_bytes),
        "scheduler_pod": pod("scheduler", scheduler, _SCHEDULER_NEEDS, port=8786),
        "worker_pod": pod(
            "worker",
            worker,
            needs,
            restart_policy=None if operator else "OnFailure",
            env=literal_variables(description.env),
            node_labels=description.node_labels,
        ),
        "campaign_pod": pod("campaign", command, _CAMPAIGN_NEEDS, restart_policy="Never"),
    }
    dask = ("operated",) if operator else ("scheduler", "service", "workers")
    documents = {
        "namespace.yaml": [parts["namespace"]],
        "dask.yaml": [parts[name] for name in dask],
        "campaign.yaml": [parts["campaign"]],
        "kustomization.yaml": [parts["kustomization"]],
        "queues.yaml": [
            flavor,
            {**cluster, "spec": {**cluster["spec"], **parts["quota"]}},
            {**local, **parts["queue"]},
        ],
    }
    return {name: yaml_text(*filled(each, values)) for name, each in documents.items()} | {SECRET_FILE: _SECRET}
