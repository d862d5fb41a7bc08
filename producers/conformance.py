"""What every producer must do, as checks that a producer's author can call in a test."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from vastflow.producers.configuration import Fragment, Rejection, restricted_digest
from vastflow.producers.producer import Producer, draws_of, evaluate
from vastflow.sim.digest import Value, digest


def check_producer(producer: Producer[Any], inputs: Sequence[Mapping[str, Value]]) -> None:
    """Evaluate `producer` on several inputs and check that it keeps its contract.

    It must yield fragments and rejections with a reason, of values that have a digest; write no key that it does not
    declare; read no key that it does not declare; and yield the same again, in any order of the inputs.

    Args:
        inputs: Values of partial configurations; keys that the producer does not read may be among them.

    Raises:
        AssertionError: what it did and what it should do.
    """
    name = type(producer).__name__
    first = [_evaluated(producer, values) for values in inputs]
    for items in first:
        _check_items(producer, items)
    again = [_evaluated(producer, values) for values in reversed(inputs)][::-1]
    if [_digest(items) for items in first] != [_digest(items) for items in again]:
        raise AssertionError(f"{name} must yield the same for the same input; draw from `draws` alone, keep no state")
    for values, items in zip(inputs, first, strict=True):
        draws = draws_of(producer, _restricted(producer, values))
        if _digest(list(producer.produce(_Watched(values, producer), draws))) != _digest(items):
            raise AssertionError(f"{name} must yield the same from a whole configuration as from what it declares")


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


def _check_items(producer: Producer[Any], items: Sequence[Any]) -> None:
    name = type(producer).__name__
    for item in items:
        if isinstance(item, Rejection):
            if not item.reason.strip():
                raise AssertionError(f"{name} must say why it rejects, in `Rejection.reason`")
            digest(dict(item.requested))
        elif isinstance(item, Fragment):
            undeclared = {key for key in item.values if not key.startswith("_")} - set(producer.writes)
            if undeclared:
                raise AssertionError(f"{name} must declare {sorted(undeclared)} in `writes`")
            digest(dict(item.values))
        else:
            what = type(item).__name__
            raise AssertionError(f"{name} must yield Fragment or Rejection, not {what}")  # noqa: TRY004 - a check


def _restricted(producer: Producer[Any], values: Mapping[str, Value]) -> dict[str, Value]:
    return {key: values[key] for key in producer.reads if key in values}


def _evaluated(producer: Producer[Any], values: Mapping[str, Value]) -> list[Fragment | Rejection]:
    return evaluate(producer, _restricted(producer, values))


def _digest(items: Sequence[Fragment | Rejection]) -> list[str]:
    return [
        restricted_digest(item.values) if isinstance(item, Fragment) else digest(item.reason, dict(item.requested))
        for item in items
    ]
