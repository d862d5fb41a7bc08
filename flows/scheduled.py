"""The flow that deployments run: a whole campaign, asked for by parameters that a form of Prefect's pages can show."""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

from prefect import flow, get_run_logger
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Completed
from pydantic import Field

from vastflow.flows.api import run_campaign
from vastflow.flows.computing.artifacts import Page, publish
from vastflow.flows.computing.task_runs import held
from vastflow.flows.pool.registration import register_flow
from vastflow.flows.request.campaign_file import campaign_name
from vastflow.producers.campaign import load_campaign
from vastflow.tasks.execution.deployment import FLOW, Deployment

Text: TypeAlias = Annotated[str, Field(min_length=1)]
Positive: TypeAlias = Annotated[int, Field(ge=1)]


class CampaignFault(RuntimeError):
    """Something broke in the campaign, so that runs are not judged."""


def _name() -> str:
    """The campaign file's, until the campaign is known."""
    return Path(str(flow_run.parameters.get("campaign", "campaign"))).stem


@flow(name=FLOW, flow_run_name=_name, persist_result=False)
def run_scheduled(
    campaign: Text,
    runs: Positive | None = None,
    only: list[Text] = [],  # noqa: B006 - as Prefect's form shows it
    sample: Positive | None = None,
    map_dir: Text | None = None,
    as_v1: bool = False,
    results: Text = "results",
    store: Text | None = None,
    workers: Positive | None = None,
    reports: Text | None = None,
    pool: Text | None = None,
) -> State[Any]:
    """Run a campaign and write its report.

    Args:
        campaign: Campaign file, as the worker finds it.
        runs: Runs of each configuration; the campaign file's if left out.
        only: Families or configurations to run, by name; all if left out.
        sample: How many distinct configurations of these to run, the same ones each time; all if left out.
        map_dir: Folder, as the worker finds it, of maps that are not beside the campaign file.
        as_v1: Whether every obstacle is placed as version 1 of RoboVAST does, whatever the file says.
        results: Folder the campaign directory is made in.
        store: Where results are kept for the next time; the worker's VASTFLOW_STORE if left out.
        workers: Worker processes; one a core if left out.
        reports: Web address at which the results folder is served, for the link to the report.
        pool: Work pool whose workers compute the runs; the worker that takes this flow run if left out.

    Raises:
        CampaignError: faults of the campaign file.
        CampaignFault: runs could not be judged because of faults; the report has the rest.
    """
    log = get_run_logger()
    name = campaign_name(load_campaign(Path(campaign), None if map_dir is None else Path(map_dir), as_v1=as_v1))
    page = Page(name, str(flow_run.id), log.info)
    with held():
        found = run_campaign(
            campaign,
            runs=runs,
            results=results,
            store=store,
            workers=workers,
            only=only or None,
            sample=sample,
            map_dir=map_dir,
            as_v1=as_v1,
            observer=page,
            pool=pool,
        )
    outcome = publish(found, name, reports)
    log.info("%s; report: %s", outcome, found.directory.resolve() / "report.html")
    if found.faults:
        first = found.faults[0]
        raise CampaignFault(f"{len(found.faults)} faults, the first in {first.stage}: {first.error}")
    return Completed(message=outcome)


def register_deployment(client: SyncPrefectClient, deployment: Deployment) -> str:
    """Make the deployment, or change the one of its name; gives its id."""
    return register_flow(client, deployment.as_yaml(), run_scheduled)
