"""Configurations: what `instantiate` gives, and what `execute` takes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import pyarrow as pa

from vastflow.flows.request.campaign_file import OpenCampaign
from vastflow.flows.results.tables import configuration_row
from vastflow.flows.terminal.words import count_text
from vastflow.oracles.results.schema import CONFIGURATIONS
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.engine.engine import RunFault


@dataclass(frozen=True, repr=False)
class Configurations:
    """The instantiation of a campaign, in memory as a whole.

    Attributes:
        opened: The campaign and its store.
        faults: Producers that raised: what they would have made is missing.
    """

    opened: OpenCampaign = field(repr=False)
    instantiation: Instantiation = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All names in order, duplicates of other configurations included."""
        return tuple(self._named)

    @property
    def rejections(self) -> tuple[RejectedInstance, ...]:
        """Instances that can't be built, with the reason."""
        return self.instantiation.rejections

    @property
    def excluded(self) -> tuple[ExcludedInstance, ...]:
        """Instances that constraints exclude."""
        return self.instantiation.excluded

    @property
    def coverage(self) -> Mapping[str, Any]:
        """Coverage of the requested test space, in the form of `coverage.json`."""
        return self.instantiation.coverage

    def __repr__(self) -> str:
        lost = f"{len(self.rejections)} instances rejected, {len(self.excluded)} excluded"
        return f"<{self.opened.name}: {count_text(len(self), 'configuration')}, {lost}{faults_text(self.faults)}>"

    def __len__(self) -> int:
        return len(self._named)

    def __iter__(self) -> Iterator[Configuration]:
        return iter(self.instantiation.configurations)

    def __getitem__(self, name: str) -> Configuration:
        """The configuration called `name`.

        Raises:
            UserError: there is none.
        """
        if name not in self._named:
            raise UserError(f"expected the name of a configuration, got {name!r}; {did_you_mean(name, self._named)}")
        return self._named[name]

    def executed_as(self, name: str) -> Configuration:
        """The configuration whose runs are those of `name`: an earlier one of the same content, or itself.

        Raises:
            UserError: there is none.
        """
        found = self[name]
        return found if found.duplicate_of is None else self[found.duplicate_of]

    def table(self) -> pa.Table:
        """A row for each configuration, as `configurations.parquet` of a campaign directory."""
        rows = [configuration_row(configuration) for configuration in self]
        return pa.Table.from_pylist(rows, schema=CONFIGURATIONS)

    @cached_property
    def _named(self) -> Mapping[str, Configuration]:
        return {configuration.name: configuration for configuration in self.instantiation.configurations}


def faults_text(faults: Sequence[RunFault]) -> str:
    """Format a number of faults, such as `, 2 faults`; empty for none."""
    return f", {count_text(len(faults), 'fault')}" if faults else ""
