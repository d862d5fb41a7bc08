"""The page of a configuration: its runs over each other, their signals and events, and the nearest one that passes."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.opened import Campaign, OpenedCampaigns
from vastflow.deployments.explorer.pages import Pages, arrays_reply, name_of
from vastflow.deployments.explorer.trajectories import floor_of, layer, read_paths, stored_file
from vastflow.oracles.observation.obstacle_tracks import spawned_by
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import signal_name, signals_of
from vastflow.oracles.query.facets import Chosen, rate_json
from vastflow.oracles.query.scene import distinct_obstacles
from vastflow.oracles.query.selection import RunTable
from vastflow.oracles.results.executed import KeptFiles, configuration_row, scenario_of_row
from vastflow.oracles.results.tables import FAIL, JUDGMENTS, PASS
from vastflow.oracles.results.unusable import DAMAGE, reading
from vastflow.oracles.statistics.intervals import Counts
from vastflow.sim.model.blocks import read_block, read_rows
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.parquet import open_table
from vastflow.sim.model.recording import Event, run_of

TIME: Final = "t_s"
DISTANCE: Final = "distance_m"
MOST_SAMPLES: Final = 600
"""Maximum number of samples of a run in a signal's plot; more are thinned evenly."""
_NO_SIGNALS: Final = (TIME, "x_m", "y_m", "estimated_x_m", "estimated_y_m", "localized", "stopped")
_FIRST: Final = ("static_clearance_m", "wall_clearance_m", "localization_error_m", "speed_mps", "deviation_m")
"""Signals in the order in which one is shown at first."""
_GIVEN: Final = ("factor", "path")


def routes(opened: OpenedCampaigns, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page and its views."""

    def page(request: Request, campaign: Campaign, k: int) -> Response:
        name, found = campaign.table.configurations[k], values_of(campaign, k)
        return pages.page(request, "configuration.html.j2", campaign=campaign.directory, name=name, found=found)

    def view(made: Callable[[Request, Campaign, int], Response]) -> Callable[[Request], Response]:
        def answer(request: Request) -> Response:
            campaign = opened.of(name_of(request, "c"))
            k = index_of(campaign.table, name_of(request, "name"))
            with reading(f"{campaign.directory.path}: {campaign.table.configurations[k]}"):
                return made(request, campaign, k)

        return answer

    return [
        Route("/configuration", view(page)),
        Route("/api/configuration", view(lambda request, campaign, k: JSONResponse(values_of(campaign, k)))),
        Route("/api/configuration/paths", view(paths)),
        Route("/api/configuration/signals", view(signals)),
    ]


def index_of(table: RunTable, name: str) -> int:
    """Return a configuration's index; raises `UserError` for one that there is not."""
    if name not in table.configurations:
        raise UserError(f"name: expected a configuration with runs in this campaign, got {name!r}")
    return table.configurations.index(name)


def values_of(campaign: Campaign, k: int) -> Mapping[str, Any]:
    """Return the runs with their events, the values of the configuration, and its nearest neighbor of the other verdict."""
    from vastflow.oracles.query.frames import event_rows  # a third of a second of imports

    table = campaign.table
    own = table.rows_of(k)
    rows = {int(row["run_index"]): row for row in _recorded_rows(campaign, k)}
    names = [n for n in ("outcome", "reason", "cause", "simulated_s", "distance_m") if n in table.columns]
    runs, events = [], []
    for at in own:
        run = int(table.run_index[at])
        values = {name: table.value(name, at) for name in names}
        runs.append({"run": run, "verdict": JUDGMENTS[int(table.verdict[at])], "recorded": run in rows, **values})
        found = rows.get(run, {}).get("events", [])
        events += [{"run": run, **each} for each in event_rows(Event(**each) for each in found)]
    counts = Chosen(table, np.ones(len(table), dtype=np.bool_)).counts
    passed, failed, not_judged = counts[k].tolist()
    return {
        "passed": passed,
        "failed": failed,
        "not_judged": not_judged,
        **rate_json(Counts(passed, failed, not_judged), table.runs),
        "class": campaign.evidence[1].get(table.configurations[k]),
        "family": table.value("family", own.start),
        "values": [
            {"name": n, "value": table.value(n, own.start)} for n, c in table.columns.items() if c.group in _GIVEN
        ],
        "runs": runs,
        "events": events,
        "neighbor": neighbor(table, counts, k),
        "signals": _signal_names(campaign, k) if rows else [],
        "environment": str(campaign.environments[k]) or None,
        "around": surroundings(campaign.directory.path, table.configurations[k], list(rows.values())),
    }


def surroundings(directory: Path, name: str, rows: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return start, goals, and outlines of obstacles, those that runs spawned too; empty where the scenario can't be rebuilt."""
    try:
        situation = situation_of(scenario_of_row(configuration_row(directory, name), KeptFiles(directory)))
    except DAMAGE:
        return {"start": None, "goals": [], "obstacles": []}
    spawned = [obstacle for row in rows if row.get("entities") for obstacle in spawned_by(run_of(row))]
    obstacles = distinct_obstacles([*situation.obstacles, *spawned])
    return {
        "start": situation.start and [situation.start.x_m, situation.start.y_m],
        "goals": [[goal.x_m, goal.y_m] for goal in situation.goals],
        "obstacles": [np.asarray(each.footprint().exterior.coords).tolist() for each in obstacles],
    }


def neighbor(table: RunTable, counts: NDArray[np.int64], k: int) -> Mapping[str, Any] | None:
    """Return the nearest configuration that passes where this one fails, or fails where it passes, and the differences.

    Of those that always pass the nearest is taken; where none does, of those that pass most often. The distance is the sum over factors
    of differences relative to the factor's range; texts, and values that one of both lacks, count 1.

    Returns:
        None where no other configuration has the other verdict.
    """
    judged = counts[:, PASS] + counts[:, FAIL]
    rates = np.where(judged > 0, counts[:, PASS] / np.maximum(judged, 1), np.nan)
    wants_pass = bool(rates[k] < 1.0)
    others = rates if wants_pass else -rates
    if np.isnan(others[k]) or np.nanmax(others) == others[k]:
        return None
    candidates = np.flatnonzero(others == np.nanmax(others))
    first = np.searchsorted(table.configuration, np.arange(len(rates)))
    given = [column for column in table.columns.values() if column.group in _GIVEN or column.name == "family"]
    distance = np.zeros(len(candidates))
    for column in given:
        values = column.values[first]
        if column.levels is not None:
            distance += values[candidates] != values[k]
        elif column.group != "path":
            known = values[np.isfinite(values)]
            gaps = np.abs(values[candidates] - values[k]) / ((np.ptp(known) if len(known) else 0.0) or 1.0)
            lacks = np.isnan(values[candidates]) != np.isnan(values[k])
            distance += np.where(lacks, 1.0, np.nan_to_num(gaps))
    nearest = int(candidates[distance.argmin()])
    pairs = [(c.name, table.value(c.name, first[k]), table.value(c.name, first[nearest])) for c in given]
    passed, failed, _ = counts[nearest].tolist()
    return {
        "name": table.configurations[nearest],
        "passes": wants_pass,
        "passed": passed,
        "failed": failed,
        "differences": [{"name": name, "own": own, "other": other} for name, own, other in pairs if own != other],
        "equal": sum(own == other for _, own, other in pairs),
    }


def paths(request: Request, campaign: Campaign, k: int) -> Response:
    """Return the configuration's paths, as `vastflow.deployments.explorer.campaign_page.paths` does."""
    environment = str(campaign.environments[k])
    if not environment:
        return arrays_reply({"form": "nothing", "floor": None, "problem": "This scenario has no map."}, {})
    floor = floor_of(campaign.directory.path, environment)
    found = read_paths(campaign.directory.path, campaign.table, k, floor.grid)
    header = {"floor": floor.json, "problem": ""}
    if found is None:
        return arrays_reply({**header, "form": "nothing", "problem": "No run of it was recorded."}, {})
    told, arrays = layer(found, campaign.table, np.ones(len(campaign.table), dtype=np.bool_), floor.grid, "paths")
    return arrays_reply({**header, **told}, arrays)


def signals(request: Request, campaign: Campaign, k: int) -> Response:
    """Return a signal of each recorded run over time, or over the distance driven.

    The arrays are `x` and `y` (N,), NaN where the signal is missing, `starts` (K + 1,), and `run` and `verdict` (K,).
    """
    name, over = name_of(request, "signal"), request.query_params.get("over", TIME)
    if over not in (TIME, DISTANCE):
        raise HTTPException(400, f"over: expected {TIME} or {DISTANCE}, got {over!r}")
    table = campaign.table
    at = {int(table.run_index[row]): row for row in table.rows_of(k)}
    found = [(at[run], columns) for run, columns in _signals(campaign, k) if run in at and name in columns]
    x, y = [np.zeros(0)], [np.zeros(0)]
    for _, columns in found:
        along = columns[TIME] if over == TIME else _driven_m(columns)
        keep = np.unique(np.linspace(0, len(along) - 1, min(len(along), MOST_SAMPLES)).astype(np.int64))
        x.append(along[keep])
        y.append(np.where(np.isfinite(columns[name][keep]), columns[name][keep], np.nan))
    rows = np.array([row for row, _ in found], dtype=np.int64)
    arrays: dict[str, NDArray[Any]] = {
        "x": np.concatenate(x).astype(np.float32),
        "y": np.concatenate(y).astype(np.float32),
        "starts": np.cumsum([*map(len, x)]).astype(np.int32),
        "run": table.run_index[rows].astype(np.int32),
        "verdict": table.verdict[rows].astype(np.uint8),
    }
    return arrays_reply({"signal": name, "over": over}, arrays)


def _driven_m(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    steps = np.hypot(np.diff(columns["x_m"]), np.diff(columns["y_m"]))
    return np.asarray(np.r_[0.0, np.cumsum(steps)][: len(columns[TIME])])


def _recorded_rows(campaign: Campaign, k: int) -> list[dict[str, Any]]:
    file = stored_file(campaign.directory.path, "recordings", campaign.table.configurations[k])
    return read_rows(file) if file else []


def _stored(campaign: Campaign, k: int) -> list[Path]:
    name = campaign.table.configurations[k]
    files = [stored_file(campaign.directory.path, folder, name) for folder in ("recordings", "traces")]
    return [file for file in files if file]


def _signals(campaign: Campaign, k: int) -> list[tuple[int, Mapping[str, NDArray[np.float64]]]]:
    """Return the recorded and derived signals of each run; only the recorded ones where there are no traces."""
    found: dict[int, dict[str, NDArray[np.int32]]] = {}
    for file in _stored(campaign, k):
        for row, columns in read_block(file):
            found.setdefault(int(row["run_index"]), {}).update(columns)
    return [(run, signals_of(columns)) for run, columns in found.items() if "t_ms" in columns]


def _signal_names(campaign: Campaign, k: int) -> list[str]:
    """Return the signals of a configuration, those that tell most first, without reading them."""
    stored = [name for file in _stored(campaign, k) for name in open_table(file).schema_arrow.names[1:]]
    names = [signal_name(name[:-3] if name.endswith((":d0", ":d1", ":d2")) else name) for name in stored]
    found = [name for name in dict.fromkeys(names) if name not in _NO_SIGNALS]
    return sorted(found, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
