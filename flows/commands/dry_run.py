"""The option `--dry-run` of `run`: says what a run would compute and why, and does nothing of it."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from vastflow.flows.terminal.interruptible import Interruptible


def print_dry_run(
    file: Path,
    *,
    runs: int | None,
    results: Path,
    store: str | None,
    only: Sequence[str],
    sample: int | None,
    map_dir: Path | None,
    as_v1: bool,
    since: Path | None,
    as_json: bool,
) -> None:
    """Print the dry run of the campaign at `file`; a wrong file or option ends with exit code 2."""
    from vastflow.flows.plan.dry_run import dry_run
    from vastflow.flows.results.past import NoPast
    from vastflow.producers.faults import CampaignError
    from vastflow.sim.plug_ins.effects import looking_only
    from vastflow.tasks.store import StoreError

    with Interruptible("interrupted; nothing was written"):
        try:
            with looking_only():
                found = dry_run(
                    file,
                    runs=runs,
                    results=results,
                    store=store,
                    only=only,
                    sample=sample,
                    map_dir=map_dir,
                    as_v1=as_v1,
                    since=since,
                )
        except NoPast as error:
            print(f"--since {error}", file=sys.stderr)
            raise typer.Exit(2) from None
        except (CampaignError, StoreError) as error:
            print(error, file=sys.stderr)
            raise typer.Exit(2) from None
    from vastflow.flows.plan.dry_run_text import dry_run_json, dry_run_text
    from vastflow.flows.terminal.outcome import printed

    if as_json:
        print(json.dumps(dry_run_json(found, file), ensure_ascii=False))
    else:
        printed(dry_run_text(found))
