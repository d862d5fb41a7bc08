"""The names of the package `robovast` that plug-ins of postprocessing import, for a process in which it is not installed."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, Final
from xml.etree import ElementTree as ET


class BasePostprocessingPlugin:
    """Base of plug-ins: called with the results' folder, it gives whether it did what it should, and a message."""

    def __call__(self, results_dir: str, config_dir: str, **kwargs: Any) -> tuple[bool, str]:
        """Process a campaign's results.

        Args:
            results_dir: Folder of the campaign.
            config_dir: Folder with the campaign file and what it names.
            kwargs: The parameters that the campaign file has.
        """
        raise NotImplementedError(f"{type(self).__name__} has no __call__")

    def get_files_to_copy(self, config_dir: str, params: dict[str, Any]) -> list[str]:
        """Files that the plug-in needs; nothing asks for them here."""
        return []


def is_campaign_dir(folder: str | Path) -> bool:
    """Whether a folder holds a campaign's results."""
    return (Path(folder) / "_config").is_dir()


def read_test_result(run: str | Path) -> dict[str, Any]:
    """What `test.xml` of a run's folder says: `success`, `errors`, `failures`, `duration`."""
    root = ET.parse(Path(run) / "test.xml").getroot()
    suite = root if root.tag == "testsuite" else root.find("testsuite")
    values = {} if suite is None else suite.attrib
    errors, failures = int(values.get("errors", 0)), int(values.get("failures", 0))
    success = suite is not None and not errors and not failures
    return {"success": success, "errors": errors, "failures": failures, "duration": float(values.get("time", 0.0))}


_NAMES: Final[dict[str, tuple[Any, ...]]] = {
    "robovast": (),
    "robovast.common": (),
    "robovast.common.campaign_data": (read_test_result,),
    "robovast.common.execution": (is_campaign_dir,),
    "robovast.results_processing": (),
    "robovast.results_processing.postprocessing_plugins": (BasePostprocessingPlugin,),
}
"""Module to what it has."""


def offer() -> None:
    """Let these modules be imported in this process, unless RoboVAST itself can be."""
    if importlib.util.find_spec("robovast") is not None:
        return
    for name, members in _NAMES.items():
        module = ModuleType(
            name, "Stands for RoboVAST, which is not installed; see vastflow.flows.postprocessing.robovast."
        )
        module.__path__ = []
        for member in members:
            setattr(module, member.__name__, member)
        sys.modules[name] = module
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], child, module)
