"""Prefect flows, the Python API and the command line."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from vastflow.flows.api import run_campaign
    from vastflow.flows.results.address import open_results
    from vastflow.flows.run.stages import execute, instantiate, judge, observe

if __name__ != "vastflow.flows":
    raise ImportError(f"import vastflow.flows, not {__name__}: one module has one name")

__all__ = ["execute", "instantiate", "judge", "observe", "open_results", "run_campaign"]

_PLACES: Final = {"run_campaign": "api", "open_results": "results.address"}
"""Names to their modules; the others are stages."""


def __getattr__(name: str) -> Any:
    # Importing this package must stay cheap: commands like `--help` do.
    if name in __all__:
        return getattr(import_module(f"vastflow.flows.{_PLACES.get(name, 'run.stages')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
