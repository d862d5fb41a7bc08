"""Publication of a campaign directory: one archive that is a bag, a research object, and its own provenance."""

from datetime import datetime
from pathlib import Path
from typing import Final

from vastflow.flows.publication.about import About
from vastflow.flows.publication.bag import measured, write_bag
from vastflow.flows.publication.card import card_of, words_of
from vastflow.flows.publication.contents import CAMPAIGN, Contents
from vastflow.flows.publication.crate import CRATE, crate_of
from vastflow.flows.publication.prov import provenance_of
from vastflow.flows.results.directory import directory_name
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.results.unusable import reading

PROVENANCE: Final = "prov.json"
CARD: Final = "README.md"


def write_publication(contents: Contents, about: About, archive: Path) -> str:
    """Write the archive of a publication, and return in one sentence what was run and found.

    Equal contents and descriptions give equal bytes.

    Raises:
        UnusableDirectory: the campaign directory is damaged.
        UserError: a file changed meanwhile, or the archive exists with other bytes.
        OSError: the archive can't be written.
    """
    directory = contents.directory
    with reading(directory):
        tables = read_tables(directory)
        metadata, words = tables.metadata, words_of(tables)
        top = f"{directory_name(metadata['name'])}-{datetime.fromisoformat(metadata['created']):%Y-%m-%d-%H%M%S}"
        known = {place: measured(directory / place) for place in sorted({*contents.places, *contents.withheld})}
        payload: dict[str, bytes | Path] = {
            PROVENANCE: provenance_of(directory, known, frozenset(contents.places), about.authors),
            CARD: card_of(about, contents, tables, f"{top}.zip"),
        }
        entries = {f"{CAMPAIGN}{place}": known[place] for place in contents.places}
        entries |= {name: measured(content) for name, content in payload.items()}
        payload[CRATE] = crate_of(about, metadata, words, entries)
        entries[CRATE] = measured(payload[CRATE])
    payload |= {f"{CAMPAIGN}{place}": directory / place for place in contents.places}
    info = {"Bag-Software-Agent": f"vastflow {metadata['vastflow']}", "Bagging-Date": about.published}
    write_bag(archive, top, payload, entries, {**info, "External-Description": about.title})
    return words
