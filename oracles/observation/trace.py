"""Traces: observed recordings, which oracles read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.recording import Columns, Event, Recording, Run, si

SI_SUFFIX: Mapping[str, str] = {
    "mmps": "mps",
    "mradps": "radps",
    "mrad": "rad",
    "mm": "m",
    "ms": "s",
    "mm2": "m2",
    "mrad2": "rad2",
}
"""Suffixes of stored columns to those of signals in SI units."""

CLEARANCES: Final = ("static_clearance_m", "appearing_clearance_m", "moving_clearance_m")
"""Signals of the distance to the nearest outline of a kind of obstacles."""

NOWHERE_MM: Final = 2**31 - 1
"""Stored distance to an absent obstacle (infinite as a signal) or reference path (no signal)."""


@dataclass(frozen=True)
class Reference:
    """The path that a run is compared with, in whole millimeters.

    Attributes:
        points_xy_m: (M >= 1, 2) corners in the map frame, in order of travel.
        length_m: Octile length on the grid.
    """

    points_xy_m: NDArray[np.float64] = field(repr=False)
    length_m: float


@dataclass(frozen=True, slots=True)
class NoReference:
    """A missing reference path, with the reason in one sentence."""

    reason: str


MaybeReference: TypeAlias = Reference | NoReference


class Unobserved(KeyError):
    """A signal or event that needs the true pose, where a recording has the robot's estimate alone."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class Trace:
    """One run as aligned signals in SI units.

    Attributes:
        columns: Name to (N,) float64. Recorded: `t_s x_m y_m yaw_rad estimated_x_m estimated_y_m estimated_yaw_rad speed_mps
            yaw_rate_radps command_speed_mps command_yaw_rate_radps localized`. Derived, distances of the robot's center:
            `localization_error_m`, `stopped` (1 where the robot stands), `wall_clearance_m`, `deviation_m` (to the reference path),
            `separation_m/<size class>` (to the nearest obstacle's center, infinite while there is none), `static_clearance_m` and
            `appearing_clearance_m` (to the nearest outline of obstacles from the start, and of later ones); absent without an object.
            With movers: `mover_x_m/<name>`, `mover_y_m/<name>`, `mover_yaw_rad/<name>`, `separation_m/<name>`, and
            `moving_clearance_m` (to the nearest outline of one), `time_to_collision_s`, and `personal_space_intrusions`.
        reference: The best path around the obstacles of this run, see `reference_path`.
        tables: CSV and parquet files of the run's programs: path below the run's folder, without suffix, to columns (M,).
    """

    run: Run
    columns: Mapping[str, NDArray[np.float64]] = field(repr=False)
    reference: MaybeReference
    tables: Mapping[str, Columns] = field(default_factory=dict, repr=False)

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The signal `column`, or the column `<table>/<column>` of a table."""
        if column in self.columns:
            return self.columns[column]
        table, _, name = column.rpartition("/")
        if table in self.tables:
            return self.tables[table][name]
        self._check_observed(column)
        raise KeyError(column)

    def __len__(self) -> int:
        return len(self.columns.get("t_s", ()))

    @property
    def update_errors_m(self) -> NDArray[np.float64]:
        """Localization error (U,) at each update of AMCL, the first pose included, up to 0.1 s after it."""
        return np.asarray(self["localization_error_m"][self["localized"] > 0])

    def events(self, kind: str) -> tuple[Event, ...]:
        """Events of one kind, in order; raises `Unobserved` for contacts without a true pose."""
        if kind == "contact":
            self._check_observed("contacts")
        return tuple(event for event in self.run.events if event.kind == kind)

    def _check_observed(self, what: str) -> None:
        if self.run.estimated_by:
            raise Unobserved(f"{what}: expected the true pose, got the robot's estimate alone")

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """True positions (N, 2) of the robot's center."""
        return np.column_stack((self["x_m"], self["y_m"]))


def trace_of(recording: Recording, row: Mapping[str, Any], derived: Mapping[str, NDArray[np.int32]]) -> Trace:
    """Join a recording with its stored observation."""
    columns = signals_of({**recording.columns, **derived})
    if "reference" not in row:
        columns.pop("deviation_m", None)
        return Trace(recording.run, columns, NoReference(row["no_reference"]), recording.outputs.tables)
    points_mm = np.array(row["reference"]["points_mm"], dtype=np.float64)
    reference = Reference(points_mm * 1e-3, row["reference"]["length_mm"] * 1e-3)
    return Trace(recording.run, columns, reference, recording.outputs.tables)


def signals_of(stored: Mapping[str, NDArray[np.int32]]) -> dict[str, NDArray[np.float64]]:
    """Stored columns as signals in SI units, absent obstacles at an infinite distance."""
    signals = {}
    for each, column in stored.items():
        name = signal_name(each)
        signals[name] = column.astype(np.float64) if name == each else si(column)
        if name.startswith("separation_m/") or name in (*CLEARANCES, "time_to_collision_s"):
            signals[name][column == NOWHERE_MM] = np.inf
        elif name.endswith(("m2", "rad2")):
            signals[name] = signals[name] * 1e-3
    return signals


def levelled(runs: Sequence[Mapping[str, NDArray[np.int32]]]) -> list[Mapping[str, NDArray[np.int32]]]:
    """Give the stored columns of several runs the same names, missing distances being `NOWHERE_MM`."""
    names = sorted({name for columns in runs for name in columns}, key=lambda name: ("/" in name, name))
    if all(len(columns) == len(names) for columns in runs):
        return list(runs)
    lengths = [len(next(iter(columns.values()), ())) for columns in runs]
    nowhere = [np.full(n, NOWHERE_MM, dtype=np.int32) for n in lengths]
    return [{name: columns.get(name, nowhere[k]) for name in names} for k, columns in enumerate(runs)]


def signal_name(stored: str) -> str:
    """Name in SI units of a stored column: `x_mm` → `x_m`, `separation_mm/box` → `separation_m/box`."""
    name, slash, group = stored.partition("/")
    stem, _, suffix = name.rpartition("_")
    return f"{stem}_{SI_SUFFIX[suffix]}{slash}{group}" if suffix in SI_SUFFIX else stored


def reference_row(reference: MaybeReference) -> dict[str, Any]:
    """JSON values of `reference` for a trace's row, see `trace_of`."""
    if isinstance(reference, NoReference):
        return {"no_reference": reference.reason}
    points_mm = np.rint(reference.points_xy_m * 1000.0).astype(int)
    return {"reference": {"points_mm": points_mm.tolist(), "length_mm": round(reference.length_m * 1000.0)}}
