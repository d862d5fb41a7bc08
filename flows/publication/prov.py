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

FILE: Final = "file:"
"""Prefix of entities that are files, before their places in the campaign directory."""
SHA256: Final = "vastflow:sha256"
PUBLISHED: Final = "vastflow:published"
_PREFIXES: Final = {
    name: f"urn:vastflow:{name}:" for name in ("vastflow", "file", "configuration", "key", "activity", "agent")
} | {"orcid": "https://orcid.org/"}


class _Document:
    """A PROV document that grows; relations are numbered in their order."""

    def __init__(self) -> None:
        self.content: dict[str, dict[str, Any]] = {"prefix": _PREFIXES}

    def add(self, kind: str, name: str, attributes: Mapping[str, Any]) -> str:
        self.content.setdefault(kind, {})[name] = {key: each for key, each in attributes.items() if each is not None}
        return name

    def relate(self, kind: str, **ends: str) -> None:
        relations = self.content.setdefault(kind, {})
        relations[f"_:{kind}{len(relations)}"] = {f"prov:{key}": end for key, end in ends.items()}


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
        keys, source = recorded_keys(metadata), metadata["source"]
        version = f"vastflow {metadata['vastflow']}"
        software = {"prov:type": "prov:SoftwareAgent", "vastflow:version": metadata["vastflow"]}
        vastflow = document.add("agent", "agent:vastflow", {**software, "prov:label": version})
        for author in authors:
            name = f"orcid:{author.orcid}" if author.orcid else f"agent:{author.iri.removeprefix('#')}"
            kind = "prov:Person" if author.is_person else "prov:Organization"
            document.add("agent", name, {"prov:type": kind, "prov:label": author.name})
            document.relate("actedOnBehalfOf", delegate=vastflow, responsible=name)
        for place, entry in sorted(files.items()):
            about = {SHA256: entry.sha256, "vastflow:bytes": entry.size, PUBLISHED: place in published}
            document.add("entity", f"{FILE}{place}", {"prov:type": f"vastflow:{_type_of(place)}", **about})

        def act(name: str, used: Collection[str], made: Collection[str], **attributes: Any) -> None:
            own = {f"vastflow:{key}": value for key, value in attributes.items()}
            activity = document.add("activity", name, own)
            document.relate("wasAssociatedWith", activity=activity, agent=vastflow)
            for each in used:
                document.relate("used", activity=activity, entity=each)
            for each in made:
                document.relate("wasGeneratedBy", entity=each, activity=activity)

        given = [f"{FILE}{place}" for place in sorted(files) if place == "campaign.vast" or place.startswith("inputs/")]
        traces, evaluated = [], set[str]()
        for row in table_rows(directory / "configurations.parquet"):
            name, checked = row["name"], row["checked_digest"]
            about = {
                "vastflow:scenario": row["scenario_digest"],
                "vastflow:checked": checked,
                "vastflow:family": row["family"],
            }
            configuration = document.add(
                "entity", f"configuration:{name}", {"prov:type": "vastflow:Configuration", **about}
            )
            steps = [] if SEARCH in metadata else json.loads(row["steps"])
            producers = metadata.get("producers", {}).get(row["family"], ())
            for step, producer in zip(steps, producers, strict=False):
                if "evaluation_source" not in producer or not step.get("inputs"):
                    continue
                content = recorded_value(producer["parameters"])
                key = keys.evaluation(producer["evaluation_source"], producer["name"], content, step["inputs"])
                if key not in evaluated:
                    evaluated.add(key)
                    made = document.add(
                        "entity", f"key:{key}", {"prov:type": "vastflow:Evaluation", "vastflow:key": key}
                    )
                    about = {"producer": producer["name"], "source": producer["evaluation_source"]}
                    act(f"activity:{key}", given, [made], stage="instantiate", inputs=step["inputs"], **about)
                document.relate("wasDerivedFrom", generatedEntity=configuration, usedEntity=f"key:{key}")
            document.relate("wasDerivedFrom", generatedEntity=configuration, usedEntity=f"{FILE}campaign.vast")
            if row["duplicate_of"]:
                document.relate(
                    "alternateOf", alternate1=configuration, alternate2=f"configuration:{row['duplicate_of']}"
                )
                continue
            recording, trace = f"{FILE}recordings/{name}.parquet", f"{FILE}traces/{name}.parquet"
            made_of = {
                "numeric_class": metadata["numeric_class"],
                "seed": metadata["seed"],
                "source": source["execute"],
            }
            if recording in document.content["entity"]:
                outcome = [recording, *_existing(document, f"{FILE}outputs/{name}.zip")]
                act(
                    f"activity:execute/{name}",
                    [configuration],
                    outcome,
                    stage="execute",
                    key=keys.recordings(checked),
                    **made_of,
                )
            if trace in document.content["entity"]:
                act(f"activity:observe/{name}", [recording], [trace], stage="observe", source=source["observe"])
                traces.append(trace)
        tables = _existing(document, *(f"{FILE}{name}.parquet" for name in ("verdicts", "runs", "runs_wide")))
        oracles = json.dumps(source.get("oracles", {}), sort_keys=True)
        act("activity:judge", traces, tables, stage="judge", source=source["judge"], oracles=oracles)
        shown = ["evidence.json", "report.html", *(place for place in sorted(files) if place.startswith("figures/"))]
        act("activity:report", tables, _existing(document, *(f"{FILE}{place}" for place in shown)), stage="report")
    return json.dumps(document.content, indent=1, sort_keys=True, ensure_ascii=False).encode() + b"\n"


def _existing(document: _Document, *names: str) -> list[str]:
    return [name for name in names if name in document.content["entity"]]


def _type_of(place: str) -> str:
    top, _, below = place.partition("/")
    return top.capitalize() if below else "File"
