"""A campaign on a Dask cluster of its own, as a folder for `kubectl apply -k`."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.tasks.prefect.containers import Containers, Needs, kubernetes_memory
from vastflow.tasks.prefect.deployment import NAME
from vastflow.tasks.prefect.manifests import filled, literal_variables, template, yaml_text

LONGEST_NAME: Final = 48
"""Characters of a campaign's name that leave room for those of its pods."""
SECRET_FILE: Final = "s3.env"
_SECRET: Final = """\
# Variables of the campaign and its workers: fill in the credentials of S3, and keep this file out of version control.
AWS_ACCESS_KEY_ID=
AWS_SECRET_ACCESS_KEY=
AWS_ENDPOINT_URL=
"""
_GIB: Final = 2**30
_SCHEDULER_NEEDS: Final = Needs(1, 2 * _GIB)
_CAMPAIGN_NEEDS: Final = Needs(1, 4 * _GIB)
"""Resources of the campaign's own Job, which evaluates producers, waits for the workers, and writes the report."""
_WORKER_NEEDS: Final = Needs(1, 2 * _GIB)


def scheduler_address(name: str) -> str:
    """Return the address that a campaign's scheduler has in its namespace."""
    return f"tcp://{name}-scheduler:8786"


def cluster_files(
    containers: Containers,
    command: Sequence[str],
    workers: int,
    image: str,
    queue: str = NAME,
    *,
    operator: bool = False,
) -> Mapping[str, str]:
    """Return content of the folder's files by name; `kubectl apply -k` leaves out namespace and Kueue's `queues.yaml`.

    Args:
        containers: Their resources, variables, node labels, and tolerations are those of a worker.
        command: Command line of the campaign, which drives the workers at `scheduler_address`.
        workers: Number of workers, of one thread each.
        image: Image with vastflow and the campaign.
        queue: LocalQueue of Kueue; without Kueue the label has no effect.
        operator: Leave campaign, scheduler, and workers to the Dask operator.
    """
    parts = template("templates/cluster.yaml")
    flavor, cluster, local = template("kueue/queues.yaml")
    # Without an address, Dask serves HTTP on all interfaces even if it has no dashboard.
    http = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    options = ["--nthreads", "1", "--memory-limit", "0", *http]
    scheduler = ["dask", "scheduler", "--port", "8786", *http]
    worker = ["sh", "-c", parts["worker_script"], "worker", scheduler_address(containers.name), *options]
    if operator:  # it starts workers anew, and ends them
        worker = ["dask", "worker", "--name", "$(DASK_WORKER_NAME)", *options]
    needs = containers.needs
    needs = Needs(needs.cpu or _WORKER_NEEDS.cpu, needs.memory_bytes or _WORKER_NEEDS.memory_bytes, needs.gpu)
    others = _SCHEDULER_NEEDS, _CAMPAIGN_NEEDS
    total_bytes = (needs.memory_bytes or 0) * workers + sum(each.memory_bytes or 0 for each in others)

    def container(name: str, args: Sequence[str], needs: Needs, env: Mapping[str, str], **own: Any) -> Any:
        variables = literal_variables({**env, **parts["places"]})
        values = {"name": name, "args": args, "image": image, "env": variables, **needs.quantities}
        return filled(parts["container"], {**parts, **values, **own})

    def pod(container: Any, **own: Any) -> Any:
        return filled(parts["pod"], {**parts, "image": image, "container": container, **own})

    scheduler_container = container("scheduler", scheduler, _SCHEDULER_NEEDS, {}, port=8786, is_sidecar=not operator)
    values = {
        "name": containers.name,
        "namespace": NAME,
        "queue": queue,
        "workers": workers,
        "operator": operator,
        "secret_file": SECRET_FILE,
        "total_cpu": str((needs.cpu or 0) * workers + sum(each.cpu or 0 for each in others)),
        "total_memory": kubernetes_memory(total_bytes),
        "scheduler_pod": pod(scheduler_container),
        "worker_pod": pod(
            container("worker", worker, needs, containers.env, secret=containers.name),
            restart_policy=None if operator else "Never",
            node_labels=containers.node_labels,
            tolerations=containers.tolerations,
        ),
        "campaign_pod": pod(
            container("campaign", command, _CAMPAIGN_NEEDS, {}, secret=containers.name),
            restart_policy="Never",
            sidecar=None if operator else scheduler_container,
        ),
    }
    dask = ("operated",) if operator else ("service", "workers")
    documents = {
        "namespace.yaml": [parts["namespace"]],
        "dask.yaml": [parts[name] for name in ("policy", *dask)],
        "kustomization.yaml": [parts["kustomization"]],
        "queues.yaml": [
            flavor,
            {**cluster, "spec": {**cluster["spec"], **parts["quota"]}},
            {**local, **parts["queue"]},
        ],
    } | ({} if operator else {"campaign.yaml": [parts["campaign"]]})
    return {name: yaml_text(*filled(each, values)) for name, each in documents.items()} | {SECRET_FILE: _SECRET}
