"""One step of postprocessing in its own process: a program, or a Python plug-in, which has RoboVAST's names."""

import importlib.util
import subprocess
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final
from xml.etree import ElementTree as ET

from vastflow.sim.model.faults import UserError


class BasePostprocessingPlugin:
    """Base of plug-ins: called with the results' folder, they return their success and a message."""

    def __call__(self, results_dir: str, config_dir: str, **kwargs: Any) -> tuple[bool, str]:
        """Process a campaign's results with the parameters of the campaign file; see `call` for the folders."""
        raise NotImplementedError(f"{type(self).__name__} has no __call__")

    def get_files_to_copy(self, config_dir: str, params: dict[str, Any]) -> list[str]:
        """Files that the plug-in needs; nothing asks for them here."""
        return []


def is_campaign_dir(folder: str | Path) -> bool:
    """Whether a folder holds a campaign's results."""
    return (Path(folder) / "_config").is_dir()


def read_test_result(run: str | Path) -> dict[str, Any]:
    """Return `success`, `errors`, `failures`, and `duration` from `test.xml` of a run's folder."""
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
            name, "Stands for RoboVAST, which is not installed; see vastflow.flows.run.postprocessing_step."
        )
        module.__path__ = []
        for member in members:
            setattr(module, member.__name__, member)
        sys.modules[name] = module
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], child, module)


def call(request: Mapping[str, Any]) -> tuple[bool, str]:
    """Call a plug-in; return its success and its message. Raises whatever its code raises.

    Args:
        request: `file` and `class` of the plug-in, its `parameters`, the folder of the campaign's `results`, and that of its `config`.
    """
    file = Path(request["file"])
    installed = sysconfig.get_path("purelib")  # modules beside the plug-in come before these, and after Python's own
    first = sys.path.index(installed) if installed in sys.path else len(sys.path)
    sys.path[first:first] = [str(file.parent), request["config"]]
    offer()
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} can't be imported as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    found = getattr(module, request["class"])()(
        results_dir=request["results"], config_dir=request["config"], **request["parameters"]
    )
    match found:
        case (bool() as done, message):
            return done, str(message)
    raise TypeError(f"expected (done, message), such as (True, 'wrote 3 files'), got {found!r:.80}")


def run_command(request: Mapping[str, Any]) -> int:
    """Run a program; return its exit code."""
    command = request["command"]
    try:
        return subprocess.run(command, check=False).returncode
    except OSError as error:
        raise UserError(f"{Path(command[0]).name} can't be started: {error.strerror or error}") from None
