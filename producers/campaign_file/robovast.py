"""Campaign files of RoboVAST 2 (its schemas 2 to 4), and what of them a file of version 1 says."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from vastflow.producers.campaign_file.spec import CampaignSpec, ExecutionSpec, FamilySpec, ResultsProcessingSpec
from vastflow.sim.model.scenario import DIMENSION_OF_KEY
from vastflow.sim.system.keys import FILE_KEY, SUT

SCHEMAS: Final = (2, 3, 4)
EXPECTED: Final = (
    "'vastflow validate --from-robovast' makes version 1 of it: parameters.scenario, .sim and .sut become a list, "
    "containers become image, resources, and secondary_containers"
)
_ROLES: Final = {"start": "start_pose", "goal": "goal_poses", "goals": "goal_poses"}
_SLOTS: Final = ("scenario", "sim", "sut")
_RESOURCES: Final = ("cpu", "memory")
_MAIN: Final = ("scenario", "sut", "simulation")
"""Containers of which the first that there is becomes the main one."""


class Converter:
    """Converts one file; `left` names what version 1 has no place for."""

    def __init__(self) -> None:
        self.left: list[str] = []
        self._config_files: dict[str, tuple[str, Any]] = {}  # with their places
        self._configured: set[str] = set()

    def campaign(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """Return a file of version 1 with all that maps."""
        found = {"version": 1, **self._kept(data, CampaignSpec.model_fields, "", ("version",))}
        for name, fields in (("execution", ExecutionSpec), ("results_processing", ResultsProcessingSpec)):
            if isinstance(section := data.get(name), Mapping):
                found[name] = self._kept(section, fields.model_fields, f"{name}.", ("containers",))
        if isinstance(execution := found.get("execution"), dict):
            execution |= self._containers(self._mapping(data["execution"].get("containers"), "execution.containers"))
            limit_s, runs = execution.get("timeout"), execution.get("runs_per_job", 1)
            if isinstance(limit_s, int | float) and isinstance(runs, int) and runs > 0:  # of a job, which has several
                execution["timeout"] = limit_s / runs
        if isinstance(search := found.get("search"), Mapping):
            found["search"] = self._family(search, "search", search)
        if isinstance(families := data.get("configuration"), list):
            places = [f"configuration[{k}]" for k in range(len(families))]
            found["configuration"] = [self._family(*each) for each in zip(families, places, strict=True)]
        files = {key: path for key, (_, path) in self._config_files.items() if key in self._configured}
        if files:
            found["execution"]["config_files"] = files
        self.left += [place for key, (place, _) in self._config_files.items() if key not in self._configured]
        return found

    def _kept(
        self, section: Mapping[str, Any], fields: Mapping[str, Any], place: str, special: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        self.left += [f"{place}{key}" for key in section if key not in fields and key not in special]
        return {key: value for key, value in section.items() if key in fields and key not in special}

    def _family(self, family: Any, place: str, fields: Mapping[str, Any] = FamilySpec.model_fields) -> Any:
        if not isinstance(family, Mapping):
            return family
        found = self._kept(family, fields, f"{place}.")
        if isinstance(given := family.get("parameters"), Mapping):
            pairs = [
                pair for slot in given for pair in self._parameters(slot, given[slot], f"{place}.parameters.{slot}")
            ]
            found["parameters"] = [{key: value} for key, value in pairs]
        if isinstance(steps := family.get("variations"), list):
            mapped = (self._variation(step, f"{place}.variations[{k}]") for k, step in enumerate(steps))
            found["variations"] = [step for step in mapped if step is not None]
        return found

    def _parameters(self, slot: str, values: Any, place: str) -> Iterator[tuple[str, Any]]:
        for key, value in self._mapping(values, place).items():
            if name := self._name(slot, str(key), place):
                yield name, value

    def _mapping(self, value: Any, place: str) -> Mapping[str, Any]:
        """Return a mapping as it is; an empty one with a word of what stands there instead."""
        self.left += [] if value is None or isinstance(value, Mapping) else [place]
        return value if isinstance(value, Mapping) else {}

    def _name(self, slot: str, name: str, place: str) -> str:
        """Return the key of a slot's parameter, empty with a word of it where there is none."""
        source, _, path = name.partition(".")
        if slot == "sut" and path and source in self._config_files:
            self._configured.add(source)
            return f"{SUT}{name}"
        key = {"scenario": name, "sut": path}.get(slot, name if name in DIMENSION_OF_KEY else "")
        self.left += [] if key else [f"{place}.{name}"]
        return key

    def _variation(self, step: Any, place: str) -> Any:
        """Return a step of version 1; None where nothing that it varies has a key there."""
        if not isinstance(step, Mapping) or len(step) != 1:
            return step
        ((kind, given),) = step.items()
        if not isinstance(given, Mapping):
            return step
        names: list[str] = []
        found: dict[str, Any] = {}
        for slot in (key for key in _SLOTS if key in given):
            where, value = f"{place}.{kind}.{slot}", given[slot]
            if isinstance(value, Mapping):  # roles of the producer's
                found |= {_ROLES[role]: name for role, name in value.items() if role in _ROLES}
                value = [name for role, name in value.items() if role not in _ROLES]
            named = value if isinstance(value, list) else [value]
            if slot == "sim" and not kind.startswith("Parameter"):  # what it writes, such as a list of obstacles
                slot = "scenario"
            names += filter(None, (self._name(slot, str(name), where) for name in named))
        self.left += [f"{place}.{kind}.reads"] if "reads" in given else []
        if not names and "name" not in given and kind.startswith("Parameter"):
            return None  # and what it varies is named above
        others = {key: value for key, value in given.items() if key not in (*_SLOTS, "reads")}
        if names:
            found["name"] = names[0] if len(names) == 1 else names
        return {kind: found | others}

    def _containers(self, containers: Mapping[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        order = [name for name in _MAIN if name in containers]
        for name in [*order, *(name for name in containers if name not in order)]:
            place = f"execution.containers.{name}"
            given = self._mapping(containers[name], place)
            wanted, files = (self._mapping(given.get(key), f"{place}.{key}") for key in ("resources", "config_files"))
            fields = {key: given[key] for key in ("image",) if key in given}
            resources = {key: value for key, value in wanted.items() if key in _RESOURCES}
            if isinstance(cpu := resources.get("cpu"), float):  # version 1 has whole ones
                resources["cpu"] = math.ceil(cpu)
            found |= {FILE_KEY: files["nav2"]} if "nav2" in files else {}
            fields |= {"resources": resources} if resources else {}
            unused = [key for key in given if key not in ("image", "resources", "config_files")]
            own = {key: (f"{place}.config_files.{key}", path) for key, path in files.items() if key != "nav2"}
            self._config_files |= own  # and that of `nav2` is the built-in robot's
            unused += [f"resources.{key}" for key in wanted if key not in _RESOURCES]
            self.left += [f"{place}.{key}" for key in unused]
            if name == (order or [*containers])[0]:
                found |= fields
            else:
                image = {"image": given["image"]} if "image" in given else {}
                found.setdefault("secondary_containers", []).append(
                    {"name": name, **image, "resources": resources or None}
                )
        return found
