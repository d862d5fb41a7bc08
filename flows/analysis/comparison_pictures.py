"""Pictures of a comparison: a configuration's runs in baseline and candidate on the map."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vastflow.flows.analysis.comparison import Compared
from vastflow.oracles.figures.case_figure import Case, case_of, pair_figure
from vastflow.oracles.figures.style import png
from vastflow.oracles.query.scene import read_walks
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.tables import JUDGMENTS, Tables

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vastflow.oracles.judgment.verdict import Judgment


def draw(found: Compared, most: int, folder: Path) -> tuple[dict[str, Path], dict[str, list[str]]]:
    """Draw the most changed configurations, the first changed run of each highlighted.

    Returns:
        Pictures by configuration of the candidate, and the names of others by the reason why they can't be drawn.
    """
    drawn: dict[str, Path] = {}
    undrawn: dict[str, list[str]] = {}
    pairing = found.pairing
    for change in found.changes[:most]:
        match = pairing.matches[change.configuration]
        mine = np.flatnonzero(pairing.configuration == change.configuration)
        said = [side[mine] for side in pairing.judged(found.oracle)]
        differs = np.flatnonzero(said[0] != said[1])
        runs = [side[mine] for side in (pairing.run_before, pairing.run_after)]
        campaigns = ((found.before, match.before, change.before, "A"), (found.after, match.after, change.after, "B"))
        sides = []
        try:
            for k, (tables, name, passes, letter) in enumerate(campaigns):
                judged = dict(zip(runs[k].tolist(), said[k].tolist(), strict=True))
                strong = int(runs[k][differs[0]]) if len(differs) else None
                created = str(tables.metadata.get("created", "")).replace("T", " ")
                run = "" if strong is None else f"; strong: run {strong}"
                title = f"{letter}: {passes} of {change.pairs} passed ({created}{run})"
                sides.append(driven_case(tables, name, title, judged, strong))
        except (OSError, ValueError, KeyError) as error:
            undrawn.setdefault(" ".join(str(error).split()), []).append(match.after)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        drawn[match.after] = folder / f"{match.after}.png"
        drawn[match.after].write_bytes(png(pair_figure(match.after, (sides[0], sides[1]))))
    return drawn, undrawn


def driven_case(tables: Tables, name: str, title: str, judged: Mapping[int, int], strong: int | None = None) -> Case:
    """Return a configuration with the true paths of its runs by their judgments, one of them strong.

    Raises:
        ValueError: it has no map, or no recording of a robot.
    """
    case = case_of(tables, tables.configurations.names.index(name), KeptFiles(tables.directory))
    if (walks := read_walks(tables.directory, name)) is None:
        raise ValueError(f"{tables.directory.name} has no recording of it")
    shown = [run for run in range(len(walks.run_index)) if int(walks.run_index[run]) in judged]
    paths: Sequence[tuple[Judgment, NDArray[Any]]] = [
        (JUDGMENTS.get(judged[int(walks.run_index[run])], "not judged"), walks.line(run)) for run in shown
    ]
    indices = [int(walks.run_index[run]) for run in shown]
    chosen = indices.index(strong) if strong in indices else None
    return replace(case, title=title, obstacles=[*case.obstacles, *walks.spawned], paths=paths, chosen=chosen)
