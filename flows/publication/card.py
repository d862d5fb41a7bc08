"""The data card of a publication: what was asked and found, what is where, and how to check it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from vastflow.flows.publication.about import About
from vastflow.flows.publication.contents import PARTS, Contents
from vastflow.flows.results.provenance import few, short_text
from vastflow.flows.terminal.progress import bytes_text, count_text
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.results.tables import Tables

_TOP_FILES = {
    "campaign.vast": "What was asked, as YAML",
    "metadata.json": "Versions, numeric class, host, parameters of oracles and producers, counts, faults",
    "configurations.parquet": "A row for each configuration: its scenario, factors, and digests",
    "runs.parquet": "A row for each run: seed, outcome, simulated time, distance, contacts",
    "verdicts.parquet": "A row for each run and oracle: judgment, reason, and metrics",
    "runs_wide.parquet": "Runs, factors, verdicts, and metrics in one table",
    "behaviors.parquet": "Status changes of the scenario's behaviors in each run",
    "rejections.parquet": "Instances that could not be built, with reasons",
    "exclusions.parquet": "Instances that constraints exclude",
    "coverage.json": "How much of the requested space was realized",
    "evidence.json": "Rates with intervals, by oracle, family, and configuration",
    "events.jsonl": "What happened while the campaign ran",
    "report.html": "The report",
}


def card_of(about: About, contents: Contents, tables: Tables, campaign: str, archive: str) -> bytes:
    """Return the data card as Markdown.

    Args:
        campaign: Place of the campaign directory in the crate, with a slash.
        archive: Usual name of the archive's file.
    """
    return "\n".join(_lines(about, contents, tables, campaign, archive)).encode() + b"\n"


def words_of(tables: Tables) -> str:
    """Return in one sentence how many configurations and runs there are, and the headline."""
    group = evidence_of(tables)[None].campaign
    counts = group.counts
    runs = count_text(counts.judged + counts.not_judged, "run")
    unjudged = f", {counts.not_judged:,} of them not judged" if counts.not_judged else ""
    return f"{count_text(group.configurations, 'configuration')}, {runs}{unjudged}: {group.headline.text} (95 % intervals)."


def _lines(about: About, contents: Contents, tables: Tables, campaign: str, archive: str) -> Iterator[str]:
    metadata = tables.metadata
    yield from (f"# {_inline(about.title)}", "", _inline(about.description), "")
    for author in about.authors:
        more = ", ".join(
            filter(None, (f"https://orcid.org/{author.orcid}" if author.orcid else "", author.affiliation))
        )
        yield f"- {_inline(author.name)}{f' ({_inline(more)})' if more else ''}"
    yield from (f"- License: {about.license} (SPDX)", f"- Published: {about.published}")
    yield from ("", "## What was asked", "")
    for name, names in tables.families.items():
        producers = metadata.get("producers", {}).get(name, ())
        varied = "; ".join(_producer(each) for each in producers)
        yield f"- `{name}`: {count_text(len(names), 'configuration')}{f'. Varied by {varied}' if varied else ''}"
    oracles = ", ".join(f"`{name}`" for name in tables.oracles)
    yield from ("", f"Each run is judged by {oracles}. It passes if every oracle passes it.")
    if robot := robot_text(metadata):
        yield f"Robot: {_inline(robot)}."
    yield from ("", "## What was found", "", words_of(tables))
    host = metadata["host"]
    made = f"It was computed by vastflow {metadata['vastflow']} on {host['system']}, {metadata['created']}."
    yield from ("", f"{made} Numeric class: `{metadata['numeric_class']}`.")
    yield from ("", "## What is where", "", "| place | content |", "|---|---|")
    places = contents.places
    yield from (f"| `{campaign}{name}` | {words} |" for name, words in _TOP_FILES.items() if name in places)
    others = (name for name in places if "/" not in name and name not in _TOP_FILES)
    yield from (f"| `{campaign}{name}` | Another table |" for name in others)
    for name, words in PARTS.items():
        if any(place.startswith(f"{name}/") for place in places):
            yield f"| `{campaign}{name}/` | {words} |"
    yield "| `prov.json` | PROV of every artifact: what follows from what, with digests and keys |"
    yield "| `ro-crate-metadata.json` | This description for programs (RO-Crate 1.2, Process Run Crate) |"
    yield from ("", "## Inputs", "", "| input | is |", "|---|---|")
    yield from (
        f"| `{_cell(each.name)}` | {each.kind}{f': {each.reason}' if each.reason else ''} |" for each in contents.inputs
    )
    if contents.left_out:
        yield from ("", "## What is left out", "")
        yield from (f"- `{_cell(name)}`: {reason}" for name, reason in contents.left_out.items())
        if any(each.kind == "private" for each in contents.inputs):
            yield from ("", "Runs that need what is private can't be executed again from this archive.")
    yield from ("", "## How to verify", "", "```sh", f"pip install vastflow=={metadata['vastflow']}")
    yield from (f"vastflow verify {archive}", "```", "")
    yield "This compares the digest of every file, and executes a random sample of runs again, bit for bit."
    yield "The digests alone are a bag of BagIt, which other programs validate too."


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
