"""Prefect flows, the Python API and the command line."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vastflow.flows.api import run_campaign

__all__ = ["run_campaign"]


def __getattr__(name: str) -> Any:
    # Importing this package must stay cheap: commands like `--help` do.
    if name in __all__:
        from vastflow.flows import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
