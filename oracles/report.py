"""The report: one HTML file that stands alone, from nothing but a campaign directory."""

import base64
import inspect
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from vastflow.oracles import coverage
from vastflow.oracles.evidence import Evidence, Group, evidence_json, evidence_of
from vastflow.oracles.figures import failures_figure, png, rates_figure, trajectories_figure
from vastflow.oracles.oracle import OracleError, oracle_class
from vastflow.oracles.rates import Counts, Interval
from vastflow.oracles.scene import Scene, scenes_of
from vastflow.oracles.tables import Tables, read_tables
from vastflow.oracles.work_section import with_work

MAX_ROWS: Final = 500
"""Rows of a table; `evidence.json` and the parquet files have all."""
_TEMPLATE: Final = Path(__file__).with_name("report.html.j2")


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the report.

    Attributes:
        name: File name below `figures/`, without ending.
        alt: What it shows, for those who don't see it.
        caption: What to read in it.
    """

    name: str
    alt: str
    caption: str
    content: bytes

    @property
    def source(self) -> str:
        """The picture as a `data:` address."""
        return "data:image/png;base64," + base64.b64encode(self.content).decode()


def write_report(directory: Path) -> None:
    """Write `evidence.json`, `figures/*.png` and `report.html` into the campaign directory `directory`.

    Raises:
        OSError: a table that should be there is not.
    """
    tables = read_tables(directory)
    evidence = evidence_of(tables)
    (directory / "evidence.json").write_text(evidence_json(tables, evidence), encoding="utf-8")
    rates, maps = list(_rate_pictures(evidence)), list(_map_pictures(scenes_of(tables)))
    figures = directory / "figures"
    figures.mkdir(exist_ok=True)
    for picture in (*rates, *maps):
        (figures / f"{picture.name}.png").write_bytes(picture.content)
    (directory / "report.html").write_text(
        with_work(_html(tables, evidence, rates, maps), tables.metadata), encoding="utf-8"
    )


def _rate_pictures(evidence: Mapping[str | None, Evidence]) -> Iterator[Picture]:
    if evidence[None].configurations:
        yield Picture(
            "rates",
            "Success rates of the campaign, its families and configurations with their intervals",
            "Point: share of passed runs. Bar: 95 % Wilson interval of these configurations. "
            "Thin line: 95 % interval for other configurations of the kind.",
            png(rates_figure(evidence)),
        )


def _map_pictures(scenes: Sequence[Scene]) -> Iterator[Picture]:
    for scene in scenes:
        rows, columns = scene.occupancy.shape
        size = f"{columns * scene.occupancy.resolution_m:.1f} m × {rows * scene.occupancy.resolution_m:.1f} m"
        runs = scene.runs.judged + scene.runs.not_judged
        yield Picture(
            f"trajectories-{scene.environment[:8]}",
            f"Map with the trajectories of {runs} runs, {scene.runs.failed} of them failed",
            f"Map {scene.environment[:8]}, {size}: true trajectories, coloured by what all oracles together say. "
            "Obstacles of all configurations are drawn; each run met only its own.",
            png(trajectories_figure(scene)),
        )
        if scene.failed:
            yield Picture(
                f"failures-{scene.environment[:8]}",
                f"Map with the final positions of {len(scene.failed)} failed runs",
                f"Map {scene.environment[:8]}: where failed runs ended. A ring is a run whose mission succeeded "
                "while another oracle failed it.",
                png(failures_figure(scene)),
            )


def _html(
    tables: Tables, evidence: Mapping[str | None, Evidence], rates: Sequence[Picture], maps: Sequence[Picture]
) -> str:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(percent=percent, span=span, number=number, bar=_bar)
    configurations = _configurations(tables, evidence)
    failures = _failures(tables, evidence)
    return environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        name=tables.metadata["name"],
        metadata=tables.metadata,
        evidence=evidence,
        everything=evidence[None],
        families=tables.families,
        group_rows=_group_rows(evidence),
        shape=_shape(evidence[None].configurations.values()),
        totals=_totals(tables),
        rates=rates,
        maps=maps,
        configurations=configurations[:MAX_ROWS],
        configurations_left_out=max(len(configurations) - MAX_ROWS, 0),
        failures=failures[:MAX_ROWS],
        failures_left_out=max(len(failures) - MAX_ROWS, 0),
        rejections=_rejections(tables),
        coverage=_coverage(tables.directory),
        duplicates=[row for row in tables.configurations if row["duplicate_of"]],
        not_judged=_not_judged(tables),
        explanations={oracle: _explanation(oracle) for oracle in tables.oracles},
        campaign_text=tables.campaign,
        max_rows=MAX_ROWS,
    )


def _coverage(directory: Path) -> Mapping[str, Any] | None:
    """What the section on coverage shows; None for a campaign directory of before there was `coverage.json`."""
    if not (directory / coverage.FILE).is_file():
        return None
    found = coverage.read_coverage(directory)
    listed = list(coverage.pairs(found))
    return {
        "parts": [
            (name, part, coverage.design_text(part["design"]) if "design" in part else "")
            for name, part in coverage.parts(found)
        ],
        "excluded": list(coverage.excluded(found)),
        "unrealisable": [
            (family, producer, said["count"])
            for family, part in found["families"].items()
            for producer, said in part["unrealisable_by"].items()
        ],
        "dimensions": list(coverage.dimensions(found)),
        "t_way": found["t_way"],
        "pairs": listed[:MAX_ROWS],
        "pairs_left_out": len(listed[MAX_ROWS:]) + coverage.pairs_not_listed(found),
    }


def percent(rate: float | None) -> str:
    """A rate for people: whole percent, more digits where they would round away the last pass or failure."""
    if rate is None:
        return "–"
    for digits in (0, 1, 2, 3):
        text = f"{100 * rate:.{digits}f}"
        if rate in (0.0, 1.0) or float(text) not in (0.0, 100.0):
            break
    return f"{text}\N{NO-BREAK SPACE}%"


def span(interval: Interval) -> str:
    """An interval for people: `52–70 %`."""
    low, high = percent(interval.low), percent(interval.high)
    return f"{low[:-2]}\N{WORD JOINER}–\N{WORD JOINER}{high}"


def number(value: float | None) -> str:
    """A measured number with three significant digits, none beyond the third decimal."""
    if value is None:
        return "–"
    value = round(value, 3) + 0.0  # + 0.0 turns -0.0 into 0.0
    return f"{value:,.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"


def _bar(counts: Counts) -> Markup:
    """The rate and its interval as a small picture; says nothing that is not beside it in words."""
    if counts.rate is None:
        return Markup("")
    low, high = (100 * end for end in (counts.interval.low, counts.interval.high))
    style = f"--low:{low:.1f}%;--width:{high - low:.1f}%;--at:{100 * counts.rate:.1f}%"
    return Markup('<span class="bar" style="{}" aria-hidden="true"></span>').format(style)


def _group_rows(evidence: Mapping[str | None, Evidence]) -> list[tuple[str, Mapping[str | None, Group]]]:
    """The campaign and each family, with their group per oracle."""
    whole = ("Whole campaign", {oracle: found.campaign for oracle, found in evidence.items()})
    families = evidence[None].families
    return [whole, *((name, {oracle: e.families[name] for oracle, e in evidence.items()}) for name in families)]


def _shape(configurations: Any) -> Mapping[str, int]:
    """How many configurations passed in every judged run, failed in every one, or both ways."""
    judged = [counts for counts in configurations if counts.judged]
    always, never = (sum(not getattr(c, which) for c in judged) for which in ("failed", "passed"))
    return {"always": always, "never": never, "mixed": len(judged) - always - never}


def _totals(tables: Tables) -> Mapping[str, Any]:
    return {
        "environments": len({row["environment"] for row in tables.configurations} - {None}),
        "simulated_s": sum(row["simulated_s"] for row in tables.runs),
        "distance_m": sum(row["distance_m"] for row in tables.runs),
        "runs": len(tables.judgements),
    }


def _configurations(tables: Tables, evidence: Mapping[str | None, Evidence]) -> list[Mapping[str, Any]]:
    """A row per distinct configuration in their order; the worst first where not all can be shown."""
    varied = _varied_factors(tables)
    rows: list[Mapping[str, Any]] = [
        {
            "name": row["name"],
            "family": row["family"],
            "factors": [(key, _short(row["factors"][key])) for key in varied if key in row["factors"]],
            "counts": {oracle: found.configurations[row["name"]] for oracle, found in evidence.items()},
        }
        for row in tables.configurations
        if row["duplicate_of"] is None
    ]
    if len(rows) > MAX_ROWS:
        rows.sort(key=lambda row: -row["counts"][None].failed)
    return rows


def _varied_factors(tables: Tables) -> list[str]:
    """Keys whose value is not the same in every configuration."""
    values: dict[str, set[str]] = {}
    for row in tables.configurations:
        for key, value in row["factors"].items():
            values.setdefault(key, set()).add(repr(value))
    present = Counter(key for row in tables.configurations for key in row["factors"])
    return [key for key, seen in values.items() if len(seen) > 1 or present[key] < len(tables.configurations)]


def _short(value: Any) -> str:
    """A value in a table's cell: of a pose where it is, of a list how many there are."""
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list):
        return f"{len(value)} of them" if len(value) != 1 else "one"
    if isinstance(value, dict) and isinstance(position := value.get("position", value), dict) and "x" in position:
        return f"({position['x']:.2f}, {position['y']:.2f}) m"
    return str(value)


def _failures(tables: Tables, evidence: Mapping[str | None, Evidence]) -> list[Mapping[str, Any]]:
    """A row per configuration and oracle that failed runs of it, most failures first."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in tables.verdicts:
        if row["judgement"] == "fail":
            reasons.setdefault((row["configuration"], row["oracle"]), []).append(row["reason"])
    rows: list[Mapping[str, Any]] = [
        {
            "configuration": configuration,
            "oracle": oracle,
            "failed": len(said),
            "judged": evidence[oracle].configurations[configuration].judged,
            "reasons": list(dict.fromkeys(said)),
        }
        for (configuration, oracle), said in reasons.items()
    ]
    return sorted(rows, key=lambda row: -row["failed"])


def _rejections(tables: Tables) -> list[Mapping[str, Any]]:
    """A row per family, producer and reason."""
    grouped: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in tables.rejections:
        grouped.setdefault((row["family"], row["producer"], row["reason"]), []).append(row["requested"])
    return [
        {
            "family": family,
            "producer": producer,
            "reason": reason,
            "times": len(requested),
            "requested": [", ".join(f"{key} {_short(value)}" for key, value in one.items()) for one in requested[:3]],
        }
        for (family, producer, reason), requested in grouped.items()
    ]


def _not_judged(tables: Tables) -> list[Mapping[str, Any]]:
    """A row per oracle and reason."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for row in tables.verdicts:
        if row["judgement"] == "not judged":
            grouped.setdefault((row["oracle"], row["reason"]), []).append(row["configuration"])
    return [
        {"oracle": oracle, "reason": reason, "runs": len(where), "configurations": list(dict.fromkeys(where))}
        for (oracle, reason), where in grouped.items()
    ]


def _explanation(oracle: str) -> Mapping[str, Any]:
    """What an installed oracle says of itself; an oracle of a file beside the campaign can't be asked here."""
    try:
        found = oracle_class(oracle)
    except OracleError:
        return {"text": "An oracle of the campaign's own, see its file.", "defaults": {}}
    paragraphs = (inspect.getdoc(found) or "").split("\n\n")
    fields = found.Parameters.model_fields
    return {
        "text": " ".join(" ".join(p for p in paragraphs if not p.startswith("Metrics:")).replace("`", "").split()),
        "defaults": {name: field.default for name, field in fields.items() if not field.is_required()},
    }
