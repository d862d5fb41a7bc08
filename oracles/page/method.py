"""Section on the method: how all of the report is computed, and with which versions."""

import inspect
from collections.abc import Iterator

from markupsafe import Markup

from vastflow.oracles.judgement.cause import CAUSES
from vastflow.oracles.judgement.oracle import known_oracles, oracle_class
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.section import Block, Details, Section, bullets, heading, paragraph
from vastflow.oracles.page.words import capital, percent, sentence


def method_section(facts: Facts) -> Section:
    """The section."""
    content = [*_verdicts(facts), *_rates(facts), *_robots(facts), *_statistics(facts), *_versions(facts)]
    return Section("method", "Method", "Method", content, "how all of this is computed, and with which versions")


def _verdicts(facts: Facts) -> Iterator[Block]:
    if facts.causes:
        yield heading("Causes")
        yield paragraph(
            "Of a run that any oracle failed, the first of these that holds. "
            "The end is that of the run, or where the first goal was given up."
        )
        rows = (Markup("<li><b>{}</b>: {}</li>").format(*each) for each in CAUSES.items())
        yield Markup("<ol>{}</ol>\n").format(Markup("").join(rows))
    for oracle in facts.tables.oracles:
        yield heading(oracle)
        yield _oracle(oracle)


def _oracle(name: str) -> Markup:
    """What an installed oracle says of itself; an oracle of a file beside the campaign can't be asked here."""
    if name not in known_oracles():  # a file's name would be looked for in whatever folder this process works in
        return paragraph("An oracle of the campaign's own, see its file.")
    found = oracle_class(name)
    said = (part for part in (inspect.getdoc(found) or "").split("\n\n") if not part.startswith("Metrics:"))
    fields = found.Parameters.model_fields.items()
    defaults = ", ".join(f"{key} = {field.default}" for key, field in fields if not field.is_required())
    beside = Markup('\n<br><span class="soft">Where the campaign file says nothing else: {}.</span>').format(defaults)
    return paragraph("{}{}", " ".join(" ".join(said).replace("`", "").split()), beside if defaults else "")


def _rates(facts: Facts) -> Iterator[Block]:
    yield heading("Rates")
    yield paragraph(
        "A run passes when every oracle passes it, fails when any fails it, and is not judged otherwise. Intervals are Wilson's score "
        "intervals\nat 95 %. For other configurations of the kind, the interval averages over how alike runs on one path may be "
        "(beta-binomial); it is\nnever wider than that of whole paths, needs two configurations, and supposes that those tested are a fair "
        "sample of their kind. Rare paths\nthat always fail may be among the others though none is here.{}",
        " All runs are simulated: the rates hold for the simulator's robot, world and noise." if facts.maps else "",
    )


def _robots(facts: Facts) -> Iterator[Block]:
    if robots := facts.metadata.get("robots"):
        yield heading("Robots")
        line = Markup('<br><span class="soft">{}.</span>')
        yield bullets(
            Markup(", ").join(each["families"]) + Markup("").join(line.format(capital(said)) for said in each["robot"])
            for each in robots
        )


def _statistics(facts: Facts) -> Iterator[Block]:
    designs = facts.findings.designs
    yield heading("Classes and factors")
    tests = (
        f" Factors have two tests: on these {facts.noun}s, over runs that are equal in all else; and for others, with each {facts.noun} as\n"
        "a unit. P-values are Holm's over the factors of each test, and over pairs, at an error rate of "
        f"{percent(designs[0].analysis.error)}."
        if designs
        else ""
    )
    yield paragraph("{}{}", sentence(facts.findings.classes.controls), tests)
    if facts.scenes:
        yield heading("Maps")
        yield paragraph(
            "A run that enters a cell of 0.25 m visits it once, however often it comes back; a failed run fails in each cell of the last "
            "0.5 m of its path. Cells with a\nfailure rate above the map's are marked at a false discovery rate of 5 %, configurations as "
            "clusters. At most 1,000 trajectories of each kind are drawn on a map,\nevenly chosen."
        )


def _versions(facts: Facts) -> Iterator[Block]:
    metadata = facts.metadata
    lines = {"vastflow": metadata["vastflow"], **metadata["versions"]}
    if "numeric_class" in metadata:
        lines["numeric class"] = metadata["numeric_class"]
    yield heading("Versions")
    rows = (Markup("<dt>{}</dt><dd>{}</dd>\n").format(*line) for line in lines.items())
    yield Markup("<dl>\n{}</dl>\n").format(Markup("").join(rows))
    yield Details("The campaign file", [Markup("<pre>{}</pre>").format(facts.tables.campaign)])
