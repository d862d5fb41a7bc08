"""Stored runs: a campaign directory of what the store has by now, without a report; nothing is computed.

    python -m vastflow.flows.run.stored REQUEST

The request is JSON. A process of its own keeps a campaign's plug-ins out of the one that asks.
"""

import sys

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.summary import Results
from vastflow.flows.run.judged import look
from vastflow.flows.run.prepared import open_run
from vastflow.flows.run.reporting import write_judged
from vastflow.sim.model.faults import UserError


def write_stored(request: RunRequest) -> Results:
    """Write the campaign directory of a request whose runs are all in the store.

    Raises:
        UserError: the store lacks some of them, or the campaign file is another by now.
    """
    with open_run(request) as (run, computing):
        run.store.refresh()
        judged = look(run, computing)
        if judged is None or judged.incomplete(computing.engine):
            raise UserError("not all of these runs are judged yet, or the campaign file has changed")

        with new_directory(run.delivery.folder, run.name, computing.created) as directory, directory.writing():
            return write_judged(run, computing, judged, directory, run.record, report=lambda place: None)


if __name__ == "__main__":
    try:
        write_stored(RunRequest.model_validate_json(sys.argv[1]))
    except UserError as error:
        sys.exit(str(error))
