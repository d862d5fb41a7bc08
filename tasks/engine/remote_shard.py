"""A shard for a worker elsewhere: a bundle of its inputs and a report of its results in the store.

Configurations, oracles, and keys are one artifact; every file they name is another, by its content. Files keep their places
relative to each other; the folder above all of them is the worker's own.
"""

import hashlib
import json
import os
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.oracles.judgement.oracle import Oracle
from vastflow.oracles.judgement.registry import oracle_of
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.files import Unreadable, read_text, yaml_value
from vastflow.sim.model.scenario import ProcessSetup, Scenario, setup_of
from vastflow.sim.nav2.parameter_files.parameter_file import plug_ins_in
from vastflow.sim.plug_ins.loading import snapshot_behind
from vastflow.sim.scenario.language.reading import files_of
from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import artifact_of, inside, manifest_of
from vastflow.tasks.store.store import Artifact, Lost, Store

_SCENARIO: Final = ".osc"
_HEADERS: Final = (".yaml", ".yml")


def needed_files(path: Path) -> tuple[Path, ...]:
    """A file and those it names: a map's picture, what a scenario file imports.

    One that is named from the root of the file system is not among them: it means the worker's own file.
    """
    if path.suffix == _SCENARIO:
        return tuple(_normal(file) for file in files_of(path))
    if path.suffix in _HEADERS and (picture := _picture(path)) is not None:
        return path, picture
    return (path,)


def _picture(path: Path) -> Path | None:
    """The picture of a map's header; None if the file is something else."""
    try:
        content = yaml_value(read_text(path))
    except Unreadable:
        return None
    if not isinstance(content, dict) or not {"image", "resolution", "origin"} <= content.keys():
        return None
    image = Path(str(content["image"]))
    return None if image.is_absolute() else _normal(path.parent / image)


def _normal(path: Path) -> Path:
    return Path(os.path.abspath(path))


STAGE: Final = "bundle"
LAYOUT: Final = 1

_CONTENT: Final = "bundle.json"
_FILE: Final = "content"
_AT_A_TIME: Final = 8


class BundleError(ValueError):
    """A bundle that can't be packed, or whose content is another after unpacking; says what was found."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """The inputs of a worker.

    Attributes:
        campaign: The campaign's name.
        promise: See `promise_of`.
        seed: `execution.seed`.
        oracles: Oracles of every configuration.
    """

    campaign: str
    promise: Mapping[str, str]
    seed: int
    oracles: tuple[Oracle[Any], ...]
    configurations: tuple[ConfigurationRuns, ...]


@dataclass(frozen=True, slots=True)
class _Packed:
    """A file as a bundle has it: its digest, and whether it may be executed."""

    sha256: str
    executable: bool


class Packer:
    """Packs bundles of one campaign; a file that several of them name is read once.

    Args:
        campaign: The campaign's name.
        base: The campaign file's folder.
    """

    def __init__(self, store: Store, campaign: str, keys: Keys, oracles: Sequence[Oracle[Any]], base: Path) -> None:
        self._store = store
        self._campaign = campaign
        self._keys = keys
        self._oracles = oracles
        self._base = _absolute(base)
        self._copies = _plug_ins(oracles)
        self._files: dict[Path, _Packed] = {}
        self._needed: dict[Path, tuple[Path, ...]] = {}

    def packed(self, configurations: Sequence[ConfigurationRuns]) -> str:
        """Store a bundle with these configurations and their files, and return its key.

        Raises:
            BundleError: a file of theirs can't be read.
            StoreError: the store can't be used.
        """
        files = self._files_of(configurations)
        root = Path(os.path.commonpath([self._base, *(oracle_base(oracle) for oracle in self._oracles), *files]))
        if root in files:
            root = root.parent
        content = {
            "layout": LAYOUT,
            "campaign": self._campaign,
            "promise": promise_of(self._keys),
            "seed": self._keys.seed,
            "oracles": [self._written_oracle(oracle, root) for oracle in self._oracles],
            "configurations": [self._written(configuration, root) for configuration in configurations],
            "files": [[_inside(root, file), *asdict(self._files[file]).values()] for file in sorted(files)],
        }
        text = json.dumps(content, separators=(",", ":"), sort_keys=True).encode()
        key = _key(hashlib.sha256(text).hexdigest())
        self._put(files)
        if self._store.find(key) is None:
            self._store.put(key, {_CONTENT: text})
        return key

    def _files_of(self, configurations: Sequence[ConfigurationRuns]) -> set[Path]:
        """Every file that the configurations and oracles need, digested."""
        named = [file for configuration in configurations for file in _contents_of(configuration.scenario)]
        for file in plug_ins_in(named):
            for snapshot in file.plug_ins.values():
                self._copies |= snapshot.contents
        contents = {_absolute(file.path) for file in named}
        found = set(self._copies)
        for path in contents:
            if path not in self._needed:
                try:
                    self._needed[path] = needed_files(path)
                except FileError as error:
                    raise BundleError(
                        f"{error}; it changed since the campaign was read, run the campaign again"
                    ) from None
            found.update(self._needed[path])
        for path in found - self._files.keys():
            try:
                content, mode = self._copy(path).read_bytes(), self._copy(path).stat().st_mode
                self._files[path] = _Packed(hashlib.sha256(content).hexdigest(), bool(mode & 0o100))
            except OSError as error:
                raise BundleError(f"{path} can't be read ({error.strerror}); workers elsewhere need it") from None
        return found

    def _copy(self, path: Path) -> Path:
        """Return the place of a file's content, which for a plug-in is its copy."""
        return self._copies.get(path, path)

    def _put(self, files: Iterable[Path]) -> None:
        def put(path: Path) -> None:
            sha256 = self._files[path].sha256
            content = self._copy(path).read_bytes()
            if hashlib.sha256(content).hexdigest() != sha256:
                raise BundleError(f"{path} changed since the campaign was read; run the campaign again")
            self._store.put(_key(sha256), {_FILE: content})

        absent = {self._files[path].sha256: path for path in files}
        absent = {sha256: path for sha256, path in absent.items() if self._store.find(_key(sha256)) is None}
        with ThreadPoolExecutor(_AT_A_TIME) as writers:
            for _ in writers.map(put, absent.values()):
                pass

    def _written(self, configuration: ConfigurationRuns, root: Path) -> dict[str, Any]:
        scenario = configuration.scenario
        return {
            "name": configuration.name,
            "family": configuration.family,
            "place": configuration.place,
            "runs": configuration.runs,
            "digest": scenario.digest,
            "checked": configuration.checked,
            "abstract": _written(scenario.abstract, root),
            "timeout_s": scenario.timeout_s,
            "environment": _written(scenario.environment, root),
            "task": _written(scenario.task, root),
            "system": _written(scenario.system, root),
            "programs": scenario.programs and _written(scenario.programs.content, root),
        }

    def _written_oracle(self, oracle: Oracle[Any], root: Path) -> dict[str, Any]:
        return {
            "name": oracle.name,
            "parameters": oracle.parameters.model_dump(mode="json"),
            "base": _inside(root, oracle_base(oracle)),
        }


def unpacked(store: Store, key: str, folder: Path) -> Bundle:
    """The bundle of this key, its files below `folder`.

    Raises:
        Lost: the bundle or a file of it is not in the store, or not the content of its key.
        BundleError: what was unpacked is not what was packed.
        OracleError: an oracle is not installed here.
        StoreError: the store can't be used.
    """
    content = json.loads(_content(store, key, _CONTENT))
    if content["layout"] != LAYOUT:
        raise BundleError(
            f"expected {LAYOUT}, with this version of vastflow, got a bundle of layout {content['layout']}"
        )
    _unpack_files(store, content["files"], folder)
    oracles = tuple(_oracle(row, folder) for row in content["oracles"])
    for row in content["oracles"]:  # a name such as ../judge.py:Judge is looked up from there
        _placed(folder, row["base"]).mkdir(parents=True, exist_ok=True)
    return Bundle(
        content["campaign"],
        content["promise"],
        content["seed"],
        oracles,
        tuple(_configuration(row, folder) for row in content["configurations"]),
    )


def promise_of(keys: Keys) -> dict[str, str]:
    """Return all in keys that depends on the machine, by its name in messages."""
    return {
        "the numeric class": keys.numeric,
        "the code that executes runs": keys.execute_source,
        "the code that observes them": keys.observe_source,
        "the code that judges them": keys.judge_source,
        "the oracles' parameters": digest(list(keys.oracles)),
    }


def differences(promise: Mapping[str, str], own: Keys) -> list[str]:
    """In what a worker's own keys differ from a promise, in words; empty where they make the same artifacts."""
    here = promise_of(own)
    return [what for what in here if promise.get(what) != here[what]]


def oracle_base(oracle: Oracle[Any]) -> Path:
    """The folder that an oracle's name is relative to."""
    return _absolute(oracle.base)


def _plug_ins(oracles: Sequence[Oracle[Any]]) -> dict[Path, Path]:
    """Return the place of each file of oracles' plug-ins to its copy, without those named by absolute paths."""
    snapshots = [snapshot_behind(type(oracle)) for oracle in oracles if not Path(oracle.name).is_absolute()]
    return {path: copy for each in snapshots if each is not None for path, copy in each.contents.items()}


def _contents_of(scenario: Scenario) -> Iterator[FileContent]:
    parts: list[Value] = [scenario.abstract, scenario.environment, scenario.task, scenario.system]
    if scenario.programs is not None:
        parts.append(scenario.programs.content)
    for part in parts:
        yield from _files_in(part)


def _files_in(value: Value) -> Iterator[FileContent]:
    if isinstance(value, FileContent):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _files_in(item)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for item in value:
            yield from _files_in(item)


def _written(value: Value, root: Path) -> Any:
    """A value as JSON that keeps files, mappings and the rest apart."""
    if isinstance(value, FileContent):
        return {"file": [_inside(root, _absolute(value.path)), value.digest]}
    if isinstance(value, Mapping):
        return {"map": {key: _written(item, root) for key, item in value.items()}}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_written(item, root) for item in value]
    return value


def _read(written: Any, folder: Path) -> Any:
    if isinstance(written, list):
        return [_read(item, folder) for item in written]
    if isinstance(written, dict) and "map" in written:
        return {key: _read(item, folder) for key, item in written["map"].items()}
    if isinstance(written, dict):
        place, content = written["file"]
        return FileContent(str(_placed(folder, place)), content)
    return written


def _configuration(row: Mapping[str, Any], folder: Path) -> ConfigurationRuns:
    programs: ProcessSetup | None = None
    if row["programs"] is not None:
        programs = setup_of(_read(row["programs"], folder))
    abstract, environment, task, system = (
        _read(row[part], folder) for part in ("abstract", "environment", "task", "system")
    )
    scenario = Scenario(abstract, row["timeout_s"], environment, task, system, programs)
    if scenario.digest != row["digest"]:
        raise BundleError(f"{row['name']} is another scenario after unpacking than before")
    configuration = ConfigurationRuns(row["name"], row["family"], row["place"], scenario, row["runs"])
    if configuration.checked != row["checked"]:
        raise BundleError(
            f"{row['name']}: its scenario file, parameters or defaults are read differently here; give all workers the "
            "campaign's own version of vastflow"
        )
    return configuration


def _oracle(row: Mapping[str, Any], folder: Path) -> Oracle[Any]:
    return oracle_of(row["name"], row["parameters"], _placed(folder, row["base"]))


def _unpack_files(store: Store, files: Sequence[Sequence[Any]], folder: Path) -> None:
    def unpack(file: Sequence[Any]) -> None:
        place, sha256, executable = file
        target = _placed(folder, place)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(_content(store, _key(sha256), _FILE))
        target.chmod(0o755 if executable else 0o644)

    with ThreadPoolExecutor(_AT_A_TIME) as readers:
        for _ in readers.map(unpack, files):
            pass


def _content(store: Store, key: str, name: str) -> bytes:
    """A file by the digest in its key: a store's manifest may be anybody's."""
    content = store.read(key, name)
    if _key(hashlib.sha256(content).hexdigest()) != key:
        store.discard(key, said := f"{name} is not the content of its key")
        raise Lost(f"{key}: {said}")
    return content


def _placed(folder: Path, place: str) -> Path:
    return folder if place == "." else inside(folder, place)


def _inside(root: Path, path: Path) -> str:
    return path.relative_to(root).as_posix()


def _absolute(path: str | Path) -> Path:
    """Return an absolute path with links left alone, as files name each other by these."""
    return Path(os.path.abspath(path))


def _key(sha256: str) -> str:
    return f"{STAGE}/{sha256[:2]}/{sha256}"


_PART: Final = "part.json"


@dataclass(frozen=True, slots=True)
class ReportPart:
    """News of one flow run.

    Attributes:
        artifacts: What is in the store of configurations that no earlier part told of.
        faults: What broke in the flow run.
        last: Whether no other part follows.
    """

    artifacts: tuple[Artifact, ...]
    faults: tuple[RunFault, ...] = ()
    last: bool = False


class Report:
    """The report of this process's flow run, as it grows; any thread may add to it.

    Args:
        flow_run: Its id.
    """

    def __init__(self, engine: Engine, flow_run: str) -> None:
        self._engine = engine
        self._flow_run = flow_run
        self._parts = 0
        self._lock = threading.Lock()
        self._told: set[str] = set()

    def add(self, configurations: Sequence[ConfigurationRuns], last: bool = False) -> None:
        """Tell of configurations that are through, of each once; with the last part, of what broke too.

        Raises:
            StoreError: the store can't be used.
        """
        with self._lock:
            news = [configuration for configuration in configurations if configuration.name not in self._told]
            if news or last:
                found = [each for configuration in news for each in self._engine.index.stored(configuration)]
                kept = [
                    artifact for each in found for artifact in (each.recordings, each.trace, each.verdicts) if artifact
                ]
                part = ReportPart(tuple(kept), self._engine.faults if last else (), last)
                write_part(self._engine.index.store, self._flow_run, self._parts, part)
                self._parts += 1
                self._told.update(configuration.name for configuration in news)


def write_part(store: Store, flow_run: str, number: int, part: ReportPart) -> None:
    """Keep a part, the first of number 0."""
    content = {
        "artifacts": [[each.key, manifest_of(each).decode()] for each in part.artifacts],
        "faults": [asdict(fault) for fault in part.faults],
        "last": part.last,
    }
    store.put(_report_key(flow_run, number), {_PART: json.dumps(content).encode()})


def read_part(store: Store, flow_run: str, number: int) -> ReportPart | None:
    """A part; None where it is not there yet, or lost: what is missing is tried again then."""
    key = _report_key(flow_run, number)
    store.changed(key)
    try:
        content: dict[str, Any] = json.loads(store.read(key, _PART))
    except Lost:
        return None
    artifacts = tuple(artifact_of(key, manifest.encode()) for key, manifest in content["artifacts"])
    return ReportPart(artifacts, tuple(RunFault(**fault) for fault in content["faults"]), content["last"])


def _report_key(flow_run: str, number: int) -> str:
    return f"{STAGE}/reports/{flow_run}/{number}"
