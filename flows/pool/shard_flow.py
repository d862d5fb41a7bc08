"""What earlier versions of vastflow made a pool's workers run: such deployments are of no use any more."""

from typing import Any

from prefect import flow


class DeployAgain(RuntimeError):
    """A deployment was made by an earlier version of vastflow."""


@flow(name="vastflow-shard", persist_result=False, validate_parameters=False)
def run_shard(**parameters: Any) -> None:
    """Say what helps; nothing is computed.

    Raises:
        DeployAgain: always.
    """
    raise DeployAgain(
        "an earlier version of vastflow asks for this shard, or made its deployment; deploy again: `vastflow deploy FILE --pool POOL`, "
        "or run the campaign with this version of vastflow, then delete this deployment"
    )
