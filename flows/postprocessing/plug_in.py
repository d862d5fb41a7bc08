"""One Python plug-in of postprocessing, loaded and called; run as a module in a process of its own.

On standard input it gets a `Request` as JSON; what came of it goes to the file that this names.
"""

import importlib.util
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vastflow.flows.postprocessing.robovast import offer


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be called.

    Attributes:
        file, class_name: The plug-in.
        results: Folder of the campaign, with a folder for each configuration and in it for each run.
        config: Folder with the campaign file and what it names.
        answer: File for `[done, message]`.
    """

    file: str
    class_name: str
    parameters: dict[str, Any]
    results: str
    config: str
    answer: str


def called(request: Request) -> tuple[bool, str]:
    """Whether the plug-in did what it should, and what it says.

    Raises:
        Exception: whatever its code raises.
    """
    file = Path(request.file)
    sys.path[:0] = [str(file.parent), request.config]
    offer()
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} can't be imported as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    found = getattr(module, request.class_name)()(
        results_dir=request.results, config_dir=request.config, **request.parameters
    )
    match found:
        case (bool() as done, message):
            return done, str(message)
    raise TypeError(f"it returned {found!r:.80}; (done, message), such as (True, 'wrote 3 files')")


def main() -> None:
    """Answer the request on standard input. A plug-in that ends the process leaves no answer."""
    request = Request(**json.load(sys.stdin))
    try:
        answer = called(request)
    except Exception as error:  # noqa: BLE001 - a user's code
        answer = (False, f"{type(error).__name__}: {' '.join(str(error).split())}")
    Path(request.answer).write_text(json.dumps(answer), encoding="utf-8")


if __name__ == "__main__":
    main()
