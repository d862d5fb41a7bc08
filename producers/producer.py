"""The producer p_i: what every plug-in is, and how it is found."""

import functools
import importlib.util
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, Final, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from vastflow.producers.configuration import Fragment, Rejection
from vastflow.sim.digest import Value, digest, file_digest
from vastflow.sim.scenario import Dimension

GROUP: Final = "vastflow.producers"


class Parameters(BaseModel):
    """Base of every producer's parameter model: unknown keys are faults, values don't change.

    Attributes:
        dimension: Overrides the dimension of everything the producer writes.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    dimension: Dimension | None = None


P = TypeVar("P", bound=Parameters)


class Draws:
    """The random generators of one evaluation: the k-th draw has its own, whatever the others do.

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
    """An ordered producer. A subclass names its parameter model and is a pure function of what it reads.

    Attributes:
        Parameters: The pydantic model of what stands below the producer's name in the campaign file.
    """

    Parameters: ClassVar[type[Parameters]]

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
        """Those of `reads` that must have been written before."""
        return ()

    @property
    @abstractmethod
    def writes(self) -> Mapping[str, Dimension | None]:
        """Keys it may write, with their dimension (None: decided by the key), without provenance."""

    @abstractmethod
    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield a fragment for each realisable choice and a rejection for each that is not.

        Args:
            inputs: The values of `reads` that are present.
            draws: Its only source of randomness.
        """


def evaluate(producer: Producer[Any], inputs: Mapping[str, Value]) -> list[Fragment | Rejection]:
    """p_i on one restricted input: the same list whatever else varies, whoever asks, in whatever order."""
    return list(producer.produce(inputs, draws_of(producer, inputs)))


def draws_of(producer: Producer[Any], inputs: Mapping[str, Value]) -> Draws:
    """The randomness of one evaluation of `producer`."""
    return Draws(producer.seed, digest(type(producer).__name__, sorted(producer.writes), dict(inputs)))


class UnknownProducer(LookupError):
    """No producer of this name; `known` lists those there are."""

    def __init__(self, message: str, known: tuple[str, ...]) -> None:
        super().__init__(message)
        self.known = known


def known_producers() -> tuple[str, ...]:
    """Names in the entry-point group `vastflow.producers`, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=GROUP)}))


def find_producer(name: str, base: Path) -> type[Producer[Any]]:
    """The class called `name` in the entry-point group, or `file.py:Class` relative to `base`.

    Raises:
        UnknownProducer: no such entry point, file or class, or a class that is no producer.
    """
    if ".py:" in name:
        file, _, class_name = name.rpartition(":")
        found = getattr(_module_of(base / file), class_name, None) if (base / file).is_file() else None
        if found is None:
            raise UnknownProducer(f"no class {class_name!r} in {str(base / file)!r}", ())
    else:
        entries = [entry for entry in entry_points(group=GROUP) if entry.name == name]
        if not entries:
            raise UnknownProducer(f"no producer {name!r}", known_producers())
        found = entries[0].load()
    if not (isinstance(found, type) and issubclass(found, Producer)):
        raise UnknownProducer(f"{name!r} is not a subclass of vastflow.producers.producer.Producer", ())
    return found


def _module_of(file: Path) -> Any:
    return _imported(str(file.resolve()), file_digest(file))


@functools.lru_cache(maxsize=64)
def _imported(file: str, content: str) -> Any:
    """A plug-in's module under a name of its place and content, so that an edited file is never served stale."""
    module_name = f"vastflow_plugin_{digest(file, content)[:16]}"
    spec = importlib.util.spec_from_file_location(module_name, file)
    if spec is None or spec.loader is None:
        raise UnknownProducer(f"{file!r} can't be imported as a Python module", ())
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    spec.loader.exec_module(module)
    return module
