"""The basis of a run: the files that its results follow from, where they follow from files alone."""

import importlib.metadata
import os
from collections.abc import Iterable, Iterator
from typing import Any, Final

from vastflow.flows.results.inputs import Inputs
from vastflow.flows.results.kept_answer import Basis
from vastflow.flows.results.report_key import REPORT_LIBRARIES
from vastflow.oracles.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.sim.nav2.controllers.registry import known_controllers
from vastflow.sim.nav2.parameter_files.parameter_file import plug_ins_in
from vastflow.sim.plug_ins.loading import OWN, snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot
from vastflow.tasks.evaluation import producers_in
from vastflow.tasks.source import NUMERIC_LIBRARIES, live_source

_LIBRARIES: Final = frozenset(
    {"vastflow", "prefect", *REPORT_LIBRARIES, *(name for of in NUMERIC_LIBRARIES.values() for name in of)}
)


def basis_of(campaign: Campaign, oracles: Iterable[Oracle[Any]], inputs: Inputs) -> Basis | None:
    """What a run of `campaign` follows from; None where that can't be told from files.

    So it is where programs are run, where files are missing that may come, and of plug-ins that are no Python files beside the campaign or
    use modules that are installed nowhere.
    """
    if campaign.programs is not None or campaign.unavailable:
        return None
    if steps_of(campaign.spec.results_processing.postprocessing):
        return None
    if not all(entry.module.startswith(OWN) for entry in known_controllers().values()):
        return None
    snapshots: list[Snapshot] = []
    for plug_in in (*_producers(campaign), *oracles):
        if (snapshot := snapshot_behind(type(plug_in))) is not None:
            snapshots.append(snapshot)
        elif not type(plug_in).__module__.startswith(OWN):
            return None
    for file in plug_ins_in([dict(family.values) for family in campaign.families]):
        snapshots += file.plug_ins.values()
    outside = {top for snapshot in snapshots for top in snapshot.outside}
    if any(not each.entry.endswith(".py") for each in snapshots) or any(map(live_source, outside)):
        return None
    plug_ins = sorted({os.path.abspath(each.origin / each.entry) for each in snapshots})
    return Basis(inputs.read, plug_ins, sorted(_LIBRARIES | _installed(outside)))


def _producers(campaign: Campaign) -> Iterator[Any]:
    for family in campaign.families:
        for producer in family.producers:
            yield from (producer, *producers_in(producer.parameters))


def _installed(outside: Iterable[str]) -> set[str]:
    """The distributions that have these modules."""
    others = [top for top in outside if top not in NUMERIC_LIBRARIES]
    known = importlib.metadata.packages_distributions() if others else {}
    return {name for top in others for name in known.get(top, [top])}
