"""The campaign file for flows: read and checked with its oracles, its notes, and its store."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.judgment.registry import OracleError, oracle_of, oracles_of
from vastflow.producers.campaign import Campaign, OracleRequest, load_campaign, oracle_requests
from vastflow.producers.campaign_file.document import Document, read_document
from vastflow.producers.campaign_file.spec import EvaluationSpec
from vastflow.producers.model.faults import Location
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.plug_ins.loading import snapshot_behind
from vastflow.sim.plug_ins.snapshot import plug_ins_in
from vastflow.tasks.engine.evaluation import content_of, producers_in
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import SourceTree
from vastflow.tasks.store.store import Store, open_store

MOST_OF_A_FILE: Final = 4


def terminal_lines(notes: Sequence[Fault]) -> Iterator[str]:
    """Format notes, one per line; count further notes of a parameter file or floor plan."""
    elsewhere: dict[tuple[str, str], list[Fault]] = {}
    for note in notes:
        if rest := _rest(note):
            elsewhere.setdefault((note.place.file, rest), []).append(note)
        else:
            yield str(note)
    for (file, rest), found in elsewhere.items():
        shown = found if len(found) <= MOST_OF_A_FILE else found[: MOST_OF_A_FILE - 1]
        yield from map(str, shown)
        if len(shown) < len(found):
            yield f"{file}: and {len(found) - len(shown)} more {rest}"


def _rest(note: Fault) -> str:
    """Name the kind of hidden notes and the command that shows them; empty if always shown."""
    if note.kind == "not modeled":
        return f"that are not modeled (`vastflow params {note.place.file}` shows them all)"
    if note.kind == "drawn":
        return "warnings of its variations (`vastflow floorplan variations` shows them all)"
    if note.place.file.endswith((".fpm", ".fpm2")):
        return f"warnings (`vastflow floorplan geometry {note.place.file}` shows them all)"
    return ""


def read_campaign(
    path: Path, map_dir: Path | None = None, *, strict: bool = False
) -> tuple[Campaign, tuple[Oracle[Any], ...]]:
    """The campaign at `path` and the oracles that judge it, `success` first.

    Args:
        map_dir: See `RunRequest`.
        strict: Whether keys that nothing knows are faults.

    Raises:
        FileError: every fault of the file.
    """
    try:
        campaign = load_campaign(path, map_dir)
    except FileError as error:
        beside: list[Fault] = []  # those of the oracles
        with suppress(FileError, ValidationError):  # said already
            document = read_document(path)
            evaluation = EvaluationSpec.model_validate(document.data.get("evaluation") or {})
            beside = list(_faults(oracle_requests(evaluation), document, path.resolve().parent))
        raise FileError([*error.faults, *beside]) from None
    if faults := list(_faults(campaign.oracles, campaign.document, campaign.path.parent)):
        raise FileError(faults)
    requests = [(request.name, request.parameters) for request in campaign.oracles]
    oracles = oracles_of(requests, campaign.path.parent)
    unknown = [note for note in campaign.notes if strict and note.kind == "unknown key"]
    faults = [replace(note, kind="error") for note in unknown]
    if faults := [*faults, *_quantity_faults(campaign, oracles)]:
        raise FileError(faults)
    return replace(campaign, notes=(*campaign.notes, *_hidden(campaign, oracles))), oracles


def _hidden(campaign: Campaign, oracles: Iterable[Oracle[Any]]) -> Iterator[Fault]:
    """Warn of inputs of plug-ins that are in no key."""
    chain = [producer for family in campaign.families for producer in family.producers]
    producers = [each for producer in chain for each in (producer, *producers_in(producer.parameters))]
    snapshots = [snapshot_behind(kind) for kind in dict.fromkeys(map(type, [*producers, *oracles]))]
    values = [family.values for family in campaign.families]
    snapshots += [snapshot for file in plug_ins_in(values) for snapshot in file.plug_ins.values()]
    base = campaign.path.parent
    for hidden in dict.fromkeys(each for snapshot in snapshots if snapshot is not None for each in snapshot.hidden):
        file = base / os.path.relpath(hidden.file, base)
        what = f"{hidden.what} is in no key, so that an edit of it goes unnoticed"
        yield Fault(Place(str(file), hidden.line, 1, hidden.name), what, "use a parameter in its place", "warning")


def _faults(requests: Iterable[OracleRequest], document: Document, base: Path) -> Iterator[Fault]:
    for request in requests:
        try:
            oracle_of(request.name, request.parameters, base)
        except OracleError as error:
            for fault in error.faults:
                where = (*request.location, *fault.location)
                yield document.fault(where, fault.problem, fault.expected, "value" if fault.location else "key")


def _quantity_faults(campaign: Campaign, oracles: Iterable[Oracle[Any]]) -> Iterator[Fault]:
    if campaign.search is None:
        return
    metrics = {oracle.name: oracle.metrics for oracle in oracles}
    for name, each in campaign.search.quantities.items():
        where: Location = ("search", "extract", "params", name)
        if each.oracle is not None and each.oracle not in metrics:
            what = f"no oracle {each.oracle!r} judges this campaign"
            yield campaign.fault((*where, "oracle"), what, did_you_mean(each.oracle, metrics))
        elif each.oracle is not None and each.metric is not None and each.metric not in metrics[each.oracle]:
            right = did_you_mean(each.metric, metrics[each.oracle], "it measures none")
            yield campaign.fault((*where, "metric"), f"no metric {each.metric!r} of oracle {each.oracle}", right)


def campaign_name(campaign: Campaign) -> str:
    """`metadata.name`, else the file's stem."""
    return str(campaign.spec.metadata.get("name") or campaign.path.stem)


@dataclass(frozen=True)
class OpenCampaign:
    """A campaign as its file was when it was read, its oracles, `success` first, and where its results are."""

    campaign: Campaign = field(repr=False)
    oracles: tuple[Oracle[Any], ...] = field(repr=False)
    store: Store = field(repr=False)

    @property
    def path(self) -> Path:
        """The campaign file."""
        return self.campaign.path

    @property
    def file(self) -> str:
        """The campaign file as it was named, for messages."""
        return self.campaign.document.file

    @property
    def name(self) -> str:
        """See `campaign_name`."""
        return campaign_name(self.campaign)


def open_campaign(path: str | os.PathLike[str], store: str | os.PathLike[str] | None) -> OpenCampaign:
    """Read a campaign file and open the store.

    Raises:
        FileError: every fault of the file, or why this version can't run it.
        StoreError: the store can't be used.
    """
    campaign, oracles = read_campaign(Path(path))
    if campaign.unexecutable:
        raise FileError(campaign.unexecutable)
    if campaign.search is not None:
        what = "a search proposes its configurations by what their runs come to"
        raise FileError([campaign.fault(("search",), what, "use vastflow run, which has all stages", "key")])
    return OpenCampaign(campaign, oracles, open_store(store))


def campaign_keys(tree: SourceTree, seed: int, oracles: Sequence[Oracle[Any]]) -> Keys:
    """Keys of the artifacts that this process would compute; `seed` is `execution.seed`."""
    sources = tree.files()  # before they are read: what is edited in between is found out, too
    return Keys(
        numeric=numeric_class(),
        execute_source=tree.digest(*EXECUTE_SOURCE),
        observe_source=tree.digest(*OBSERVE_SOURCE),
        judge_source=tree.digest(*JUDGE_SOURCE),
        seed=seed,
        oracles=[
            (oracle.name, digest(tree.plug_in_digest(type(oracle)), content_of(oracle.parameters)))
            for oracle in oracles
        ],
        sources=sources,
    )


def recorded_keys(metadata: Mapping[str, Any]) -> Keys:
    """Keys of the artifacts that a campaign directory was made of; raises `KeyError` if its `metadata.json` does not say."""
    source = metadata["source"]
    keyed = source.get("oracles", {})  # absent where verdicts had one key for all oracles
    return Keys(
        numeric=metadata["numeric_class"],
        execute_source=source["execute"],
        observe_source=source["observe"],
        judge_source=source["judge"],
        seed=metadata["seed"],
        oracles=[
            (oracle["name"], keyed.get(oracle["name"]) or digest(recorded_value(oracle["parameters"])))
            for oracle in metadata["oracles"]
        ],
    )


def recorded_value(plain: Any) -> Value:
    """Decode a value of a campaign directory; `{"file": digest}` is a file at its present path."""
    if isinstance(plain, Mapping):
        if plain.keys() == {"file"}:
            return FileContent("", str(plain["file"]))
        return {key: recorded_value(item) for key, item in plain.items()}
    if isinstance(plain, list):
        return [recorded_value(item) for item in plain]
    value: Value = plain
    return value
