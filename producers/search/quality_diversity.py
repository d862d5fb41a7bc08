"""The strategy `qd`: quality-diversity (MAP-Elites) by pyribs, which fills an archive of unlike points, each the best of its kind."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from vastflow.producers.model.numbers import Count, Number, Positive
from vastflow.producers.search.gaussian_process import promise
from vastflow.producers.search.space import Point
from vastflow.producers.search.strategy import Cell, Evaluation, Parameters, Strategy, missing_library
from vastflow.sim.model.faults import Invalid

if TYPE_CHECKING:
    from ribs.archives import ArchiveBase

_SEEDS: Final = 2**31
_CELLS: Final = 256
_BINS: Final = 10
_FIRST: Final = 8
"""Points that are random in any case."""
_DRAWN: Final = 8
"""Cells of which the best is stepped from, or toward."""
_ALONG: Final = 0.5
"""Standard deviation of the part of the line to another cell that a step goes from a cell drawn evenly."""
_TRIED: Final = 64
"""Steps toward the best of which that of most promise is taken."""
_KNOWN: Final = 256
"""Points found last, by which a step promises something."""
_CVT_SAMPLES: Final = 10_000
"""Points in the space of measures of which the cells of a CVT archive are the clusters; (Vassiliades et al., 2018)."""


class Measure(Parameters):
    """The range of a measure; values outside of it belong to the outermost cells."""

    low: Number
    """Lower end, in the measure's unit."""
    high: Number
    """Upper end, in the measure's unit."""
    bins: Count | None = None
    """Cells along it, of a grid."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise Invalid(f"'low' is {self.low:g} and 'high' {self.high:g}", "'low' must be less than 'high'")
        return self


class Archive(Parameters):
    """The division of the space of measures into cells."""

    type: Literal["grid", "cvt"] = "grid"
    """Equal bins along each measure, or cells round evenly spread centers, for many measures."""
    cells: Count | None = None
    """Number of cells of a CVT archive; default: 256."""
    bins: Count | None = None
    """Along each measure that says none of its own; 10 where nothing is said."""
    measures: Annotated[Mapping[str, Measure], Field(min_length=1)]
    """Name to range: a dimension of the search, or a number that `extract` gives."""


class QdParameters(Parameters):
    """Parameters of `qd`."""

    archive: Archive
    """Measures and cells that define the kinds of points."""
    sigma: Positive = 0.1
    """Standard deviation of the step from a point of the archive to a new one, beside its part along a line, as a fraction of each
    range."""
    emitters: Count = 1
    """Emitters that take steps from the archive, each with its share of a batch."""


class QualityDiversity(Strategy[QdParameters]):
    """Steps from points of the archive, each along the line to another one.

    The line is that of V. Vassiliades and J.-B. Mouret, GECCO 2018, 149. Every other step leads from a cell drawn evenly,
    back and forth, so that all kinds go on; those between from the best of several to the best of others, and of many
    such the one of most promise (A. Gaier et al., Evol. Comput. 26 (2018) 381). Random at first, and as long as all
    objectives are equal.
    """

    Parameters: ClassVar[type[Parameters]] = QdParameters
    library: ClassVar[str] = "ribs"
    reports: ClassVar[tuple[str, ...]] = ("coverage", "qd_score")

    def __init__(self, parameters: Any, problem: Any) -> None:
        super().__init__(parameters, problem)
        self._dimensions = len(problem.space.dimensions)
        self._archive = self._empty()
        self._found: list[Evaluation] = []
        self._steps = 0
        self._names = self.measures(self.parameters)

    @classmethod
    def measures(cls, parameters: QdParameters) -> Sequence[str]:
        return tuple(parameters.archive.measures)

    @property
    def metrics(self) -> Mapping[str, float]:
        """The share of filled cells, and the sum of gains over them."""
        stats = self._archive.stats
        return {"coverage": float(stats.coverage), "qd_score": float(stats.qd_score)}

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        draws = self.problem.draws(batch)
        # The best of equal objectives would lead to the middle of the known points.
        if len(self._found) < _FIRST or len(np.unique(self._archive.data("objective"))) < 2:
            units = draws.random((count, self._dimensions))
        else:
            emitters = min(self.parameters.emitters, count)
            shares = [count // emitters + (k < count % emitters) for k in range(emitters)]
            firsts = self._steps + np.cumsum([0, *shares[:-1]])
            emitted = zip(firsts.tolist(), shares, strict=True)
            units = np.concatenate([self._emitted(*each, int(draws.integers(_SEEDS))) for each in emitted])
            self._steps += count
        return [self.problem.space.decoded(unit) for unit in units]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        known = [
            each for each in evaluations if each.objective is not None and set(self._names) <= each.measures.keys()
        ]
        if not known:  # a point without one of the measures is in no cell
            return
        places = np.arange(len(self._found), len(self._found) + len(known))
        self._found += known
        self._archive.add(
            np.array([self.problem.space.encoded(each.proposal.point) for each in known]),
            np.array([self.problem.gain(each.objective) for each in known if each.objective is not None]),
            np.array([[each.measures[name] for name in self._names] for each in known]),
            place=places,
        )

    @property
    def archive(self) -> Sequence[Cell]:
        found = self._archive.data(["index", "place"])
        indices = np.asarray(found["index"], dtype=np.int64)
        if self.parameters.archive.type == "grid" and len(indices):
            indices = np.stack(np.unravel_index(indices, self._bins()), axis=-1)
        rows = zip(indices.reshape(len(found["place"]), -1).tolist(), found["place"], strict=True)
        return sorted(
            (Cell(tuple(index), self._found[int(place)]) for index, place in rows), key=lambda cell: cell.index
        )

    def _emitted(self, first: int, count: int, seed: int) -> NDArray[np.float64]:
        """Return steps from the archive, in turn from cells drawn evenly and from the best of several."""
        draws, found = np.random.default_rng(seed), self._archive.data(["solution", "objective"])
        points, gains = np.asarray(found["solution"], dtype=np.float64), np.asarray(found["objective"])
        cells = draws.integers(len(gains), size=(2, count, _DRAWN))
        chosen, others = (each[np.arange(count), np.argmax(gains[each], axis=1)] for each in cells)
        evenly = (first + np.arange(count)) % 2 == 1
        chosen[evenly], others[evenly] = cells[:, evenly, 0]
        parts = draws.random((count, _TRIED))
        parts[evenly] = _ALONG * draws.normal(size=parts[evenly].shape)
        steps = self.parameters.sigma * draws.normal(size=(count, _TRIED, self._dimensions))
        along = parts[..., None] * (points[others] - points[chosen])[:, None]
        units: NDArray[np.float64] = np.clip(points[chosen][:, None] + along + steps, 0.0, 1.0)
        taken = np.zeros(count, dtype=np.int64)
        if not evenly.all():
            taken[~evenly] = np.argmax(self._promise(units[~evenly]), axis=1)
        return units[np.arange(count), taken]

    def _promise(self, units: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, m) what may be gained at (n, m, d) coordinates, by the points found last."""
        last = [each for each in self._found[-_KNOWN:] if each.objective is not None]
        known = np.array([self.problem.space.encoded(each.proposal.point) for each in last])
        gains = np.array([self.problem.gain(each.objective) for each in last if each.objective is not None])
        return promise(known, gains, units.reshape(-1, self._dimensions)).reshape(units.shape[:2])

    def _bins(self) -> tuple[int, ...]:
        archive = self.parameters.archive
        return tuple(each.bins or archive.bins or _BINS for each in archive.measures.values())

    def _empty(self) -> "ArchiveBase":
        try:
            from ribs.archives import CVTArchive, GridArchive
        except ImportError:
            raise missing_library("ribs (pyribs)") from None
        archive = self.parameters.archive
        ranges = [(each.low, each.high) for each in archive.measures.values()]
        own: dict[str, Any] = {
            "solution_dim": self._dimensions,
            "ranges": ranges,
            "seed": int(self.problem.draws(0).integers(_SEEDS)),
            "extra_fields": {"place": ((), np.int64)},
        }
        if archive.type == "grid":
            return GridArchive(dims=self._bins(), **own)
        return CVTArchive(centroids=archive.cells or _CELLS, samples=_CVT_SAMPLES, **own)
