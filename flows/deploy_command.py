"""The command `deploy`: a campaign that Prefect runs on request or by a schedule."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.run_command import BAD_INPUT, OUR_FAULT
from vastflow.tasks.execution.job import CPU, DATA, IMAGE, NAME, PoolType

if TYPE_CHECKING:
    from vastflow.producers.campaign import Campaign
    from vastflow.tasks.execution.deployment import Deployment
    from vastflow.tasks.execution.description import RunDescription

IMAGE_FOLDER: Final = "/vastflow"
"""Working directory of vastflow's image, with what the image was built from."""

NO_API: Final = (
    "no API of Prefect is configured; start one by `prefect server start`, and name it by "
    "`prefect config set PREFECT_API_URL=http://127.0.0.1:4200/api`"
)


def deploy(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Campaign file.")],
    pool: Annotated[str, typer.Option(metavar="NAME", help="Work pool; made if there is none of that name.")],
    kind: Annotated[PoolType, typer.Option("--type", help="What the pool's workers start.")] = PoolType.process,
    name: Annotated[str | None, typer.Option(help="Of the deployment; else the campaign's.")] = None,
    cron: Annotated[
        str | None,
        typer.Option("--schedule", metavar="CRON", help="When to run, such as '0 2 * * *'; else on request."),
    ] = None,
    timezone: Annotated[str, typer.Option(help="Time zone of the schedule.")] = "UTC",
    runs: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration, instead of the file's.")] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this family or configuration; may be repeated.")
    ] = None,
    results: Annotated[
        str | None, typer.Option(metavar="FOLDER", help="Where the worker makes the campaign directory.")
    ] = None,
    store: Annotated[str | None, typer.Option(help="The worker's store; else its own $VASTFLOW_STORE.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; else one a core.")] = None,
    reports: Annotated[
        str | None, typer.Option(metavar="URL", help="Where the results folder is served, for links to reports.")
    ] = None,
    image: Annotated[str, typer.Option(help="Image with vastflow, for docker and kubernetes.")] = IMAGE,
    queue: Annotated[str, typer.Option(help="Queue of Kueue, for kubernetes.")] = NAME,
    context: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Cluster whose resources count; else the first that the file names."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print deployment and pool as YAML; change nothing.")
    ] = False,
) -> None:
    """Make or change a deployment of a campaign, and its work pool, at Prefect's API.

    A worker of the pool then runs the whole campaign on its machine.
    """
    from vastflow.flows.campaign_file import read_campaign
    from vastflow.flows.results import campaign_name
    from vastflow.producers.faults import CampaignError
    from vastflow.tasks.execution.deployment import Deployment, description_of
    from vastflow.tasks.server import import_prefect

    try:
        campaign, _ = read_campaign(file)
        if campaign.unexecutable:
            raise CampaignError(campaign.unexecutable)
        description = described(campaign, context)
    except CampaignError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None
    place = _place(file, kind)
    title = campaign_name(campaign)
    parameters: dict[str, Any] = {
        "campaign": place,
        "runs": runs,
        "only": only,
        "results": results or _results(kind),
        "store": store,
        "workers": workers or _workers(kind, description),
        "reports": reports,
    }
    deployment = Deployment(
        name=name or title,
        campaign=title,
        parameters={key: value for key, value in parameters.items() if value is not None},
        pool=pool,
        folder=str(Path.cwd()) if kind is PoolType.process else IMAGE_FOLDER,
        description=description_of(
            title, place, runs or campaign.runs, str(campaign.spec.metadata.get("description") or "")
        ),
        job_variables=_job_variables(kind, description, image, queue),
        cron=cron,
        timezone=timezone,
    )
    import_prefect()
    _check_schedule(deployment)
    if dry_run:
        _print(deployment, kind)
    else:
        _register(deployment, kind)


def described(campaign: "Campaign", context: str | None) -> "RunDescription":
    """The run description of a campaign. Its image is that of the containers beside the campaign's own, if there are any."""
    from vastflow.flows.results import campaign_name
    from vastflow.tasks.execution.reading import describe

    execution = campaign.spec.execution
    if execution.image is None and not execution.secondary_containers:
        execution = execution.model_copy(update={"image": IMAGE})
    spec = campaign.spec.model_copy(update={"execution": execution})
    return describe(replace(campaign, spec=spec), campaign_name(campaign), context)


def _job_variables(kind: PoolType, description: "RunDescription", image: str, queue: str) -> dict[str, Any]:
    from vastflow.tasks.execution.job import job_variables

    own: dict[str, Any] = {} if kind is PoolType.process else {"image": image}
    if kind is PoolType.kubernetes:
        own["queue"] = queue
    return own | job_variables(kind, description)


def _place(file: Path, kind: PoolType) -> str:
    """The campaign file as the worker finds it: in an image, below the folder that the image was built from."""
    if kind is PoolType.process:
        return str(file.resolve())
    try:
        return file.resolve().relative_to(Path.cwd()).as_posix()
    except ValueError:
        what = f"{file}: it is not below {Path.cwd()}"
        print(f"{what}; call this from the folder that the image is built from, with the file in it", file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None


def _workers(kind: PoolType, description: "RunDescription") -> int | None:
    """As many as a Job requests cores: it is shown all cores of its node, which others use too."""
    return description.main.needs.cpu or CPU if kind is PoolType.kubernetes else None


def _results(kind: PoolType) -> str:
    return str(Path.cwd() / "results") if kind is PoolType.process else f"{DATA}/results"


def _check_schedule(deployment: "Deployment") -> None:
    from zoneinfo import available_timezones

    from vastflow.flows.registration import is_cron
    from vastflow.producers.faults import did_you_mean

    if deployment.cron is None:
        return
    if not is_cron(deployment.cron):
        right = "five fields, minute hour day month weekday, such as '0 2 * * *'"
        print(f"--schedule: found {deployment.cron!r}; {right}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
    zones = sorted(available_timezones())
    if deployment.timezone not in zones:
        print(f"--timezone: found {deployment.timezone!r}; {did_you_mean(deployment.timezone, zones)}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)


def _print(deployment: "Deployment", kind: PoolType) -> None:
    from vastflow.flows.registration import pool_template
    from vastflow.tasks.execution.manifest import yaml_text

    print("# prefect.yaml")
    print(yaml_text({"deployments": [deployment.as_yaml()]}), end="")
    print("---\n# work pool")
    template = pool_template(kind)
    print(yaml_text({"name": deployment.pool, "type": kind.value, "base_job_template": template}), end="")


def _register(deployment: "Deployment", kind: PoolType) -> None:
    from vastflow.tasks.server import configured_url

    url = configured_url()
    if url is None:
        print(NO_API, file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
    from prefect.client.orchestration import get_client
    from prefect.exceptions import PrefectHTTPStatusError

    from vastflow.flows.registration import OtherPool, register_deployment, register_pool, run_scheduled

    try:
        with get_client(sync_client=True) as client:
            if (unhealthy := client.api_healthcheck()) is not None:
                print(f"Prefect's API at {url} does not answer: {unhealthy}", file=sys.stderr)
                raise typer.Exit(OUR_FAULT)
            new = register_pool(client, deployment.pool, kind)
            found = register_deployment(client, deployment)
    except OtherPool as error:
        print(f"--pool: {error}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None
    except PrefectHTTPStatusError as error:
        print(f"Prefect's API at {url} did not take it: {error}", file=sys.stderr)
        raise typer.Exit(OUR_FAULT) from None
    made = "made" if new else "found"
    print(f"{made} the work pool {deployment.pool}; start a worker: prefect worker start --pool {deployment.pool}")
    print(f"{run_scheduled.name}/{deployment.name}: {url.removesuffix('/api')}/deployments/deployment/{found}")
    print(f"run it: prefect deployment run '{run_scheduled.name}/{deployment.name}'")
