"""The data card of a publication: what was asked and found, what is where, and how to check it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment

from vastflow.flows.publication.about import About
from vastflow.flows.publication.contents import CAMPAIGN, PARTS, TOP_FILES, Contents
from vastflow.flows.results.provenance import few, short_text
from vastflow.flows.terminal.progress import bytes_text, count_text
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.results.tables import Tables

_TEMPLATE: Final = Path(__file__).with_name("card.md.j2")


def card_of(about: About, contents: Contents, tables: Tables, archive: str) -> bytes:
    """Return the data card as Markdown; `archive` is the usual name of the archive's file."""
    places = {f"{CAMPAIGN}{name}": TOP_FILES.get(name, "Another table") for name in contents.places if "/" not in name}
    places |= {
        f"{CAMPAIGN}{name}/": words for name, words in PARTS.items() if name != "tables" and contents.parts[name]
    }
    places |= {name: TOP_FILES[name] for name in ("prov.json", "ro-crate-metadata.json")}
    producers = tables.metadata.get("producers", {})
    template = Environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    template.filters |= {"inline": _inline, "cell": _cell, "count": count_text}
    text: str = template.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        about=about,
        contents=contents,
        tables=tables,
        metadata=tables.metadata,
        varied={name: [_producer(each) for each in producers.get(name, ())] for name in tables.families},
        robot=robot_text(tables.metadata),
        words=words_of(tables),
        places=places,
        archive=archive,
    )
    return text.encode()


def words_of(tables: Tables) -> str:
    """Return in one sentence how many configurations and runs there are, and the headline."""
    group = evidence_of(tables)[None].campaign
    counts = group.counts
    runs = count_text(counts.judged + counts.not_judged, "run")
    unjudged = f", {counts.not_judged:,} of them not judged" if counts.not_judged else ""
    return f"{count_text(group.configurations, 'configuration')}, {runs}{unjudged}: {group.headline.text} (95 % intervals)."


def _producer(row: Mapping[str, Any]) -> str:
    said = [f"{key}: {short_text(value)}" for key, value in row["parameters"].items() if value not in (None, [], {})]
    return f"{row['name']} ({_cell(few(said, 6))})"


def _inline(text: str) -> str:
    return " ".join(text.split()).replace("<", "&lt;")


def _cell(text: str) -> str:
    return _inline(text).replace("|", "\\|").replace("`", "'")


def sizes_of(contents: Contents) -> Sequence[tuple[str, str, str]]:
    """Return name, number of files, and size of each part, also of those that are left out."""
    rows = [
        (part, f"{len(files):,}", bytes_text(sum(files.values())) if files else contents.left_out.get(part, "none"))
        for part, files in contents.parts.items()
    ]
    everything = [size for files in contents.parts.values() for size in files.values()]
    return [*rows, ("all", f"{len(everything):,}", bytes_text(sum(everything)))]
