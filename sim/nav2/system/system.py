"""The navigation stack as a system under test."""

import functools
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_of
from vastflow.sim.nav2.parameter_files import chosen
from vastflow.sim.nav2.parameter_files.command_chain import command_chain, filter_chains
from vastflow.sim.nav2.parameter_files.costmaps import filtered_by, masks_of, missing_mask
from vastflow.sim.nav2.parameter_files.document import dotted, read_document
from vastflow.sim.nav2.parameter_files.findings import Status, defaults_row, findings, left_out, omitted
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import file_value, frozen, read_nav2_document
from vastflow.sim.nav2.parameter_files.plug_ins import short_names
from vastflow.sim.nav2.parameter_files.refusals import refusals
from vastflow.sim.nav2.parameter_files.releases import changes_since_jazzy, guessed_release, release_of
from vastflow.sim.nav2.parameter_files.robots import namespace_text
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.file import read_file
from vastflow.sim.nav2.system.robot import lidar_of, robot_facts, robot_of
from vastflow.sim.nav2.system.spelled_out import assumed_keys, spelled_out
from vastflow.sim.system.facts import RobotFact, robot_summary
from vastflow.sim.system.keys import CONTROLLER_KEY, COVARIANCE_KEY, MASK_KEYS, RELEASE_KEY
from vastflow.sim.system.robot import ROBOT_KEY
from vastflow.sim.system.system import FileParameter, Masks, SystemFile
from vastflow.sim.world.robot_model import Lidar, Robot


@dataclass(frozen=True, eq=False)
class Nav2System:
    """A robot with Nav2's stack; see `vastflow.sim.system.system.System`."""

    values: Mapping[str, Value]
    is_drawn: bool = False

    @functools.cached_property
    def parameters(self) -> NavParameters:
        """All parameters of the stack."""
        read = chosen.drawn_parameters if self.is_drawn else chosen.parameters_of
        return read(self.values)

    @property
    def robot(self) -> Robot:
        return robot_of(self.parameters)

    @property
    def lidar(self) -> Lidar:
        return lidar_of(self.parameters)

    @property
    def inscribed_radius_m(self) -> float:
        return inscribed_radius_of(self.parameters)

    @property
    def start_outline(self) -> NDArray[np.float64]:
        return chosen.local_outline(self.parameters)

    @property
    def needs_map(self) -> bool:
        return not self.parameters.global_costmap.in_odom

    @property
    def masks(self) -> Masks:
        return masks_of(self.values, self.parameters)

    @property
    def software(self) -> str:
        kind = type(self.parameters.controller)
        return f"{kind.__module__}.{kind.__qualname__}"

    @property
    def facts(self) -> tuple[RobotFact, ...]:
        return robot_facts(self.parameters)

    @property
    def whose(self) -> str:
        read = "parameters of Nav2 Jazzy's default file"
        if file := chosen.file_of(self.values):
            name = Path(file.document.file).name + (" and the campaign" * (robot_facts(file.parameters) != self.facts))
            count = sum(each.status == "modeled" for each in findings(file))
            read = f"{count} parameter{'' if count == 1 else 's'} from {name}"
        return robot_summary(self.facts, read)

    @property
    def defaults(self) -> Mapping[str, Mapping[str, Value]] | None:
        file = chosen.file_of(self.values)
        return defaults_row(file) if file else None

    def missing_masks(self) -> Iterator[tuple[str, Complaint]]:
        for key in MASK_KEYS:
            if key not in self.values and (costmaps := filtered_by(key, self.parameters)):
                yield key, missing_mask(key, costmaps)

    def check_all(self) -> None:
        _ = self.parameters

    def check(self, key: str, value: Value) -> bool:
        return chosen.check_key(self.values, key, value)

    def unread(self, undecided: Iterable[str] = ()) -> tuple[str, ...]:
        return chosen.unread(self.values, undecided)

    def intended_key(self, key: str, others: Iterable[str] = ()) -> str | None:
        return chosen.intended_key(self.values, key, others)

    def unused_because(self, key: str) -> str:
        return chosen.unused_because(self.values, key)

    def usual(self, key: str) -> float | None:
        if key in chosen.OWN_KEYS:
            return None if key.startswith(ROBOT_KEY) or key == COVARIANCE_KEY else 0.0
        known = chosen.default_document().values
        found = {known[path] for path in chosen.targets(known, key) if isinstance(known.get(path), int | float)}
        number = found.pop() if len(found) == 1 else None
        return float(number) if isinstance(number, int | float) and not isinstance(number, bool) else None

    def spelled_out(self) -> Mapping[str, Value]:
        return spelled_out(self.values)

    def assumed_keys(self) -> frozenset[str]:
        return assumed_keys(self.values)


class Nav2:
    """Systems with Nav2's stack; see `vastflow.sim.system.system.SystemKind`."""

    @staticmethod
    def of(values: Mapping[str, Value], *, is_drawn: bool = False) -> Nav2System:
        return Nav2System(values, is_drawn)

    @staticmethod
    def variants(values: Mapping[str, Value], varied: Collection[str]) -> list[Mapping[str, Value]]:
        if CONTROLLER_KEY not in varied:
            return [values]
        return [{**values, CONTROLLER_KEY: name} for name in short_names()]

    @staticmethod
    def read_file(path: Path, values: Mapping[str, Value]) -> SystemFile:
        return read_file(path, values.get(RELEASE_KEY))

    @staticmethod
    def file_content(path: Path, within: Path | None = None) -> FileContent:
        return file_value(frozen(read_nav2_document(path), within))

    @staticmethod
    def file_parameters(path: Path) -> Iterator[FileParameter]:
        document = read_document(path)
        for location, value in document.values.items():
            yield FileParameter(dotted(location), value, document.place(location)[0])

    @staticmethod
    def account(path: Path) -> Mapping[str, Any]:
        found = interpretation(read_nav2_document(path))
        rows = findings(found)
        counted = Counter[str](row.status for row in rows)
        counts = {status: counted[status] for status in get_args(Status)}
        parameters, kinds = [], {*found.reader.kinds.values()}
        for row in rows:
            place = {"path": dotted(row.path), "line": row.place[0], "column": row.place[1]}
            parameters.append({**place, "value": row.value, "status": row.status, "used": row.used, "why": row.why})
        return {
            "file": found.document.file,
            "robot_namespace": namespace_text(found.document.robot),
            "other_robots": [*dict.fromkeys(map(namespace_text, found.document.others.values()))],
            "counts": counts,
            "parameters": parameters,
            "robot": asdict(robot_of(found.parameters)),
            "lidar": asdict(lidar_of(found.parameters)),
            "robot_facts": [asdict(fact) for fact in robot_facts(found.parameters)],
            "left_out": {dotted(path): value for path, value in left_out(found).items()},
            "omitted": [
                {"path": dotted(path), "value": declared.default, "source": declared.source, key: other}
                for path, declared, other, is_used in omitted(found)
                for key in ["jazzy" if is_used else "built_in"]
            ],
            "refused": [str(fault) for fault in refusals(found)],
            "warnings": {dotted(path): list(said) for path, said in found.reader.warnings.items()},
            "nav2_release": release_of(found.document),
            "nav2_release_by": guessed_release(found.document)[1],
            "release_differences": [change._asdict() for change in changes_since_jazzy(found.document, kinds)],
            "command_chain": command_chain(found.document, found.left_away),
            "filter_chains": [*filter_chains(found.reader)],
            "nodes_of_jazzy": found.replaced,
            "nodes_of_code": found.absent,
            "nodes_left_away": found.left_away,
        }
