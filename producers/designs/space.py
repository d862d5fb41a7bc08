"""The space of a family's choices: which combinations exist, given the producers' dependencies.

A factor is a producer, its levels are the places of what it yields. A producer that reads what another wrote has
levels for each of the other's, so the two and all that a constraint ties to them are looked at together, as one table
of the combinations that can be built and are not excluded; producers that nothing ties together stay apart, and the
product of their tables is never made.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import Sample
from vastflow.producers.constraints.constraint import Checker, Constraint
from vastflow.producers.model.configuration import (
    ExcludedInstance,
    Fragment,
    Partial,
    RejectedInstance,
    Rejection,
    Step,
    restricted_digest,
)
from vastflow.producers.model.producer import Producer, tags_of
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import Value
from vastflow.sim.model.scenario import Dimension

MOST_COMBINATIONS: Final = 300_000
"""Maximum number of combinations of dependent choices."""

Levels: TypeAlias = tuple[int, ...]
"""One level of each of some factors, in their order."""


class TooLarge(Exception):
    """More combinations depend on each other than can be looked at."""


@dataclass(frozen=True, slots=True)
class FactorBlock:
    """Factors that depend on each other, and on no others.

    Attributes:
        factors: Ascending.
        table: (N, len(factors)) every admissible combination of their levels, in lexicographic order.
    """

    factors: tuple[int, ...]
    table: NDArray[np.int64]


@dataclass(slots=True)
class _Factor:
    """A producer as a factor: `choices` maps levels of `depends` to its instances."""

    producer: Producer[Any]
    depends: tuple[int, ...] = ()
    choices: dict[Levels, Sequence[Fragment | Rejection]] = field(default_factory=dict)
    digests: dict[Levels, str] = field(default_factory=dict)
    written: set[str] = field(default_factory=set)
    tags: dict[str, Dimension] = field(default_factory=dict)


class DesignSpace:
    """A space that grows by producers: evaluate each on `inputs`, then `join` the results.

    Attributes:
        rejections, excluded: Combinations that can't be built, and those that constraints exclude, each partial one once.
    """

    def __init__(
        self,
        family: str,
        values: Mapping[str, Value],
        dimensions: Mapping[str, Dimension],
        producers: Sequence[Producer[Any]],
        constraints: Sequence[Constraint],
        checker: Checker,
        most: int = MOST_COMBINATIONS,
        start_check: StartCheck | None = None,
    ) -> None:
        self.rejections: list[RejectedInstance] = []
        self.excluded: list[ExcludedInstance] = []
        self._name = family
        self._root = Partial(family, dict(values), dict(dimensions))
        self._factors = [_Factor(producer) for producer in producers]
        gates: list[Constraint | StartCheck] = [*constraints, *([] if start_check is None else [start_check])]
        self._touched = [(gate, [i for i, p in enumerate(producers) if gate.touched_by(p)]) for gate in gates]
        self._checker = checker
        self._verdicts: dict[tuple[int, Levels], bool] = {}
        self._most = most
        self._grown = 0

    def inputs(self) -> dict[str, dict[str, Value]]:
        """Restricted inputs of the next producer, by digest.

        Raises:
            TooLarge: there is more of it than can be looked at.
        """
        factor = self._factors[self._grown]
        reads = set(factor.producer.reads)
        depends = self._closed(i for i in range(self._grown) if self._factors[i].written & reads)
        factor.depends = depends
        inputs: dict[str, dict[str, Value]] = {}
        for levels in self._combinations(depends):
            restricted = self._partial(depends, levels).restricted(factor.producer.reads)
            digest = factor.digests[levels] = restricted_digest(restricted)
            inputs[digest] = restricted
        return inputs

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """Add a producer's results by digest; a missing result means no choices and no rejections."""
        i = self._grown
        factor = self._factors[i]
        label = type(factor.producer).__name__
        for levels, digest in factor.digests.items():
            if digest not in results:
                continue
            items = factor.choices[levels] = results[digest]
            for item in items or [Rejection(f"{label} yielded nothing for this input")]:
                if isinstance(item, Rejection):
                    parent = self._partial(factor.depends, levels, upto=i)
                    inputs = parent.restricted(factor.producer.reads)
                    self.rejections.append(
                        RejectedInstance(self._name, parent.name, label, item.reason, item.requested, inputs)
                    )
                else:
                    factor.written |= item.values.keys()
        factor.tags = tags_of(factor.producer, itertools.chain.from_iterable(factor.choices.values()))
        self._grown += 1

    @property
    def level_counts(self) -> list[int]:
        """The maximum number of choices requested of each factor, rejections included."""
        return [max(map(len, factor.choices.values()), default=0) for factor in self._factors]

    def blocks(self) -> list[FactorBlock]:
        """The whole space: every combination of one row of each block's table is a configuration, and no other is.

        Raises:
            TooLarge: a block has more rows than can be looked at.
        """
        if not self._combinations(()):
            return [FactorBlock((i,), np.empty((0, 1), np.int64)) for i in range(len(self._factors))]
        groups = [{i, *factor.depends} for i, factor in enumerate(self._factors)]
        groups += [set(self._closed(touched)) for _, touched in self._touched if touched]
        blocks = []
        for factors in _merged(groups):
            rows = self._combinations(factors)
            blocks.append(FactorBlock(factors, np.array(rows, dtype=np.int64).reshape(len(rows), len(factors))))
        return blocks

    def partial(self, levels: Sequence[int]) -> Partial:
        """The configuration of one level for each factor."""
        return self._partial(tuple(range(len(self._factors))), tuple(levels))

    def _closed(self, factors: Iterable[int]) -> tuple[int, ...]:
        return tuple(sorted({each for i in factors for each in (i, *self._factors[i].depends)}))

    def _combinations(self, factors: tuple[int, ...]) -> list[Levels]:
        """Every combination of levels of `factors` (closed, ascending) that can be built and is not excluded."""
        found: list[Levels] = [()]
        checked: set[int] = set()
        for n in range(len(factors) + 1):
            if n:
                factor, before = self._factors[factors[n - 1]], factors[: n - 1]
                places = [before.index(j) for j in factor.depends]
                grown = []
                for levels in found:
                    items = factor.choices.get(tuple(levels[place] for place in places), ())
                    grown += [(*levels, k) for k, item in enumerate(items) if isinstance(item, Fragment)]
                    if len(grown) > self._most:
                        raise TooLarge(type(factor.producer).__name__)
                found = grown
            for c, (_, touched) in enumerate(self._touched):
                own = self._closed(touched)
                if c not in checked and max(touched, default=-1) < self._grown and {*own} <= {*factors[:n]}:
                    checked.add(c)
                    places = [factors.index(i) for i in own]
                    found = [levels for levels in found if self._keeps(c, own, tuple(levels[p] for p in places))]
        return found

    def _keeps(self, c: int, factors: tuple[int, ...], levels: Levels) -> bool:
        """Whether a combination of the factors that gate `c` depends on passes it."""
        if (c, levels) not in self._verdicts:
            gate, partial = self._touched[c][0], self._partial(factors, levels)
            found = gate.rejected(partial) if isinstance(gate, StartCheck) else self._checker.excluded(partial, [gate])
            if isinstance(found, RejectedInstance):
                self.rejections.append(found)
            elif found is not None:
                self.excluded.append(found)
            self._verdicts[c, levels] = found is None
        return self._verdicts[c, levels]

    def _partial(self, factors: Sequence[int], levels: Levels, upto: int | None = None) -> Partial:
        """The fixed values with the chosen fragments; `*` for factors below `upto` or the last that have none."""
        level_of = dict(zip(factors, levels, strict=True))
        root = self._root
        values, dimensions = dict(root.values), dict(root.dimensions)
        steps = []
        numbers: list[str] = []
        last = upto if upto is not None else (factors[-1] + 1 if factors else 0)
        for i in range(last):
            if i not in level_of:
                numbers.append("*")
                continue
            factor, level = self._factors[i], level_of[i]
            depends = tuple(level_of[j] for j in factor.depends)
            items = factor.choices[depends]
            fragment = items[level]
            assert isinstance(fragment, Fragment)
            values.update(fragment.values)
            dimensions.update({key: factor.tags[key] for key in fragment.values if key in factor.tags})
            name, digest = type(factor.producer).__name__, factor.digests[depends]
            steps.append(Step(name, tuple(fragment.values), level + 1, digest))
            numbers.append(str(1 + sum(isinstance(item, Fragment) for item in items[:level])))
        return Partial("-".join([root.name, *numbers]), values, dimensions, tuple(steps))


def product_of(blocks: Sequence[FactorBlock]) -> int:
    """Return the number of configurations."""
    return math.prod(len(block.table) for block in blocks)


def _merged(groups: Iterable[set[int]]) -> list[tuple[int, ...]]:
    """The smallest disjoint sets that hold every group whole, in the order of their first member."""
    merged: list[set[int]] = []
    for group in groups:
        apart = [other for other in merged if other.isdisjoint(group)]
        merged = [*apart, group.union(*itertools.chain(other for other in merged if not other.isdisjoint(group)))]
    return sorted(tuple(sorted(group)) for group in merged)


DENSE: Final = 4
"""A sample of more than one in so many of all rows is filled up from a list of the others."""


def sampled(blocks: Sequence[FactorBlock], n_factors: int, asked: Sample) -> NDArray[np.int64]:
    """(N, n_factors) levels; N is `asked.size`, or the size of the whole space where that is less.

    A point of the unit cube has a coordinate for each factor. In turn each is mapped onto the levels that the earlier
    ones leave, by the share of the block's admissible rows that have them: without dependences and constraints that
    is the plain floor(u × levels), with them no point is lost. Points that meet a row again are drawn anew.
    """
    space = product_of(blocks)
    size = min(asked.size, space)
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([asked.seed])))
    more = (rng.random(n_factors) for _ in itertools.count()) if size * DENSE <= space else ()
    rows: dict[tuple[int, ...], None] = {}
    for point in itertools.chain(_points(asked, n_factors, rng), more):
        if len(rows) == size:
            break
        rows.setdefault(_row(blocks, n_factors, point))
    if len(rows) < size:  # the space is at most `DENSE` times as large
        factors = [f for block in blocks for f in block.factors]
        places = sorted(range(n_factors), key=factors.__getitem__)
        every = (list(itertools.chain(*parts)) for parts in itertools.product(*(b.table.tolist() for b in blocks)))
        rest = [row for levels in every if (row := tuple(levels[place] for place in places)) not in rows]
        rows.update(dict.fromkeys(rest[k] for k in rng.permutation(len(rest))[: size - len(rows)]))
    return np.array(sorted(rows), dtype=np.int64).reshape(len(rows), n_factors)


def _points(asked: Sample, n_factors: int, rng: np.random.Generator) -> NDArray[np.float64]:
    if asked.method == "random" or n_factors == 0:
        return rng.random((asked.size, n_factors))
    from scipy.stats import qmc  # half a second, for this design only

    if asked.method == "lhs":
        points: NDArray[np.float64] = qmc.LatinHypercube(n_factors, rng=rng).random(asked.size)
        return points
    exponent = max(asked.size - 1, 0).bit_length()
    points = qmc.Sobol(n_factors, rng=rng).random_base2(exponent)[: asked.size]
    return points


def _row(blocks: Sequence[FactorBlock], n_factors: int, point: NDArray[np.float64]) -> tuple[int, ...]:
    levels = [0] * n_factors
    for block in blocks:
        live = block.table
        for place, factor in enumerate(block.factors):
            # Rows are in lexicographic order, so those of one level are beside each other.
            column = live[:, place]
            chosen = int(column[min(int(point[factor] * len(column)), len(column) - 1)])
            live = live[np.searchsorted(column, chosen, "left") : np.searchsorted(column, chosen, "right")]
            levels[factor] = chosen
    return tuple(levels)
