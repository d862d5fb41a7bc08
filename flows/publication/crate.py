"""The research object of a publication: RO-Crate 1.2 with the profile of Process Run Crate."""

import json
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta
from pathlib import PurePosixPath
from typing import Any, Final
from urllib.parse import quote

from vastflow.flows.publication.about import About
from vastflow.flows.publication.contents import CAMPAIGN, PARTS, TOP_FILES
from vastflow.tasks.store.artifact import FileEntry

CRATE: Final = "ro-crate-metadata.json"
_SPECIFICATION: Final = "https://w3id.org/ro/crate/1.2"
_PROFILE: Final = "https://w3id.org/ro/wfrun/process/0.5"
_KINDS: Final = ("Organization", "Person")
_MEDIA: Final = {
    ".parquet": "application/vnd.apache.parquet",
    ".json": "application/json",
    ".jsonl": "application/jsonl",
    ".html": "text/html",
    ".md": "text/markdown",
    ".vast": "application/yaml",
    ".yaml": "application/yaml",
    ".pgm": "image/x-portable-graymap",
}


def crate_of(about: About, metadata: Mapping[str, Any], words: str, files: Mapping[str, FileEntry]) -> bytes:
    """Return the content of `ro-crate-metadata.json`.

    Single files outside of folders are described one by one, folders by the number of their files: a campaign has up to 100,000.

    Args:
        metadata: The campaign's `metadata.json`.
        words: What was run and found.
        files: Place in the crate to digest and size.
    """
    single = [_file(place, files[place]) for place in sorted(files) if "/" not in place.removeprefix(CAMPAIGN)]
    inputs = [_file(place, files[place]) for place in sorted(files) if place.startswith(f"{CAMPAIGN}inputs/")]
    folders = [
        _folder(name, own)
        for name in PARTS
        if (own := [files[each] for each in files if each.startswith(f"{CAMPAIGN}{name}/")])
    ]
    given = [each for each in single if each["@id"] == f"{CAMPAIGN}campaign.vast"] + inputs
    results = [each for each in single if each["@id"].startswith(CAMPAIGN) and each not in given]
    results += [each for each in folders if each["name"] != "inputs"]
    people = [
        _entity(each.iri, _KINDS[each.is_person], name=each.name, affiliation=_named(each.affiliation))
        for each in about.authors
    ]
    names = dict.fromkeys(filter(None, [*(each.affiliation for each in about.authors), about.publisher]))
    terms = f"https://spdx.org/licenses/{about.license}" if about.is_one_license else "#license"
    began = datetime.fromisoformat(metadata["created"])
    graph = [
        _entity(CRATE, "CreativeWork", about={"@id": "./"}, conformsTo={"@id": _SPECIFICATION}),
        _entity(
            "./",
            "Dataset",
            conformsTo={"@id": _PROFILE},
            name=about.title,
            description=about.description,
            datePublished=about.published,
            license={"@id": terms},
            author=_references(people),
            keywords=list(about.keywords),
            version=about.version,
            publisher=_named(about.publisher),
            hasPart=_references([*single, *folders, *inputs]),
            mentions={"@id": "#campaign"},
        ),
        _entity(_PROFILE, ["CreativeWork", "Profile"], name="Process Run Crate", version="0.5"),
        _entity(
            terms, "CreativeWork", name=about.license, description=f"License {about.license} (SPDX) of the results."
        ),
        *people,
        *(_entity(f"#{quote(name)}", "Organization", name=name) for name in names),
        _entity(
            "#campaign",
            "CreateAction",
            name=f"Campaign {metadata['name']}",
            description=words,
            instrument={"@id": "#vastflow"},
            agent=_references(people),
            object=_references(given),
            result=_references(results),
            startTime=began.isoformat(),
            endTime=(began + timedelta(seconds=round(metadata["counts"]["wall_s"]))).isoformat(),
            actionStatus={"@id": "http://schema.org/CompletedActionStatus"},
        ),
        _entity(
            "#vastflow",
            "SoftwareApplication",
            name="vastflow",
            version=metadata["vastflow"],
        ),
        *single,
        *folders,
        *inputs,
    ]
    context = [f"{_SPECIFICATION}/context", {"sha256": "https://schema.org/sha256"}]
    return json.dumps({"@context": context, "@graph": graph}, indent=1, ensure_ascii=False).encode() + b"\n"


def _entity(place: str, kind: str | list[str], **properties: Any) -> dict[str, Any]:
    """Return an entity without the properties that are empty."""
    return {"@id": place, "@type": kind, **{key: value for key, value in properties.items() if value}}


def _named(organization: str) -> dict[str, str]:
    return {"@id": f"#{quote(organization)}"} if organization else {}


def _references(entities: Iterable[Mapping[str, Any]]) -> list[dict[str, str]]:
    return [{"@id": each["@id"]} for each in entities]


def _file(place: str, entry: FileEntry) -> dict[str, Any]:
    name = PurePosixPath(place).name
    about = {"description": TOP_FILES.get(name), "encodingFormat": _MEDIA.get(PurePosixPath(place).suffix)}
    return _entity(quote(place), "File", name=name, contentSize=str(entry.size), sha256=entry.sha256, **about)


def _folder(name: str, files: list[FileEntry]) -> dict[str, Any]:
    words = f"{PARTS[name]}. {len(files):,} files, {sum(each.size for each in files):,} bytes."
    return _entity(f"{CAMPAIGN}{name}/", "Dataset", name=name, description=words)
