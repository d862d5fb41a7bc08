"""The containers of a run for Docker Compose or Kubernetes, as `deploy --format` prints them."""

import shlex
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from vastflow.tasks.execution.description import RunDescription

MOST_IN_A_CONFIG_MAP: Final = 2**20


class Format(StrEnum):
    """Whom a description is for."""

    compose = "compose"
    kubernetes = "kubernetes"


def describe(file: Path, format_: Format, context: str | None, map_dir: Path | None, *, as_v1: bool) -> None:
    """Print the containers of a run as YAML: image, resources, environment, files, and scripts."""
    from vastflow.flows.request.campaign_file import campaign_name
    from vastflow.producers.campaign import load_campaign
    from vastflow.sim.plug_ins.effects import looking_only
    from vastflow.tasks.execution.manifests import compose_file, pod_template, yaml_text
    from vastflow.tasks.execution.reading import describe as described

    with looking_only():
        campaign = load_campaign(file, map_dir, as_v1=as_v1)
    found = described(campaign, campaign_name(campaign), context)
    if format_ is Format.compose:
        print(yaml_text(compose_file(found)), end="")
        notes = _compose_notes(found)
    else:
        print(yaml_text(pod_template(found)), end="")
        notes = _kubernetes_notes(found)
    for note in notes:
        print(note, file=sys.stderr)


def _compose_notes(found: "RunDescription") -> Iterator[str]:
    from vastflow.tasks.execution.manifests import OUT_FOLDER

    folder = shlex.quote(str(found.folder))
    yield f"save it in {folder}; make a folder {OUT_FOLDER} there that user {found.user} can write to"
    if found.deadline_s is not None:
        yield f"execution.timeout: Docker Compose ends nothing after {found.deadline_s} s"
    if found.node_labels:
        yield "execution.kubernetes.jobs.node_labels: Docker Compose chooses no nodes"


def _kubernetes_notes(found: "RunDescription") -> Iterator[str]:
    from vastflow.tasks.execution.manifests import config_map_keys, config_map_name

    if not found.files:
        return
    from_files = (f"--from-file={key}={found.folder / file}" for key, file in config_map_keys(found).items())
    command = ["kubectl", "create", "configmap", config_map_name(found), *from_files]
    yield f"the pod finds the run's files in a ConfigMap; make it by: {shlex.join(command)}"
    size = sum((found.folder / file).stat().st_size for file in found.files)
    if size > MOST_IN_A_CONFIG_MAP:
        yield f"execution.run_files: expected a ConfigMap holds {MOST_IN_A_CONFIG_MAP}: name fewer files, got {size} bytes"
