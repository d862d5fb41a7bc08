"""The tables of a search in a campaign directory, and its record in `metadata.json`."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.run.search_progress import SearchProgress
from vastflow.oracles.results.schema import plain, write_table
from vastflow.producers.search.boundary import BAND, Boundary
from vastflow.producers.search.criteria import best_of, runs_until
from vastflow.producers.search.strategy import Evaluation

_TEXT, _NUMBER, _COUNT = pa.string(), pa.float64(), pa.int64()


def _schema(**columns: pa.DataType) -> pa.Schema:
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in columns.items()])


EVALUATIONS: Final = _schema(
    configuration=_TEXT,
    batch=_COUNT,
    point=_TEXT,
    standing=_TEXT,
    objective=_NUMBER,
    measures=_TEXT,
    runs=_COUNT,
    simulated_s=_NUMBER,
    reason=_TEXT,
).set(4, pa.field("objective", _NUMBER))
"""A row for each proposal in order; `point` and `measures` are JSON."""
ARCHIVE: Final = _schema(cell=_TEXT, configuration=_TEXT, objective=_NUMBER, measures=_TEXT)
"""A row for each filled cell in order of its index; `cell`, its index along each measure, and `measures` are JSON."""
BOUNDARY: Final = _schema(point=_TEXT, low=_NUMBER, expected=_NUMBER, high=_NUMBER)
"""A row for each point of a lattice over the space: the expected objective with its band of 95 %."""


def write_search(place: Path, search: SearchProgress) -> None:
    """Write the tables of a search into a campaign directory, the same bytes for the same verdicts."""
    write_table(place / "evaluations.parquet", EVALUATIONS, map(_evaluation_row, search.evaluations))
    if search.search.spec.baseline:
        write_table(place / "baseline.parquet", EVALUATIONS, map(_evaluation_row, search.baseline))
    strategy = search.strategy
    if search.search.measures:
        write_table(place / "archive.parquet", ARCHIVE, _cells(search))
    if isinstance(strategy, Boundary) and search.best is not None:
        write_table(place / "boundary.parquet", BOUNDARY, _surface(strategy))


def search_record(search: SearchProgress) -> dict[str, Any]:
    """Return the record of a search in `metadata.json`."""
    spec, told, best, confirmed = search.search.spec, search.evaluations, search.best, search.confirmation
    beside = {"baseline": _baseline(search)} if spec.baseline else {}
    return {
        "strategy": spec.strategy,
        "parameters": plain(dict(spec.strategy_parameters)),
        "seed": spec.seed or 0,
        "space": {name: each.model_dump(exclude_unset=True) for name, each in spec.search_space.items()},
        "objective": spec.objective.name,
        "direction": spec.direction,
        "is_rate": search.search.quantities[spec.objective.name].metric is None,
        "batches": len(search.batches),
        "proposals": len(told),
        "rejected": sum(each.standing == "rejected" for each in told),
        "runs": sum(each.runs for each in told),
        "ended_by": search.ended_by,
        "metrics": dict(search.strategy.metrics),
        "best": None if best is None else _best(best),
        "confirmation": None
        if confirmed is None
        else {"runs": confirmed.runs, "samples": list(confirmed.samples), "found": confirmed.found},
        **beside,
    }


def _baseline(search: SearchProgress) -> dict[str, Any]:
    spec, told, best = search.search.spec, search.baseline, search.best
    own, beside = (
        None if best is None or best.objective is None else runs_until(each, best.objective, spec.direction)
        for each in (search.evaluations, told)
    )
    found = best_of(told, spec.direction)
    return {
        "strategy": spec.baseline,
        "runs": sum(each.runs for each in told),
        "best": None if found is None else _best(found),
        "runs_until_best": own,
        "runs_until_as_good": beside,
    }


def _best(best: Evaluation) -> dict[str, Any]:
    return {
        "configuration": best.proposal.name,
        "point": plain(dict(best.proposal.point)),
        "objective": best.objective,
        "runs": best.runs,
    }


def _evaluation_row(each: Evaluation) -> dict[str, Any]:
    return {
        "configuration": each.proposal.name,
        "batch": each.proposal.batch,
        "point": json.dumps(plain(dict(each.proposal.point))),
        "standing": each.standing,
        "objective": each.objective,
        "measures": json.dumps(dict(each.measures)),
        "runs": each.runs,
        "simulated_s": each.simulated_s,
        "reason": each.reason,
    }


def _cells(search: SearchProgress) -> Iterator[dict[str, Any]]:
    for cell in search.strategy.archive:
        row = _evaluation_row(cell.evaluation)
        yield {"cell": json.dumps(cell.index), **{key: row[key] for key in ("configuration", "objective", "measures")}}


def _surface(strategy: Boundary) -> Iterator[dict[str, Any]]:
    lattice, level = strategy.lattice(), strategy.parameters.level
    for unit, mean, deviation in zip(lattice, *strategy.surface(lattice), strict=True):
        expected, half = level + float(mean), BAND * float(deviation)
        point = json.dumps(plain(dict(strategy.problem.space.decoded(unit))))
        yield {"point": point, "low": expected - half, "expected": expected, "high": expected + half}
