"""The research object of a publication: RO-Crate 1.2 with the profile of Process Run Crate."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import PurePosixPath
from typing import Any, Final
from urllib.parse import quote

from vastflow.flows.publication.about import About, Author
from vastflow.flows.publication.contents import PARTS
from vastflow.tasks.store.artifact import FileEntry

CRATE: Final = "ro-crate-metadata.json"
_CONTEXT: Final = "https://w3id.org/ro/crate/1.2/context"
_SPECIFICATION: Final = "https://w3id.org/ro/crate/1.2"
_PROFILE: Final = "https://w3id.org/ro/wfrun/process/0.5"
_MEDIA: Final = {
    ".parquet": "application/vnd.apache.parquet",
    ".json": "application/json",
    ".jsonl": "application/jsonl",
    ".html": "text/html",
    ".md": "text/markdown",
    ".vast": "application/yaml",
}


@dataclass(frozen=True)
class PublishedRun:
    """The campaign as the crate's action: times, version of vastflow, and what was counted."""

    name: str
    version: str
    created: str
    wall_s: float
    words: str


def crate_of(about: About, ran: PublishedRun, files: Mapping[str, FileEntry], campaign: str) -> bytes:
    """Return the content of `ro-crate-metadata.json`.

    Single files outside of folders are described one by one, folders by the pattern of their files: a campaign has up to 100,000.

    Args:
        files: Place in the crate to digest and size.
        campaign: Place of the campaign directory in the crate, with a slash.
    """
    described = [_file(place, files[place]) for place in sorted(files) if "/" not in place.removeprefix(campaign)]
    inputs = [_file(place, files[place]) for place in sorted(files) if place.startswith(f"{campaign}inputs/")]
    folders = [
        _folder(campaign, name, files) for name in PARTS if any(each.startswith(f"{campaign}{name}/") for each in files)
    ]
    people = [_author(each) for each in about.authors]
    organizations = {each["@id"]: each for person in people for each in [person.pop("_affiliation")] if each}
    software, action = {"@id": "#vastflow"}, {"@id": "#campaign"}
    given = {f"{campaign}campaign.vast", f"{campaign}inputs/"}
    results = [each for each in (*described, *folders) if each["@id"].startswith(campaign) and each["@id"] not in given]
    began = datetime.fromisoformat(ran.created)
    graph: list[dict[str, Any]] = [
        {
            "@id": CRATE,
            "@type": "CreativeWork",
            "about": {"@id": "./"},
            "conformsTo": {"@id": _SPECIFICATION},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "conformsTo": {"@id": _PROFILE},
            "name": about.title,
            "description": about.description,
            "datePublished": about.published,
            "license": {"@id": _license(about)["@id"]},
            "author": _references(people),
            "keywords": list(about.keywords),
            "hasPart": _references([*described, *folders, *inputs]),
            "mentions": action,
            **({"version": about.version} if about.version else {}),
            **({"publisher": {"@id": "#publisher"}} if about.publisher else {}),
        },
        {"@id": _PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"},
        _license(about),
        *people,
        *organizations.values(),
        *([{"@id": "#publisher", "@type": "Organization", "name": about.publisher}] if about.publisher else []),
        {
            **action,
            "@type": "CreateAction",
            "name": f"Campaign {ran.name}",
            "description": ran.words,
            "instrument": software,
            "agent": _references(people),
            "object": _references([{"@id": f"{campaign}campaign.vast"}, *inputs]),
            "result": _references(results),
            "startTime": began.isoformat(),
            "endTime": (began + timedelta(seconds=round(ran.wall_s))).isoformat(),
            "actionStatus": {"@id": "http://schema.org/CompletedActionStatus"},
        },
        {
            **software,
            "@type": "SoftwareApplication",
            "name": "vastflow",
            "softwareVersion": ran.version,
        },
        *described,
        *folders,
        *inputs,
    ]
    context = [_CONTEXT, {"sha256": "https://schema.org/sha256"}]
    return json.dumps({"@context": context, "@graph": graph}, indent=1, ensure_ascii=False).encode() + b"\n"


def _references(entities: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    return [{"@id": each["@id"]} for each in entities]


def _file(place: str, entry: FileEntry) -> dict[str, Any]:
    media = _MEDIA.get(PurePosixPath(place).suffix)
    return {
        "@id": quote(place),
        "@type": "File",
        "name": PurePosixPath(place).name,
        "contentSize": str(entry.size),
        "sha256": entry.sha256,
        **({"encodingFormat": media} if media else {}),
    }


def _folder(campaign: str, name: str, files: Mapping[str, FileEntry]) -> dict[str, Any]:
    own = [entry for place, entry in files.items() if place.startswith(f"{campaign}{name}/")]
    words = f"{PARTS[name]}. {len(own):,} files, {sum(each.size for each in own):,} bytes."
    return {"@id": f"{campaign}{name}/", "@type": "Dataset", "name": name, "description": words}


def _author(author: Author) -> dict[str, Any]:
    affiliation = {"@id": f"#{quote(author.affiliation)}", "@type": "Organization", "name": author.affiliation}
    about = {"@id": author.iri, "@type": "Person" if author.is_person else "Organization", "name": author.name}
    if not author.affiliation:
        return {**about, "_affiliation": None}
    return {**about, "affiliation": {"@id": affiliation["@id"]}, "_affiliation": affiliation}


def _license(about: About) -> dict[str, str]:
    place = f"https://spdx.org/licenses/{about.license}" if about.is_one_license else "#license"
    words = f"The results are licensed under {about.license} (SPDX)."
    return {"@id": place, "@type": "CreativeWork", "name": about.license, "description": words}
