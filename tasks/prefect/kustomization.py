"""A campaign on a Dask cluster of its own, as a folder for `kubectl apply -k`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vastflow.tasks.prefect.containers import Needs, RunDescription, kubernetes_memory
from vastflow.tasks.prefect.deployment import NAME
from vastflow.tasks.prefect.manifests import filled, template, yaml_documents

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


@dataclass(frozen=True, slots=True)
class ClusterCampaign:
    """A campaign with the Dask cluster that computes it.

    Attributes:
        description: Its resources, variables, and node labels are those of a worker.
        command: Command line of the campaign's Job, which drives the workers at `SCHEDULER`.
        workers: Number of workers, of one thread each.
        image: Image with vastflow and the campaign.
        queue: LocalQueue of Kueue; without Kueue the label has no effect.
        operator: Leave scheduler and workers to the Dask operator.
    """

    description: RunDescription
    command: Sequence[str]
    workers: int
    image: str
    queue: str = NAME
    operator: bool = False

    def files(self) -> Mapping[str, str]:
        """Content of the folder's files by name; `queues.yaml` is for Kueue, and `kubectl apply -k` leaves it out."""
        parts = template("templates/cluster.yaml")
        flavor, cluster, local = template("kueue/queues.yaml")
        documents = {
            "namespace.yaml": [parts["namespace"]],
            "dask.yaml": [
                parts[name] for name in (("operated",) if self.operator else ("scheduler", "service", "workers"))
            ],
            "campaign.yaml": [parts["campaign"]],
            "kustomization.yaml": [parts["kustomization"]],
            "queues.yaml": [
                flavor,
                {**cluster, "spec": {**cluster["spec"], **parts["quota"]}},
                {**local, **parts["queue"]},
            ],
        }
        place = ["--name", "$(DASK_WORKER_NAME)"] if self.operator else [SCHEDULER]
        worker = ["dask", "worker", *place, "--nthreads", "1", "--memory-limit", "0"]
        scheduler = ["dask", "scheduler", "--port", "8786"]
        needs = self._worker_needs
        total = (needs.memory_bytes or 0) * self.workers + (_CAMPAIGN_NEEDS.memory_bytes or 0)
        values = {
            "name": self.description.name,
            "namespace": NAME,
            "queue": self.queue,
            "workers": self.workers,
            "resources": ["namespace.yaml", "dask.yaml", "campaign.yaml"],
            "secret_file": SECRET_FILE,
            "total_cpu": str((needs.cpu or 0) * self.workers + (_CAMPAIGN_NEEDS.cpu or 0)),
            "total_memory": kubernetes_memory(total),
            "scheduler_pod": self._pod("scheduler", [*scheduler, "--no-dashboard"], _SCHEDULER_NEEDS, port=8786),
            "worker_pod": self._pod(
                "worker", [*worker, "--no-dashboard"], needs, None if self.operator else "OnFailure"
            ),
            "campaign_pod": self._pod("campaign", self.command, _CAMPAIGN_NEEDS, "Never"),
        }
        return {name: yaml_documents(filled(each, values)) for name, each in documents.items()} | {SECRET_FILE: _SECRET}

    @property
    def _worker_needs(self) -> Needs:
        needs = self.description.main.needs
        return Needs(needs.cpu or _WORKER_NEEDS.cpu, needs.memory_bytes or _WORKER_NEEDS.memory_bytes, needs.gpu)

    def _pod(
        self, name: str, args: Sequence[str], needs: Needs, restarts: str | None = None, port: int | None = None
    ) -> Any:
        is_worker = name == "worker"
        env = self.description.env if is_worker else {}
        values = {
            "name": name,
            "args": list(args),
            "restart_policy": restarts,
            "ports": None if port is None else [{"name": "tcp-comm", "containerPort": port}],
            "env": [{"name": key, "value": value.replace("$", "$$")} for key, value in env.items()] or None,
            "node_labels": dict(self.description.node_labels) or None if is_worker else None,
            "image": self.image,
            "secret": NAME,
            "cpu": str(needs.cpu),
            "memory": kubernetes_memory(needs.memory_bytes or 0),
            "gpu": str(needs.gpu) if needs.gpu else None,
        }
        return filled(template("templates/cluster.yaml")["pod"], values)
