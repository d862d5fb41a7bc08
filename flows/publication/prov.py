"""Provenance of every artifact of a campaign directory as PROV-JSON (W3C), from the directory alone."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

from vastflow.flows.publication.about import Author
from vastflow.flows.request.campaign_file import recorded_keys, recorded_value
from vastflow.flows.request.run_request import SEARCH
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.files import read_json
from vastflow.tasks.store.artifact import FileEntry

_PREFIXES: Final = {
    name: f"urn:vastflow:{name}:" for name in ("vastflow", "file", "configuration", "key", "activity", "agent")
} | {"orcid": "https://orcid.org/"}


class _Document:
    """A PROV document that grows; relations are numbered in their order."""

    def __init__(self) -> None:
        self.content: dict[str, dict[str, Any]] = {"prefix": _PREFIXES}

    def add(self, kind: str, name: str, type_: str | None = None, label: str | None = None, **attributes: Any) -> str:
        own = {"prov:type": type_, "prov:label": label} | {f"vastflow:{key}": each for key, each in attributes.items()}
        self.content.setdefault(kind, {})[name] = {key: each for key, each in own.items() if each is not None}
        return name

    def relate(self, kind: str, **ends: str) -> None:
        relations = self.content.setdefault(kind, {})
        relations[f"_:{kind}{len(relations)}"] = {f"prov:{key}": end for key, end in ends.items()}

    def act(self, name: str, used: Collection[str], made: Collection[str], **attributes: Any) -> None:
        """Add an activity of vastflow, of whose entities only those count that exist."""
        activity = self.add("activity", f"activity:{name}", **attributes)
        self.relate("wasAssociatedWith", activity=activity, agent="agent:vastflow")
        for each in filter(self.content["entity"].__contains__, used):
            self.relate("used", activity=activity, entity=each)
        for each in filter(self.content["entity"].__contains__, made):
            self.relate("wasGeneratedBy", entity=each, activity=activity)

    def derive(self, made: str, used: str) -> None:
        self.relate("wasDerivedFrom", generatedEntity=made, usedEntity=used)


def provenance_of(
    directory: Path, files: Mapping[str, FileEntry], published: Collection[str], authors: Collection[Author]
) -> bytes:
    """Return the provenance of a campaign directory.

    Evaluations of producers and recordings have their keys of the store; traces, verdicts, and the rest have the digests of their
    files, and their activities the digest of the source that they follow from.

    Args:
        files: Place of each file of the directory, also of those that are not published, to its digest and size.

    Raises:
        UnusableDirectory: the directory is damaged.
    """
    document = _Document()
    with reading(directory):
        metadata = read_json(directory / "metadata.json")
        keys, source, version = recorded_keys(metadata), metadata["source"], metadata["vastflow"]
        document.add("agent", "agent:vastflow", "prov:SoftwareAgent", f"vastflow {version}", version=version)
        for author in authors:
            name = f"orcid:{author.orcid}" if author.orcid else f"agent:{author.iri.removeprefix('#')}"
            document.add("agent", name, "prov:Person" if author.is_person else "prov:Organization", author.name)
            document.relate("actedOnBehalfOf", delegate="agent:vastflow", responsible=name)
        for place, entry in sorted(files.items()):
            top, _, below = place.partition("/")
            kind = f"vastflow:{top.capitalize() if below else 'File'}"
            about: dict[str, Any] = {"sha256": entry.sha256, "bytes": entry.size, "published": place in published}
            document.add("entity", f"file:{place}", kind, **about)
        asked = "file:campaign.vast"
        given = [asked, *(f"file:{place}" for place in sorted(files) if place.startswith("inputs/"))]
        traces, evaluated = [], set[str]()
        for row in table_rows(directory / "configurations.parquet"):
            name, checked = row["name"], row["checked_digest"]
            about = {"scenario": row["scenario_digest"], "checked": checked, "family": row["family"]}
            configuration = document.add("entity", f"configuration:{name}", "vastflow:Configuration", **about)
            document.derive(configuration, asked)
            steps = [] if SEARCH in metadata else json.loads(row["steps"])
            for step, producer in zip(steps, metadata.get("producers", {}).get(row["family"], ()), strict=False):
                if "evaluation_source" not in producer or not step.get("inputs"):
                    continue
                by = {"producer": producer["name"], "source": producer["evaluation_source"]}
                content = recorded_value(producer["parameters"])
                key = keys.evaluation(by["source"], by["producer"], content, step["inputs"])
                if key not in evaluated:
                    evaluated.add(key)
                    made = document.add("entity", f"key:{key}", "vastflow:Evaluation", key=key)
                    document.act(key, given, [made], stage="instantiate", inputs=step["inputs"], **by)
                document.derive(configuration, f"key:{key}")
            if other := row["duplicate_of"]:
                document.relate("alternateOf", alternate1=configuration, alternate2=f"configuration:{other}")
                continue
            recording, trace = f"file:recordings/{name}.parquet", f"file:traces/{name}.parquet"
            if recording in document.content["entity"]:
                made_of = {
                    "source": source["execute"],
                    "numeric_class": metadata["numeric_class"],
                    "seed": metadata["seed"],
                }
                outcome, key = [recording, f"file:outputs/{name}.zip"], keys.recordings(checked)
                document.act(f"execute/{name}", [configuration], outcome, stage="execute", key=key, **made_of)
            if trace in document.content["entity"]:
                document.act(f"observe/{name}", [recording], [trace], stage="observe", source=source["observe"])
                traces.append(trace)
        tables = [f"file:{name}.parquet" for name in ("verdicts", "runs", "runs_wide")]
        oracles = json.dumps(source.get("oracles", {}), sort_keys=True)
        document.act("judge", traces, tables, stage="judge", source=source["judge"], oracles=oracles)
        shown = ["evidence.json", "report.html", *(place for place in sorted(files) if place.startswith("figures/"))]
        document.act("report", tables, [f"file:{place}" for place in shown], stage="report")
    return json.dumps(document.content, indent=1, sort_keys=True, ensure_ascii=False).encode() + b"\n"
