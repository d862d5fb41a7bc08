"""Find out whether a robot's navigation can be trusted: scenario campaigns, a fast simulator, evidence."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vastflow.flows import execute, instantiate, judge, observe, run_campaign
    from vastflow.flows import open_results as open  # noqa: F401

    __version__: str

__all__ = ["__version__", "execute", "instantiate", "judge", "observe", "run_campaign"]


def __getattr__(name: str) -> Any:
    # Every command and every worker process imports this package: what it names is imported when it is asked for.
    if name == "__version__":
        return import_module("importlib.metadata").version("vastflow")
    if name == "open":  # not in `__all__`, as a star would hide Python's own
        return import_module("vastflow.flows").open_results
    if name in __all__:
        return getattr(import_module("vastflow.flows"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
