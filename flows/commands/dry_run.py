"""The option `--dry-run` of `run`: says what a run would compute and why, and does nothing of it."""

import json
from pathlib import Path

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.terminal.interruptible import Interruptible


def print_dry_run(request: RunRequest, *, since: Path | None, as_json: bool) -> None:
    """Print the dry run of a request."""
    from vastflow.flows.plan.dry_run import dry_run
    from vastflow.sim.plug_ins.effects import looking_only

    with Interruptible("interrupted; nothing was written"), looking_only():
        found = dry_run(
            Path(request.campaign),
            runs=request.runs,
            results=Path(request.results),
            store=request.store,
            only=request.only,
            sample=request.sample,
            map_dir=None if request.map_dir is None else Path(request.map_dir),
            as_v1=request.as_v1,
            strict=request.strict,
            since=since,
        )
    from vastflow.flows.plan.dry_run_text import dry_run_json, dry_run_text
    from vastflow.flows.terminal.outcome import printed

    if as_json:
        print(json.dumps(dry_run_json(found, Path(request.campaign)), ensure_ascii=False))
    else:
        printed(dry_run_text(found))
