"""Results of campaigns that have ended."""

import os
from pathlib import Path

from vastflow.flows.results.address import METADATA, check_directory
from vastflow.flows.results.summary import Results, summary_of
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.files import read_json
from vastflow.tasks.engine.engine import RunFault


def open_results(directory: str | os.PathLike[str]) -> Results:
    """Open the directory of a finished campaign; nothing of it is executed.

    Raises:
        UnusableDirectory: it is no campaign directory, or damaged.
    """
    path = Path(directory)
    check_directory(path)
    with reading(path):
        metadata = read_json(path / METADATA)
        faults = tuple(RunFault(**each) for each in metadata["faults"])
        return Results(path, summary_of(metadata["counts"], path), faults, tuple(metadata["notes"]))
