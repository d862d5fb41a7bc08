"""Samples: rows spread over a space, each admissible and none twice."""

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import Sample
from vastflow.producers.designs.space import FactorBlock, product_of

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
    exponent = math.ceil(math.log2(asked.size)) if asked.size > 1 else 0
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
