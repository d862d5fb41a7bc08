"""What deployments of earlier versions run: they have to be made again, for what they ask is asked otherwise now."""

from typing import Any

from prefect import flow

from vastflow.flows.pool.shard_flow import DeployAgain


@flow(name="run campaign", persist_result=False, validate_parameters=False)
def run_scheduled(**parameters: Any) -> None:
    """Say what helps; nothing is run, for what the parameters meant could only be guessed.

    Raises:
        DeployAgain: always.
    """
    campaign = parameters.get("campaign", "FILE")
    raise DeployAgain(
        "this deployment was made by an earlier version of vastflow; deploy again: `vastflow deploy "
        f"{campaign}` with the options it had, then delete this one"
    )
