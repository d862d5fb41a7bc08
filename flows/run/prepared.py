"""A campaign that is ready to run: its file is checked, its store open, its keys made."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vastflow.flows.request.campaign_file import OpenCampaign, campaign_keys, read_campaign
from vastflow.flows.request.run_request import SEQUENTIAL, Asked, RunRequest
from vastflow.flows.results.address import Delivery, delivery_to
from vastflow.flows.results.inputs import Inputs, inputs_of
from vastflow.flows.results.provenance import ingredients_row, origin_row
from vastflow.flows.results.summary import Work
from vastflow.flows.run.computing import Computing, open_computing, show_progress, stopwatch
from vastflow.flows.run.due import DueWork
from vastflow.flows.run.search_progress import PointRuns, SearchProgress, search_progress
from vastflow.producers.campaign import Campaign
from vastflow.sim.model.faults import FileError
from vastflow.tasks.engine.forced import Forced
from vastflow.tasks.engine.instantiation import Instantiator
from vastflow.tasks.engine.process import few_collections
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import SourceTree, installed_tree
from vastflow.tasks.store.store import Store, open_store

if TYPE_CHECKING:
    from vastflow.flows.request.stopping import Stopping


@dataclass(frozen=True)
class PreparedCampaign:
    """A campaign that is ready to run.

    Attributes:
        record: Entries of `metadata.json` beside those of every campaign directory.
        delivery: Folder that the campaign directory is made in, and its destination.
        search: The search that proposes configurations; None where the file lists them.
        stopping: Says how many runs a configuration wants; None where that is fixed.
        forced: Work to repeat although the store has its results.
        due: Work of the call, with reasons for what it computes.
        work: Returns the work of the call so far.
    """

    request: RunRequest
    opened: OpenCampaign
    inputs: Inputs = field(repr=False)
    asked: Asked
    record: Mapping[str, Any] = field(repr=False)
    delivery: Delivery
    tree: SourceTree = field(repr=False)
    keys: Keys = field(repr=False)
    search: SearchProgress | None = field(repr=False)
    stopping: "Stopping | PointRuns | None"
    forced: Forced = field(repr=False)
    due: DueWork = field(repr=False)
    work: Callable[[], Work] = field(repr=False)

    @property
    def campaign(self) -> Campaign:
        """The campaign file."""
        return self.opened.campaign

    @property
    def name(self) -> str:
        """The campaign's."""
        return self.opened.name

    @property
    def store(self) -> Store:
        """The store of its artifacts."""
        return self.opened.store

    @property
    def instantiator(self) -> Instantiator:
        """The instantiator of the campaign, or of a search's current points."""
        if self.search is None:
            return Instantiator(self.campaign, self.store, self.keys, self.tree, forced=self.forced)
        points = self.search.campaign(self.campaign)
        return Instantiator(points, self.store, self.keys, self.tree, refuse_empty=False, forced=self.forced)


@contextmanager
def open_run(request: RunRequest, observer: Observer | None = None) -> Iterator[tuple[PreparedCampaign, Computing]]:
    """Read and check the campaign of a request, find its store, make its keys, and open what computes it.

    Args:
        observer: Is shown the progress, from one thread.

    Raises:
        FileError: faults of the file.
        StoreError: the store can't be used, or this machine lacks something that a computation needs.
    """
    with show_progress(observer) as tally, few_collections():
        work = stopwatch(tally)
        map_dir = None if request.map_dir is None else Path(request.map_dir)
        campaign, oracles = read_campaign(Path(request.campaign), map_dir, strict=request.strict)
        if campaign.unexecutable:
            raise FileError(campaign.unexecutable)
        inputs = inputs_of(campaign, oracles)
        store = open_store(request.store, may_be_full=True)
        opened = OpenCampaign(campaign, oracles, store)
        delivery = delivery_to(request.results, store)
        tree = installed_tree()
        keys = campaign_keys(tree, campaign.seed, oracles)
        stopping, rule = None, {}
        if request.runs is None and campaign.sequential is not None:
            from vastflow.flows.request.stopping import stopping_of  # imports statistics, which take a moment

            stopping = stopping_of(campaign.sequential)
            rule = {SEQUENTIAL: stopping.as_json}
        runs = campaign.runs_asked(request.runs, request.sample)
        asked = Asked(campaign.path.name, runs, request.only, inputs.places, request.sample)
        search = search_progress(campaign, request, stopping, runs, store, inputs.campaign, tally)
        record = {"asked": asked.as_json(), **rule, **ingredients_row(tree, campaign.families, oracles)}
        forced = Forced(request.forced)
        run = PreparedCampaign(
            request,
            opened,
            inputs,
            asked,
            record,
            delivery,
            tree,
            keys,
            search,
            stopping if search is None else search.runs,
            forced,
            DueWork(opened.name, delivery.folder, {**origin_row(keys), **record}, campaign.families, forced),
            work,
        )
        with open_computing(
            run.opened,
            keys,
            oracles,
            tally,
            workers=request.workers,
            stopping=run.stopping,
            cluster=request.cluster or os.environ.get("DASK_SCHEDULER_ADDRESS"),
        ) as computes:
            yield run, computes
