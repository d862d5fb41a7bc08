"""The producer p_i: what every plug-in is, and how it is found."""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Final, Generic, TypeVar, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict

from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import Fault
from vastflow.sim.model.files import Unreadable, read_text, yaml_value
from vastflow.sim.model.obstacle import lists_obstacles
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.plug_ins.effects import plug_in_code, watched
from vastflow.sim.plug_ins.loading import snapshot_behind
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import Registry

ROOM_KEY: Final = "_room_m"
"""Provenance: how far from walls the robot's center is wherever a producer lets it begin or end (m). It narrows what is drawn and
seeds nothing: for robots of two sizes the same is drawn wherever the larger fits."""
MOST_UNTOLD: Final = 100_000
"""Choices for one input of a producer that does not say how many there are."""


class ProducerParameters(BaseModel):
    """Base of every producer's parameter model: unknown keys are faults, values don't change."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    dimension: Dimension | None = None
    """Dimension of everything the producer writes: `environment`, `task` or `system`; else that of each key. Not part of version 1
    elsewhere."""


Parameters = ProducerParameters
P = TypeVar("P", bound=Parameters)


class Draws:
    """The random generators of one evaluation; each draw has its own.

    `draws(k)` is `Generator(PCG64(SeedSequence([seed, content, k])))`, where `content` is the digest of the
    producer's type, the keys it writes and its restricted input (design §4; type and keys are added so that
    two producers with one seed do not draw the same numbers).
    """

    def __init__(self, seed: int, content: str) -> None:
        self._seed = seed
        self._content = int(content, 16)

    def __call__(self, k: int) -> np.random.Generator:
        """The generator of draw `k` >= 0, at its beginning."""
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([self._seed, self._content, k])))


class Producer(ABC, Generic[P]):
    """An ordered producer. A subclass names its parameter model and is a pure function of its input."""

    Parameters: ClassVar[type[Parameters]]
    """The pydantic model of what stands below the producer's name in the campaign file."""

    def __init__(self, parameters: P) -> None:
        self.parameters = parameters

    @property
    def seed(self) -> int:
        """η_i: the producer's seed, 0 where its parameters have none."""
        return int(getattr(self.parameters, "seed", None) or 0)

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Keys of the partial configuration that `produce` may see."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Keys of `reads` that must have been written before."""
        return ()

    @property
    @abstractmethod
    def writes(self) -> Mapping[str, Dimension | None]:
        """Keys it may write, with their dimension, without provenance.

        None: decided by the key, or by its values where these list obstacles.
        """

    @property
    def notes(self) -> tuple[Fault, ...]:
        """Notes on the files that its parameters name."""
        return ()

    @property
    def most_choices(self) -> int | None:
        """Greatest number of fragments and rejections for one input; None if known by `produce` only."""
        return None

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences to the author of a file on parameters that are valid."""
        return ()

    @abstractmethod
    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield a fragment for each realizable choice and a rejection for each that is not.

        Args:
            inputs: The values of `reads` that are present.
            draws: Its only source of randomness.
        """


def check_declared(producer: Producer[Any]) -> None:
    """Check a producer's declarations before it is evaluated.

    Raises:
        PlugInError: what instantiation would mistake; and whatever a property of a user's class raises.
    """
    name = type(producer).__name__
    for what, keys in (("reads", producer.reads), ("needs", producer.needs)):
        if isinstance(keys, str):
            raise PlugInError(f"{name} {what} the text {keys!r}", f"write a tuple of keys, ({keys!r},)")
    for key, tag in producer.writes.items():
        if tag not in (None, *get_args(Dimension)):
            right = f"expected one of {', '.join(get_args(Dimension))}, or None"
            raise PlugInError(f"{name} writes {key!r} as {tag!r}", right)
    _ = producer.most_choices


def evaluate(producer: Producer[Any], inputs: Mapping[str, Value]) -> list[Fragment | Rejection]:
    """Evaluate p_i on one restricted input; the result depends on that input alone.

    Raises:
        PlugInError: more than the producer says, or than `MOST_UNTOLD` where it says nothing; or it read a file, or wrote a key,
            that it does not declare.
    """
    most = producer.most_choices or MOST_UNTOLD
    snapshot = snapshot_behind(type(producer))
    given = _files([producer.parameters, inputs]) if snapshot is not None else ()
    with plug_in_code(), watched(snapshot, given):
        items = list(itertools.islice(producer.produce(inputs, draws_of(producer, inputs)), most + 1))
    name, writes = type(producer).__name__, producer.writes
    if len(items) > most:
        raise PlugInError(f"{name} yields more than its `most_choices` for one input", f"expected at most {most:,}")
    for item in items:
        if not isinstance(item, Fragment | Rejection):
            raise PlugInError(f"{name} yields a {type(item).__name__}", "expected Fragment(...) or Rejection(...)")
        written = item.values if isinstance(item, Fragment) else {}
        for key in (key for key in written if not key.startswith("_")):
            if key not in writes:
                what = f"{name} writes {key!r}, which it does not declare"
                raise PlugInError(what, "declare it in `writes`, or begin it with _ for provenance")
            if writes[key] not in (None, "environment") and lists_obstacles(written[key]):
                what = f"{name} writes obstacles under {key!r} as {writes[key]}, where no simulator looks for them"
                raise PlugInError(what, "write them as environment")
    return items


def tags_of(producer: Producer[Any], items: Iterable[Fragment | Rejection]) -> dict[str, Dimension]:
    """Dimension of each key that differs from the usual one, as declared or by the written values.

    A key under which one of all its items lists obstacles is of the environment in all, in those with an empty list too.
    """
    tags = {key: tag for key, tag in producer.writes.items() if tag is not None}
    for item in items:
        for key, value in item.values.items() if isinstance(item, Fragment) else ():
            if key not in tags and key not in DIMENSION_OF_KEY and lists_obstacles(value):
                tags[key] = "environment"
    return tags


def may_list_obstacles(key: str, tag: Dimension | None) -> bool:
    """Whether only the values of a key tell if they are obstacles."""
    return tag is None and key not in DIMENSION_OF_KEY


def _files(value: object) -> Iterator[str]:
    """Paths of the files that a producer is given, and of maps' pictures."""
    if isinstance(value, FileContent):
        yield value.path
        header = Path(value.path)
        if header.suffix in (".yaml", ".yml"):
            with suppress(Unreadable):
                content = yaml_value(read_text(header))
                if isinstance(content, dict) and isinstance(content.get("image"), str):
                    yield str(header.parent / content["image"])
    elif isinstance(value, BaseModel):
        yield from _files([getattr(value, name) for name in type(value).model_fields])
    elif isinstance(value, Mapping):
        yield from _files(list(value.values()))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for item in value:
            yield from _files(item)


def draws_of(producer: Producer[Any], inputs: Mapping[str, Value]) -> Draws:
    """The randomness of one evaluation of `producer`."""
    seeding = {key: value for key, value in inputs.items() if key != ROOM_KEY}
    return Draws(producer.seed, digest(type(producer).__name__, sorted(producer.writes), seeding))


PRODUCERS: Final[Registry[Producer[Any]]] = Registry(
    "vastflow.producers",
    "producer",
    Producer,  # type: ignore[type-abstract]
    "campaign file",
    is_beside_campaign=True,
)

find_producer = PRODUCERS.find
