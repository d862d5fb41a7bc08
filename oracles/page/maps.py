"""Section on maps: where runs failed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from markupsafe import Markup

from vastflow.oracles.figures.scene import MAX_SCENES, environment_counts
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import all_maps_picture, map_pictures
from vastflow.oracles.page.section import Block, Details, Group, Section, soft
from vastflow.oracles.page.table import Column, Table, rate_cell
from vastflow.oracles.page.words import plural


def maps_section(facts: Facts) -> Section | None:
    """The section; None for a campaign without maps."""
    if not facts.maps:
        return None
    content = [*_environments(facts), *_scenes(facts)]
    if len(facts.scenes) > 1:
        overview = all_maps_picture(facts.scenes, [facts.names[scene.environment] for scene in facts.scenes])
        content = [overview, Details("Each map", content)]
    if facts.places:
        content.append(_hot(facts.places))
    return Section("maps", "Where", "Where it happened", content=content, folded=False)


def _environments(facts: Facts) -> Iterator[Block]:
    rows = [[facts.names[key], rate_cell(counts)] for key, counts in environment_counts(facts.tables).items()]
    if len(rows) > 1:
        yield Table([Column("Map"), Column("All oracles", "rate")], rows, "environments")
        if len(rows) > MAX_SCENES:
            yield soft("The {} maps with most failures are drawn.", MAX_SCENES)


def _scenes(facts: Facts) -> Iterator[Block]:
    for scene in facts.scenes:
        name, (height, width) = facts.names[scene.environment], scene.occupancy.shape
        resolution_m = scene.occupancy.resolution_m
        size = f"{width * resolution_m:.1f} m × {height * resolution_m:.1f} m"
        yield Markup('<h3>{} <span class="soft">{}</span></h3>\n').format(name, size)
        pictures = [replace(picture, detail=True) for picture in map_pictures(scene, name)]
        density = [picture for picture in pictures if picture.density]
        lines = Group("pair", [picture for picture in pictures if not picture.density])
        yield Group("pair", density)
        yield Details("Trajectories", [lines]) if density else lines


def _hot(rows: Sequence[list[Any]]) -> Block:
    table = Table(
        [Column("Map", "choice"), Column("Place"), Column("Failed of visits", "rate")], rows, "places", style="share"
    )
    explained = soft(
        "Of the runs that came through a cell of 0.25 m, the share that failed there, where it is shown to be above the map's mean; "
        "the worst of neighbors, at most three a map."
    )
    summary = f"{plural(len(rows), 'place')} that runs fail at more often than elsewhere"
    return Details(summary, [explained, table], open=len(rows) <= 3)
