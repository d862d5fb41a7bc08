"""A run description as a file of Docker Compose or a pod of Kubernetes."""

import json
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import Any, Final

import yaml

from vastflow.tasks.prefect.containers import Container, RunDescription, compose_memory, kubernetes_memory

_SHIPPED: Final = "vastflow.deployments"
_PLACEHOLDER: Final = re.compile(r"\{\{ (\w+) \}\}")


def template(name: str) -> Any:
    """Return the content of a YAML or JSON file of `deployments/`, a list if it has several documents."""
    text = files(_SHIPPED).joinpath(name).read_text(encoding="utf-8")
    if name.endswith(".json"):
        return json.loads(text)
    first, *others = yaml.safe_load_all(text)
    return [first, *others] if others else first


def filled(content: Any, values: Mapping[str, Any]) -> Any:
    """Fill `content` with the value of `name` for each placeholder `{{ name }}`.

    A string that is one placeholder becomes the value of any type. Values are inserted into parsed data and not searched again.
    None removes its key or item, and containers that are empty then.

    Raises:
        KeyError: there is no such value.
    """
    if isinstance(content, str):
        if whole := _PLACEHOLDER.fullmatch(content):
            return values[whole[1]]
        return _PLACEHOLDER.sub(lambda found: str(values[found[1]]), content)
    if isinstance(content, dict):
        entries = {key: filled(inner, values) for key, inner in content.items()}
        left: Any = {key: value for key, value in entries.items() if value is not None}
    elif isinstance(content, list):
        left = [value for value in (filled(inner, values) for inner in content) if value is not None]
    else:
        return content
    return None if content and not left else left


UNMISTAKABLE: Final = re.compile(r"[A-Za-z/][A-Za-z0-9_./:@-]+")
"""Text that no YAML reader takes for something else; PyYAML itself quotes `yes`, `true`, `null` and the like."""

_OTHER_BREAKS: Final = frozenset("\r\x85\u2028\u2029")
"""YAML 1.1 ends a line at these too, and reads some of them back as another."""


class _Dumper(yaml.SafeDumper):
    """Dumper for readers of YAML 1.1 and 1.2, which quotes `1e3`, `0o17`, and `y`."""

    def ignore_aliases(self, data: Any) -> bool:
        """True: repeated data are written again."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    lines = "\n" in text and _OTHER_BREAKS.isdisjoint(text)
    style = "|" if lines else None if UNMISTAKABLE.fullmatch(text) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def yaml_text(manifest: dict[str, Any]) -> str:
    """Return `manifest` in its own order, in YAML that loads back equal."""
    return yaml_documents([manifest])


def yaml_documents(manifests: Iterable[dict[str, Any]]) -> str:
    """Return manifests as documents of one YAML file, see `yaml_text`."""
    dumped = (yaml.dump(each, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120) for each in manifests)
    return "---\n".join(dumped)


OUT_FOLDER: Final = "./out"


def compose_file(description: RunDescription) -> dict[str, Any]:
    """Return the file of Docker Compose, with paths relative to the campaign file's folder.

    As in a pod, the containers share network, `/dev/shm`, and two folders, and the main one starts last.
    """
    parts = template("templates/compose.yaml")
    containers = (*description.sidecars, description.main)
    services = {each.name: _service(parts, description, each, containers[0]) for each in containers}
    values = {"name": description.name, "user": description.user, "services": services}
    literal: dict[str, Any] = _compose_literal(filled(parts["file"], values))
    return literal


def _service(
    parts: dict[str, Any], description: RunDescription, container: Container, first: Container
) -> dict[str, Any]:
    needs = container.needs
    waits_for = [sidecar.name for sidecar in description.sidecars] if container is description.main else []
    values = {
        **dict.fromkeys(("cap_drop", "security_opt", "shm_size", "network_mode")),
        **(parts["unprivileged"] if description.user != 0 else {}),
        **(parts["first"] if container is first else filled(parts["joined"], {"first": first.name})),
        "image": description.image,
        "command": list(description.command_of(container)) or None,
        "user": str(description.user),
        "depends_on": waits_for or None,
        "environment": description.environment_of(container),
        "cpu": None if needs.cpu is None else str(needs.cpu),
        "memory": None if needs.memory_bytes is None else compose_memory(needs.memory_bytes),
        "devices": filled(parts["devices"], {"gpu": needs.gpu}) if needs.gpu else None,
    }
    service: dict[str, Any] = filled(parts["service"], values)
    service["volumes"] += [filled(parts["mount"], {"file": file}) for file in description.files]
    return service


def _compose_literal(value: Any) -> Any:
    """Return `value` with doubled dollars, as Compose takes a single one for a variable."""
    if isinstance(value, dict):
        return {key: _compose_literal(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_compose_literal(inner) for inner in value]
    return value.replace("$", "$$") if isinstance(value, str) else value


def pod_template(description: RunDescription) -> dict[str, Any]:
    """Return a `PodTemplate` with a `template` for a Job."""
    values = {"name": description.name, "spec": pod_spec(description)}
    made: dict[str, Any] = filled(template("templates/pod.yaml")["pod_template"], values)
    return made


def pod_spec(description: RunDescription) -> dict[str, Any]:
    """Return the `PodSpec` of `pod_template`."""
    parts = template("templates/pod.yaml")
    items = [{"key": key, "path": file} for key, file in config_map_keys(description).items()]
    config = {"config_map": config_map_name(description), "items": items}
    values = {
        "user": description.user,
        "is_not_root": description.user != 0,
        "deadline_s": description.deadline_s,
        "node_labels": dict(description.node_labels) or None,
        "sidecars": [_container(parts, description, each, "Always") for each in description.sidecars] or None,
        "main": _container(parts, description, description.main),
        "config_volume": filled(parts["config_volume"], config) if items else None,
    }
    spec: dict[str, Any] = filled(parts["spec"], values)
    return spec


def config_map_name(description: RunDescription) -> str:
    """Return the name of the ConfigMap with the run's files."""
    return f"{description.name}-files"


def config_map_keys(description: RunDescription) -> dict[str, str]:
    """Return key in the ConfigMap to file, as keys can't hold every character of a path."""
    names = [re.sub(r"[^-.\w]", "_", file.rpartition("/")[2], flags=re.ASCII) for file in description.files]
    return {f"{k}-{name}": file for k, (name, file) in enumerate(zip(names, description.files, strict=True))}


def _container(
    parts: dict[str, Any], description: RunDescription, container: Container, restart_policy: str | None = None
) -> dict[str, Any]:
    needs, environment = container.needs, description.environment_of(container)
    values = {
        "name": container.name,
        "image": description.image,
        "command": [_literal(argument) for argument in description.command_of(container)] or None,
        "env": [{"name": name, "value": _literal(value)} for name, value in environment.items()],
        "cpu": None if needs.cpu is None else str(needs.cpu),
        "memory": None if needs.memory_bytes is None else kubernetes_memory(needs.memory_bytes),
        "gpu": str(needs.gpu) if needs.gpu else None,
        "security_context": parts["unprivileged"] if description.user != 0 else None,
        "config_mount": parts["config_mount"] if description.files else None,
        "restart_policy": restart_policy,
    }
    made: dict[str, Any] = filled(parts["container"], values)
    return made


def _literal(text: str) -> str:
    """Return `text` with doubled dollars, as Kubernetes replaces `$(NAME)` in commands and values."""
    return text.replace("$", "$$")
