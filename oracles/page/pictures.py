"""Pictures of the report: figures as PNG and SVG, with their words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.evidence.causes import CauseCount, Criterion
from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.evidence.findings import Design
from vastflow.oracles.figures import maps
from vastflow.oracles.figures.case_figure import case_figure, case_of
from vastflow.oracles.figures.charts import (
    factor_figure,
    interaction_figure,
    rate_panels,
    rates_figure,
    threshold_figure,
)
from vastflow.oracles.figures.drawing import Drawing
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.page.section import Picture
from vastflow.oracles.query.scene import (
    Scene,
    Walks,
    distinct_obstacles,
    read_estimate,
    read_mover_paths,
    read_walks,
)
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.tables import CODES, JUDGMENTS, Tables
from vastflow.sim.model.obstacle import Obstacle

MAX_EMBEDDED: Final = 11_000_000
"""Bytes of pictures within the page, which stays below 20 MB; others are only in `figures/`."""

MOST_CONTRASTS: Final = 2


def rate_pictures(evidence: Mapping[str | None, Evidence]) -> Iterator[Picture]:
    """Rates of campaign, families and configurations."""
    if evidence[None].configurations:
        alt = "Rates of the campaign, its families and configurations with their intervals"
        caption = "Point: share of passed runs. Bar: 95 % interval for these configurations. "
        caption += "Thin line: 95 % interval for other configurations of the kind."
        yield picture("rates", "", alt, caption, Drawing(rates_figure, rate_panels(evidence)), drawn=True, wide=True)


def factor_pictures(designs: Sequence[Design]) -> list[list[Picture]]:
    """For each design the effects of its factors and of its pairs of factors."""
    return [
        list(_design_pictures(design, f"-{k}" if len(designs) > 1 else "")) for k, design in enumerate(designs, start=1)
    ]


def contrast_pictures(designs: Sequence[Design]) -> dict[tuple[int, str], Picture]:
    """By design and name, of the most certain factor of each design that has one; of `MOST_CONTRASTS` designs."""
    shown = [(k, [f for f in design.analysis.factors if f.matters][:1]) for k, design in enumerate(designs)]
    caption = "Thin line: one situation. Diamonds: their mean."
    found = {}
    for k, factor in [(k, factor) for k, factors in shown for factor in factors][:MOST_CONTRASTS]:
        alt = f"Failure rate at each level of {factor.name}"
        found[k, factor.name] = picture(
            f"contrast-{k + 1}", "", alt, caption, Drawing(factor_figure, [factor]), drawn=True
        )
    return found


def map_pictures(scene: Scene, name: str) -> Iterator[Picture]:
    """Final poses and failure rates, failed and passed paths on one map."""
    end, runs = scene.environment[:8], scene.runs
    if len(scene.failed_xy_m):
        yield picture(
            f"final-poses-{end}",
            "Where failed runs ended",
            f"{name}: density of the final poses of {len(scene.failed_xy_m):,} failed runs",
            "Final true poses of all failed runs, blurred with 0.2 m.",
            Drawing(maps.final_poses_figure, scene),
            density=True,
        )
        yield picture(
            f"failure-rate-{end}",
            "How often a place is failed at",
            f"{name}: failed runs over visits in cells of 0.25 m",
            "Of the runs that came through a cell, the share that failed within the last 0.5 m of their path there. "
            "Faint cells are uncertain. A dense spot on the left can be a busy one. A dark cell here is a dangerous one.",
            Drawing(maps.failure_rate_figure, scene),
            density=True,
        )
    hidden = len(scene.obstacles) - maps.MAX_OBSTACLES
    which = (
        f"{maps.MAX_OBSTACLES} of {len(scene.obstacles):,} obstacles"
        if hidden > 0
        else "Obstacles of all configurations"
    )
    obstacles = f" {which} are drawn. Each run met only its own." if scene.obstacles else ""
    words: dict[Judgment, str] = {"fail": "failed", "pass": "passed"}
    for judgment, word in words.items():
        if scene.lines[CODES[judgment]] or (judgment == "pass" and not runs.failed):
            alt = f"{name}: true trajectories of {word} runs"
            caption = f"True trajectories of {word} runs, from circle to cross.{obstacles}"
            yield picture(
                f"{word}-{end}",
                f"{word.capitalize()} runs",
                alt,
                caption,
                Drawing(maps.paths_figure, scene, judgment),
            )


def all_maps_picture(scenes: Sequence[Scene], names: Sequence[str]) -> Picture:
    """All maps side by side."""
    return picture(
        "maps",
        "",
        "A column for each map: final poses of failed runs, failed trajectories, passed trajectories",
        "Above: final poses of failed runs in rings, blurred with 0.2 m, yellow few, purple many for the map. Middle: failed "
        "trajectories. Below: passed trajectories, from circle to cross. At most 1,000 of each are drawn.",
        Drawing(maps.all_maps_figure, scenes, names),
        wide=True,
    )


def case_picture(tables: Tables, configuration: int, files: KeptFiles) -> Picture | None:
    """The runs of the configuration at an index on its map; None where nothing was recorded."""
    name, verdicts = tables.configurations.names[configuration], tables.verdicts
    walks = _walks(tables, configuration)
    if walks is None:
        return None
    own = verdicts.rows_of(configuration)
    rows = own.start + np.searchsorted(verdicts.run_index[own], walks.run_index)
    paths = [(JUDGMENTS[int(verdicts.together[row])], walks.line(k)) for k, row in enumerate(rows)]
    figure = _on_map(tables, configuration, files, paths, walks.spawned, int(walks.run_index[0]))
    return picture(f"case-{name}", "", f"Trajectories of {name} on its map", "", figure)


def cause_picture(tables: Tables, count: CauseCount, files: KeptFiles) -> Picture | None:
    """The example run of a cause with its estimated path; None without map or recording."""
    configuration = tables.configurations.names.index(count.configuration)
    walks = _walks(tables, configuration)
    if walks is None or count.run_index not in walks.run_index:
        return None
    run = int(np.searchsorted(walks.run_index, count.run_index))
    estimate_xy_m = read_estimate(tables.directory, count.configuration, count.run_index)
    figure = _on_map(
        tables, configuration, files, [("fail", walks.line(run))], walks.spawned, count.run_index, estimate_xy_m
    )
    alt = f"{count.cause}: run {count.run_index} of {count.configuration} on its map, and where the robot took itself to be"
    return picture(f"cause-{count.cause.replace(' ', '-')}", "", alt, "", figure)


def _walks(tables: Tables, configuration: int) -> Walks | None:
    found = tables.configurations
    return read_walks(tables.directory, found.names[configuration]) if found.environments[configuration] else None


def threshold_pictures(criteria: Sequence[Criterion]) -> Iterator[Picture]:
    """Plot the pass rate over the threshold for each criterion with a score."""
    for criterion in criteria:
        if criterion.score is not None:
            name = "".join(letter if letter.isalnum() else "-" for letter in criterion.oracle)
            alt = f"Share of runs that would pass {criterion.oracle}, by its threshold"
            caption = f"Share of the {criterion.runs:,} judged runs that would pass, had {criterion.oracle} another threshold."
            figure = Drawing(threshold_figure, criterion, criterion.score)
            yield picture(f"threshold-{name}", "", alt, caption, figure, drawn=True)


def _on_map(
    tables: Tables,
    configuration: int,
    files: KeptFiles,
    paths: Sequence[tuple[Judgment, NDArray[np.float64]]],
    spawned: Sequence[Obstacle],
    run_index: int,
    estimate_xy_m: NDArray[np.float64] | None = None,
) -> Drawing:
    case = case_of(tables, configuration, files)
    obstacles = distinct_obstacles([*case.obstacles, *spawned])
    name = tables.configurations.names[configuration]
    movers = read_mover_paths(tables.directory, name, run_index, case.situation.movers)
    found = replace(case, obstacles=obstacles, paths=paths, estimate_xy_m=estimate_xy_m, mover_paths=movers)
    return Drawing(case_figure, found)


def _design_pictures(design: Design, ending: str) -> Iterator[Picture]:
    if factors := design.analysis.factors:
        alt = "Failure rate at each level of each factor"
        caption = "A thin line with rings is one path, or one situation without a path. Diamonds are the mean. "
        caption += "Orange: the factor is shown to matter, on these or on others. Black: it is not."
        yield picture(f"factors{ending}", "", alt, caption, Drawing(factor_figure, factors), drawn=True, wide=True)
    if pairs := [pair for pair in design.analysis.interactions if pair.claim.shown]:
        alt = "Failure rate for each combination of levels of two factors that act together"
        caption = "Failure rate of each combination. Framed: the effects of both factors alone don't add up to it."
        yield picture(
            f"interactions{ending}", "", alt, caption, Drawing(interaction_figure, pairs), drawn=True, wide=True
        )


def picture(name: str, title: str, alt: str, caption: str, drawing: Drawing, **marks: bool) -> Picture:
    """A drawing as a picture; `marks` are the flags of `Picture`."""
    return Picture(name, title, alt, caption, drawing, **marks)
