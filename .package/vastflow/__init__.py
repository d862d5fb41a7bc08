"""Find out whether a robot's navigation can be trusted: scenario campaigns, a fast simulator, evidence."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec

    from vastflow.flows import execute as execute
    from vastflow.flows import instantiate as instantiate
    from vastflow.flows import judge as judge
    from vastflow.flows import observe as observe
    from vastflow.flows import open_results as open
    from vastflow.flows import run_campaign as run_campaign
    from vastflow.flows.results.summary import Results as Results
    from vastflow.flows.run.stage_values import Configurations as Configurations
    from vastflow.flows.run.stage_values import Recordings as Recordings
    from vastflow.flows.run.stage_values import Traces as Traces
    from vastflow.flows.run.stage_values import Verdicts as Verdicts
    from vastflow.oracles.results.events import follow as follow
    from vastflow.oracles.results.executed import recorded_tables as recorded_tables
    from vastflow.oracles.results.unfinished import ask_to_stop as ask_to_stop
    from vastflow.oracles.statistics.intervals import pooled as pooled
    from vastflow.sim.model.faults import FileError as FileError
    from vastflow.sim.model.faults import UserError as UserError
    from vastflow.tasks.engine.progress import Progress as Progress
    from vastflow.tasks.prefect.server import PrefectUnavailable as PrefectUnavailable
    from vastflow.tasks.store import Lost as Lost
    from vastflow.tasks.store import StoreError as StoreError

    __version__: str
    __all__ = ["open"]  # whose name is another where it comes from

else:  # of which a type checker would conclude that every name is there

    def __getattr__(name: str) -> Any:
        # Every command and every worker process imports this package: what it names is imported when it is asked for.
        if name == "__version__":
            return import_module("importlib.metadata").version("vastflow")
        return import_module("vastflow.surface").named(__name__, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})


class _Earlier:
    """Finds modules under names that they had in earlier versions, asked when nobody else has found one."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> "ModuleSpec | None":
        if not name.startswith("vastflow."):
            return None
        found: ModuleSpec | None = import_module("vastflow.surface").spec_of(name)
        return found


sys.meta_path.append(_Earlier)
