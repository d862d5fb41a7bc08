"""Publication of a campaign directory: one archive that is a bag, a research object, and its own provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from vastflow.flows.publication.about import About
from vastflow.flows.publication.bag import measured, write_bag
from vastflow.flows.publication.card import card_of, words_of
from vastflow.flows.publication.contents import Contents
from vastflow.flows.publication.crate import CRATE, PublishedRun, crate_of
from vastflow.flows.publication.prov import provenance_of
from vastflow.flows.results.directory import directory_name
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.files import read_json
from vastflow.tasks.store.artifact import FileEntry

CAMPAIGN: Final = "campaign/"
"""Place of the campaign directory in the payload."""
PROVENANCE: Final = "prov.json"
CARD: Final = "README.md"


@dataclass(frozen=True)
class Publication:
    """An archive that was written.

    Attributes:
        words: One sentence on what was run and found.
        files: Number of files in its payload.
    """

    archive: Path
    about: About = field(repr=False)
    words: str
    files: int


def write_publication(contents: Contents, about: About, archive: Path) -> Publication:
    """Write the archive of a publication; equal contents and descriptions give equal bytes.

    Raises:
        UnusableDirectory: the campaign directory is damaged.
        UserError: a file changed meanwhile.
        OSError: the archive can't be written.
    """
    directory = contents.directory
    with reading(directory):
        metadata: Mapping[str, Any] = read_json(directory / "metadata.json")
        tables = read_tables(directory)
        name, created = str(metadata["name"]), str(metadata["created"])
        top = f"{directory_name(name)}-{datetime.fromisoformat(created):%Y-%m-%d-%H%M%S}"
        published = frozenset(contents.places)
        known = {place: measured(directory / place) for place in sorted({*published, *contents.withheld})}
        words = words_of(tables)
        card = card_of(about, contents, tables, CAMPAIGN, f"{top}.zip")
        provenance = provenance_of(directory, known, published, about.authors)
        ran = PublishedRun(name, str(metadata["vastflow"]), created, float(metadata["counts"]["wall_s"]), words)
    payload: dict[str, bytes | Path] = {f"{CAMPAIGN}{place}": directory / place for place in contents.places}
    payload |= {PROVENANCE: provenance, CARD: card}
    entries: dict[str, FileEntry] = {f"{CAMPAIGN}{place}": known[place] for place in contents.places}
    entries |= {PROVENANCE: measured(provenance), CARD: measured(card)}
    payload[CRATE] = crate_of(about, ran, entries, CAMPAIGN)
    info = {
        "Bag-Software-Agent": f"vastflow {ran.version}",
        "Bagging-Date": about.published,
        "External-Description": about.title,
    }
    write_bag(archive, top, payload, info)
    return Publication(archive, about, words, len(payload))
