"""Queues of Kueue: how much of a cluster campaigns may have at once, and the queue their Jobs wait in."""

from typing import Any, Final

from vastflow.tasks.execution.memory import kubernetes_memory

API: Final = "kueue.x-k8s.io/v1beta2"
QUEUE_LABEL: Final = "kueue.x-k8s.io/queue-name"
"""Label of a Job: the LocalQueue it waits in."""
NAMESPACE_LABEL: Final = "kubernetes.io/metadata.name"
"""Kubernetes labels every namespace with its own name."""


def queue_manifests(namespace: str, queue: str, cpu: int, memory_bytes: int) -> list[dict[str, Any]]:
    """A ResourceFlavor, a ClusterQueue with the quota and a LocalQueue, all called `queue`, as plain data.

    Args:
        namespace: Where the Jobs are; no other may use the quota.
        queue: What `QUEUE_LABEL` of a Job says.
        cpu: Cores that all admitted Jobs request together.
        memory_bytes: Memory (bytes), likewise.
    """
    quota = [
        {"name": "cpu", "nominalQuota": str(cpu)},
        {"name": "memory", "nominalQuota": kubernetes_memory(memory_bytes)},
    ]
    return [
        {"apiVersion": API, "kind": "ResourceFlavor", "metadata": {"name": queue}},
        {
            "apiVersion": API,
            "kind": "ClusterQueue",
            "metadata": {"name": queue},
            "spec": {
                "namespaceSelector": {"matchLabels": {NAMESPACE_LABEL: namespace}},
                # A campaign that is preempted begins again with what its store has; a younger one waits instead.
                "preemption": {"withinClusterQueue": "Never"},
                "resourceGroups": [
                    {"coveredResources": ["cpu", "memory"], "flavors": [{"name": queue, "resources": quota}]}
                ],
            },
        },
        {
            "apiVersion": API,
            "kind": "LocalQueue",
            "metadata": {"name": queue, "namespace": namespace},
            "spec": {"clusterQueue": queue},
        },
    ]
