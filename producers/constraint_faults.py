"""What is wrong with a family's constraints and can be known before anything is instantiated."""

import itertools
from collections.abc import Mapping
from typing import Any, Final

from vastflow.producers.configuration import Fragment, Rejection
from vastflow.producers.constraints.constraint import Checker, Constraint
from vastflow.producers.constraints.quantities import QUANTITIES
from vastflow.producers.designs.space import DesignSpace, TooLarge
from vastflow.producers.faults import CampaignError, Fault
from vastflow.producers.growth import InstantiableFamily
from vastflow.producers.instantiate import contradictions
from vastflow.producers.producer import Producer, draws_of
from vastflow.sim.model.digest import Value

MOST_LOOKED_AT: Final = 20_000
"""Combinations of values; more are left to instantiation."""


def constraint_faults(family: InstantiableFamily, *, refuse_empty: bool = True) -> list[Fault]:
    """Constraints on plain values that can't be evaluated for some of them, or that leave nothing between them.

    Only producers are asked that read nothing and build nothing, and only constraints are looked at that name
    nothing else.

    Args:
        refuse_empty: Whether it is a fault to leave nothing.
    """
    known = [producer for producer in family.producers if _is_plain(producer)]
    constraints = [c for c in family.constraints if _is_foreseeable(c, family)]
    producers = [producer for producer in known if any(c.touched_by(producer) for c in constraints)]
    if not constraints:
        return []
    checker = Checker(family.name)
    space = DesignSpace(family.name, family.values, family.dimensions, producers, constraints, checker, MOST_LOOKED_AT)
    try:
        for producer in producers:
            space.join({digest: _first(producer, inputs) for digest, inputs in space.inputs().items()})
        blocks = space.blocks()
        checker.raise_faults()
    except TooLarge:
        return []
    except CampaignError as error:
        return list(error.faults)
    nothing = not all(len(block.table) for block in blocks) or (not blocks and bool(space.excluded))
    return contradictions(constraints, family.name, space.excluded) if nothing and refuse_empty else []


def _first(producer: Producer[Any], inputs: Mapping[str, Value]) -> list[Fragment | Rejection]:
    """What `evaluate` gives, as far as it is looked at.

    Raises:
        TooLarge: there is more.
    """
    items = list(itertools.islice(producer.produce(inputs, draws_of(producer, inputs)), MOST_LOOKED_AT + 1))
    if len(items) > MOST_LOOKED_AT:
        raise TooLarge(type(producer).__name__)
    return items


def _is_plain(producer: Producer[Any]) -> bool:
    return not producer.reads and "environment" not in producer.writes.values()


def _is_foreseeable(constraint: Constraint, family: InstantiableFamily) -> bool:
    names = constraint.expression.names
    return not any(name.text in QUANTITIES or name.text.startswith("_") for name in names) and all(
        _is_plain(producer) for producer in family.producers if constraint.touched_by(producer)
    )
