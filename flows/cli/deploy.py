"""The command `deploy`: a campaign that Prefect runs on request or on a schedule."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.cli.run import asked_request
from vastflow.flows.request.run_request import NAMES, command_line
from vastflow.flows.terminal.ending import FAULT
from vastflow.flows.terminal.options import CampaignFile, Context, DryRun, asking
from vastflow.sim.model.faults import UserError, message_of
from vastflow.tasks.prefect.deployment import DATA, IMAGE, NAME, SHORT_DIGEST, PoolType

if TYPE_CHECKING:
    from vastflow.tasks.prefect.containers import Containers
    from vastflow.tasks.prefect.deployment import Deployment

NO_API: Final = (
    "No API of Prefect is configured. Start one by `prefect server start`, and name it by "
    "`prefect config set PREFECT_API_URL=http://127.0.0.1:4200/api`"
)

IMAGE_FOLDER: Final = "/vastflow"
"""Working directory of vastflow's image, with what the image was built from."""


@asking(*NAMES, results=None)
def deploy(
    file: CampaignFile,
    asked: Mapping[str, Any],
    pool: Annotated[
        str | None, typer.Option(metavar="NAME", help="Work pool to run in, created if it does not exist.")
    ] = None,
    kind: Annotated[PoolType, typer.Option("--type", help="What the pool's workers start.")] = PoolType.process,
    name: Annotated[str | None, typer.Option(help="Name of the deployment (default: that of the campaign).")] = None,
    cron: Annotated[
        str | None,
        typer.Option("--schedule", metavar="CRON", help="Schedule such as '0 2 * * *' (default: on request)."),
    ] = None,
    timezone: Annotated[str, typer.Option(help="Time zone of the schedule.")] = "UTC",
    image: Annotated[str, typer.Option(help="Image with vastflow, for docker and kubernetes.")] = IMAGE,
    queue: Annotated[str, typer.Option(help="Queue of Kueue, for kubernetes.")] = NAME,
    context: Context = None,
    kubernetes: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Write the campaign and a Dask cluster for `kubectl apply -k FOLDER` instead."
        ),
    ] = None,
    operator: Annotated[bool, typer.Option("--operator", help="With --kubernetes: use the Dask operator.")] = False,
    dry_run: DryRun = False,
) -> None:
    """Create or change a Prefect deployment of a campaign, and its work pool.

    A worker of the pool then runs the whole campaign on its machine. With --cluster it drives the campaign, and the
    workers of that Dask cluster compute the runs.
    """
    given = [name for name, value in (("--pool", pool), ("--kubernetes", kubernetes)) if value]
    if len(given) != 1:
        raise UserError(f"expected one of --pool and --kubernetes, got {' and '.join(given) or 'none'}")
    if operator and kubernetes is None:
        raise UserError("--operator: requires --kubernetes")
    from vastflow.flows.request.campaign_file import campaign_name, read_campaign
    from vastflow.sim.model.digest import file_digest
    from vastflow.sim.model.faults import FileError
    from vastflow.tasks.prefect.adapter import import_prefect
    from vastflow.tasks.prefect.containers import containers_of
    from vastflow.tasks.prefect.deployment import CPU, Deployment, description_of, job_variables

    map_dir = asked["map_dir"]
    campaign, _ = read_campaign(file, map_dir)
    if campaign.unexecutable:
        raise FileError(campaign.unexecutable)
    title = campaign_name(campaign)
    containers = containers_of(campaign, title, context)
    if kubernetes is not None:
        _write_cluster(kubernetes, containers, file, asked, image, queue, operator=operator)
        return
    assert pool is not None
    place = _place(file, kind)
    cores = containers.needs.cpu or CPU if kind is PoolType.kubernetes else None
    here = {
        "map_dir": None if map_dir is None else _place(map_dir, kind),
        "results": asked["results"] or (str(Path.cwd() / "results") if kind is PoolType.process else f"{DATA}/results"),
        "workers": asked["workers"] or cores,
    }
    request = asked_request(Path(place), {**asked, **here}).public()
    deployment = Deployment(
        name=name or title,
        campaign=title,
        request=request.model_dump(mode="json", exclude_defaults=True),
        pool=pool,
        version=file_digest(file)[:SHORT_DIGEST],
        folder=str(Path.cwd()) if kind is PoolType.process else IMAGE_FOLDER,
        description=description_of(
            title,
            place,
            campaign.runs_asked(request.runs),
            str(campaign.spec.metadata.get("description") or ""),
            request.cluster,
            least=campaign.sequential.min if request.runs is None and campaign.sequential is not None else None,
        ),
        job_variables=job_variables(kind, containers, image, queue),
        cron=cron,
        timezone=timezone,
    )

    import_prefect()
    _check_schedule(deployment)
    if dry_run:
        _print(deployment, kind)
    else:
        _register(deployment, kind)


WORKERS: Final = 8
"""Default number of workers of a Dask cluster."""


def _write_cluster(
    folder: Path,
    containers: "Containers",
    file: Path,
    asked: Mapping[str, Any],
    image: str,
    queue: str,
    *,
    operator: bool,
) -> None:
    from vastflow.tasks.prefect.kustomization import LONGEST_NAME, SECRET_FILE, cluster_files, scheduler_address
    from vastflow.tasks.store.store import is_address

    store, results = asked["store"], asked["results"]
    if store is None or not is_address(store):
        raise UserError(f"--store: expected an address that all pods reach, such as s3://bucket/store, got {store!r}")
    if asked["cluster"] is not None:
        raise UserError(f"--cluster: --kubernetes makes a cluster, got {asked['cluster']!r}")
    kind = PoolType.kubernetes
    map_dir = None if asked["map_dir"] is None else _place(asked["map_dir"], kind)
    containers = replace(containers, name=containers.name[:LONGEST_NAME].rstrip("-"))
    results = results or f"{store.rstrip('/')}-results"
    own = {"cluster": scheduler_address(containers.name), "results": results, "map_dir": map_dir, "workers": 1}
    request = asked_request(Path(_place(file, kind)), {**asked, **own}).public()
    command = ["vastflow", "run", *command_line(request)]
    made = cluster_files(containers, command, asked["workers"] or WORKERS, image, queue, operator=operator)
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in made.items():
        if name != SECRET_FILE or not (folder / name).exists():  # credentials are the user's
            (folder / name).write_text(content, encoding="utf-8")
    (folder / SECRET_FILE).chmod(0o600)
    print(f"wrote {folder}, now fill in {folder / SECRET_FILE}")
    print(f"once: kubectl apply -f {folder / 'namespace.yaml'}, and with Kueue also -f {folder / 'queues.yaml'}")
    print(f"then: kubectl apply -k {folder}")
    followed = f"{containers.name}-runner" if operator else f"job/{containers.name} -c campaign"
    print(f"follow it: kubectl -n {NAME} logs -f {followed}")


def _place(file: Path, kind: PoolType) -> str:
    """Return a path as the worker finds it: in an image, below the folder that it was built from."""
    if kind is PoolType.process:
        return str(file.resolve())
    try:
        return file.resolve().relative_to(Path.cwd()).as_posix()
    except ValueError:
        raise UserError(
            f"{file}: Expected a path below {Path.cwd()}. Call this from the folder that the image is built from."
        ) from None


def _check_schedule(deployment: "Deployment") -> None:
    from zoneinfo import available_timezones

    from vastflow.sim.model.names import did_you_mean
    from vastflow.tasks.prefect.registration import is_cron

    if deployment.cron is None:
        return
    if not is_cron(deployment.cron):
        right = "five fields, minute hour day month weekday, such as '0 2 * * *'"
        raise UserError(f"--schedule: expected {right}, got {deployment.cron!r}")
    zones = sorted(available_timezones())
    if deployment.timezone not in zones:
        hint = did_you_mean(deployment.timezone, zones)
        raise UserError(f"--timezone: {message_of(f'unknown time zone {deployment.timezone!r}', hint)}")


def _print(deployment: "Deployment", kind: PoolType) -> None:
    from vastflow.tasks.prefect.manifests import yaml_text
    from vastflow.tasks.prefect.registration import pool_template

    print("# prefect.yaml")
    print(yaml_text({"deployments": [deployment.as_yaml()]}), end="")
    print("---\n# work pool")
    pool = {"name": deployment.pool, "type": kind.value, "base_job_template": pool_template(kind)}
    print(yaml_text(pool), end="")


def _register(deployment: "Deployment", kind: PoolType) -> None:
    from vastflow.tasks.prefect.server import configured_url
    from vastflow.tasks.store.artifact import redacted

    url = configured_url()
    if url is None:
        raise UserError(NO_API)
    url = redacted(url)
    import httpx
    from prefect.client.orchestration import get_client
    from prefect.exceptions import PrefectHTTPStatusError

    from vastflow.flows.campaign import campaign
    from vastflow.tasks.prefect import retry
    from vastflow.tasks.prefect.registration import register_flow, register_pool

    def registered() -> tuple[str, bool]:
        with get_client(sync_client=True) as client:
            is_new = register_pool(client, deployment.pool, kind)
            return register_flow(client, deployment.as_yaml(), campaign), is_new

    def say(text: str) -> None:
        print(f"Prefect's API at {url} {redacted(text)}", file=sys.stderr)

    patience = f"{retry.IN_BETWEEN_S:.0f} s"
    try:
        with retry.bounded():
            with get_client(sync_client=True) as client:
                if isinstance(unhealthy := client.api_healthcheck(), httpx.ConnectError):
                    say(f"does not answer: {unhealthy}")
                    raise typer.Exit(FAULT)
            busy = f"is busy, trying again for up to {patience}"
            found, is_new = retry.retried(registered, retry.IN_BETWEEN_S, missed=lambda _: say(busy))
    except (httpx.TransportError, PrefectHTTPStatusError) as error:
        say(f"was busy for {patience}. Deploy again later" if retry.is_away(error) else f"did not take it: {error}")
        raise typer.Exit(FAULT) from None
    pool = deployment.pool
    print(
        f"{'made' if is_new else 'found'} the work pool {pool}, now start a worker: prefect worker start --pool {pool}"
    )
    print(f"{campaign.name}/{deployment.name}: {url.removesuffix('/api')}/deployments/deployment/{found}")
    print(f"run it: prefect deployment run '{campaign.name}/{deployment.name}'")
