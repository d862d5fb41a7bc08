"""Checks of a producer's contract, which its author can call in a test."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, get_args

from vastflow.producers.model.configuration import Fragment, Rejection, restricted_digest
from vastflow.producers.model.producer import Parameters, Producer, draws_of, evaluate
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.plug_ins.conformance import must, watched_generators
from vastflow.sim.plug_ins.neighbors import PlugInError

Inputs = Sequence[Mapping[str, Value]]


def check_producer(producer: Producer[Any], inputs: Inputs) -> None:
    """Evaluate `producer` on several inputs and check that it keeps its contract: all of `CHECKS`, in their order.

    Args:
        inputs: Values of partial configurations; keys that the producer does not read may be among them. Choose some
            that it can build and some that it must reject.

    Raises:
        AssertionError: what it did and what it should do.
    """
    for check in CHECKS:
        check(producer, inputs)


def check_declarations(producer: Producer[Any], inputs: Inputs) -> None:
    """Check that a producer declares its parameters and its read, needed, and written keys correctly."""
    name, reads, writes = type(producer).__name__, producer.reads, producer.writes
    must(isinstance(producer.parameters, Parameters), f"{name}'s parameters must be a producer.Parameters")
    must(isinstance(reads, tuple), f"{name} must declare `reads` as a tuple of keys, not {reads!r}")
    unread = sorted(set(producer.needs) - set(reads))
    must(not unread, f"{name} must declare {unread}, which it needs, in `reads`")
    private = sorted(key for key in writes if key.startswith("_"))
    must(not private, f"{name} must not declare {private} in `writes`. Keys with _ are provenance, and free.")
    tags = {tag for tag in writes.values() if tag is not None} - set(get_args(Dimension))
    must(not tags, f"{name} must tag what it writes with one of {get_args(Dimension)} or None, not {sorted(tags)}")


def check_items(producer: Producer[Any], inputs: Inputs) -> None:
    """It yields fragments that write only declared keys, and rejections with a reason, of values that have a digest."""
    for items in (_evaluated(producer, values) for values in inputs):
        _digest(items)
        for item in (item for item in items if isinstance(item, Rejection)):
            told = isinstance(item.reason, str) and item.reason.strip()
            must(told, f"{type(producer).__name__} must say why it rejects, in `Rejection.reason`")


def check_inputs_are_kept(producer: Producer[Any], inputs: Inputs) -> None:
    """Check that a producer does not change its input, which configurations share."""
    for values in inputs:
        restricted = _restricted(producer, values)
        before = restricted_digest(restricted)
        evaluate(producer, restricted)
        must(restricted_digest(restricted) == before, f"{type(producer).__name__} must not change its inputs")


def check_determinism(producer: Producer[Any], inputs: Inputs) -> None:
    """It yields the same again, in any order of the inputs, and so does another one with the same parameters.

    Global generators are not to be drawn from, even where they are seeded before: another thread may use them.
    """
    name = type(producer).__name__
    same = f"{name} must yield the same for the same input. Draw from `draws` alone, and keep no state."
    with watched_generators() as used:
        first = [_digest(_evaluated(producer, values)) for values in inputs]
        again = [_digest(_evaluated(producer, values)) for values in reversed(inputs)][::-1]
        twin = type(producer)(producer.parameters)
        must(first == again == [_digest(_evaluated(twin, values)) for values in inputs], same)
        must(not used(), f"{name} must not use a global generator. Draw from `draws` alone.")


def check_reads(producer: Producer[Any], inputs: Inputs) -> None:
    """It reads no key that it does not declare, and what else a configuration holds changes nothing."""
    for values in inputs:
        draws = draws_of(producer, _restricted(producer, values))
        watched = list(producer.produce(_Watched(values, producer), draws))
        what = f"{type(producer).__name__} must yield the same from a whole configuration as from what it declares"
        must(_digest(watched) == _digest(_evaluated(producer, values)), what)


CHECKS: Final[tuple[Callable[[Producer[Any], Inputs], None], ...]] = (
    check_declarations,
    check_items,
    check_inputs_are_kept,
    check_determinism,
    check_reads,
)
"""All checks, for a test that is parametrised with them and reports each on its own."""


class _Watched(Mapping[str, Value]):
    """A whole partial configuration that objects when an undeclared key is read."""

    def __init__(self, values: Mapping[str, Value], producer: Producer[Any]) -> None:
        self._values = values
        self._producer = producer

    def __getitem__(self, key: str) -> Value:
        if key not in self._producer.reads:
            raise AssertionError(
                f"{type(self._producer).__name__} must declare {key!r} in `reads`, which are {self._producer.reads}"
            )
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return (key for key in self._values if key in self._producer.reads)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _restricted(producer: Producer[Any], values: Mapping[str, Value]) -> dict[str, Value]:
    return {key: values[key] for key in producer.reads if key in values}


def _evaluated(producer: Producer[Any], values: Mapping[str, Value]) -> list[Fragment | Rejection]:
    try:
        return evaluate(producer, _restricted(producer, values))
    except PlugInError as error:
        raise AssertionError(str(error)) from None


def _digest(items: Sequence[Fragment | Rejection]) -> list[str]:
    return [
        restricted_digest(item.values) if isinstance(item, Fragment) else digest(item.reason, dict(item.requested))
        for item in items
    ]
