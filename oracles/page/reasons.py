"""Reasons: why runs failed, why they were not judged, why requests could not be built."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.page.table import Column, DataTable
from vastflow.oracles.page.words import short
from vastflow.oracles.results.tables import Tables

_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


def kind_of(reason: str) -> str:
    """What reasons have in common that differ in their numbers alone."""
    return _NUMBER.sub("#", reason)


def failure_kinds(tables: Tables) -> list[Mapping[str, Any]]:
    """A row for each oracle and kind of reason, what failed most runs first; a run that two oracles failed is in two."""
    said = tables.verdicts.reasons("fail")
    kinds: dict[str, int] = {}
    kind = np.array([kinds.setdefault(kind_of(reason), len(kinds)) for reason in said.known], dtype=np.int64)
    keys = said.oracle * max(len(kinds), 1) + (kind[said.reason] if len(kind) else said.reason)
    distinct, first, places, counts = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    reasons, configurations = (_different(places, of, len(distinct)) for of in (said.reason, said.configuration))
    rows = [
        {
            "oracle": tables.oracles[said.oracle[at]],
            "reason": said.known[said.reason[at]],
            "alike": reasons[k] == 1,
            "runs": runs,
            "configurations": configurations[k],
        }
        for k, (at, runs) in enumerate(zip(first.tolist(), counts.tolist(), strict=True))
    ]
    return sorted(rows, key=lambda row: -row["runs"])


def _different(places: NDArray[np.int64], values: NDArray[np.int64], length: int) -> list[int]:
    """How many different `values` (n,) are at each of the places 0 to `length` - 1, given the place (n,) of each."""
    pairs = np.unique(np.stack((places, values)), axis=1)
    return [int(count) for count in np.bincount(pairs[0], minlength=length)]


def failure_table(tables: Tables, evidence: Mapping[str | None, Evidence]) -> DataTable:
    """A row for each configuration and oracle that failed runs of it, most failures first."""
    said = tables.verdicts.reasons("fail")
    keys = said.configuration * len(tables.oracles) + said.oracle
    order = np.argsort(keys, kind="stable")
    distinct, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    rows = []
    for key, at, n in zip(distinct.tolist(), first.tolist(), counts.tolist(), strict=True):
        name, oracle = (
            tables.configurations.names[key // len(tables.oracles)],
            tables.oracles[key % len(tables.oracles)],
        )
        reasons = dict.fromkeys(said.known[k] for k in said.reason[order[at : at + n]])
        others = f" (and {len(reasons) - 1} other reason{'s' if len(reasons) > 2 else ''})" if len(reasons) > 1 else ""
        judged = evidence[oracle].configurations[name].judged
        rows.append([name, oracle, n, judged, next(iter(reasons)) + others])
    rows.sort(key=lambda row: -row[2])
    columns = [Column("Configuration"), Column("Oracle", "choice"), Column("Failed", "number")]
    return DataTable("failed", [*columns, Column("Of judged", "number"), Column("Why")], rows)


def not_judged_rows(tables: Tables) -> list[Mapping[str, Any]]:
    """A row for each oracle and reason."""
    said = tables.verdicts.reasons("not judged")
    grouped: dict[tuple[int, int], list[int]] = {}
    for oracle, reason, configuration in zip(
        said.oracle.tolist(), said.reason.tolist(), said.configuration.tolist(), strict=True
    ):
        grouped.setdefault((oracle, reason), []).append(configuration)
    names = tables.configurations.names
    return [
        {
            "oracle": tables.oracles[oracle],
            "reason": said.known[reason],
            "runs": len(where),
            "configurations": [names[k] for k in dict.fromkeys(where)],
        }
        for (oracle, reason), where in grouped.items()
    ]


def rejection_rows(tables: Tables) -> list[Mapping[str, Any]]:
    """A row for each family, producer and kind of reason: the first reason, and whether all are the same."""
    grouped: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in tables.rejections:
        grouped.setdefault((row["family"], row["producer"], kind_of(row["reason"])), []).append(row)
    return [
        {
            "family": family,
            "producer": producer,
            "reason": alike[0]["reason"],
            "alike": len({row["reason"] for row in alike}) == 1,
            "times": len(alike),
            "requested": _requests(alike[:3]),
        }
        for (family, producer, _), alike in grouped.items()
    ]


def _requests(rejections: Iterable[Mapping[str, Any]]) -> Sequence[str]:
    asked = (json.loads(row["requested"]).items() for row in rejections)
    return list(dict.fromkeys(", ".join(f"{key} {short(value)}" for key, value in each) for each in asked))
