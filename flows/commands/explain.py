"""The command `explain`: one configuration of a campaign, where it came from and what a run would do of it."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.results.at_hand import check_directory
from vastflow.flows.terminal.interruptible import Interruptible
from vastflow.flows.terminal.options import AsJson, ResultsFolder
from vastflow.oracles.directory.unusable import reading


def explain(
    results: ResultsFolder,
    configuration: Annotated[str, typer.Argument(metavar="CONFIGURATION", help="Name of a configuration.")],
    since: Annotated[
        Path | None, typer.Option(metavar="RESULTS", help="Compare with this campaign, else with the one before.")
    ] = None,
    store: Annotated[
        str | None, typer.Option(help="Store: a folder or an address; else $VASTFLOW_STORE, else a user cache folder.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say where a configuration came from, and what a run of it would compute today and why.

    Its scenario in three dimensions with the producer that wrote each value, its digest, the keys of its results and
    which of them are in the store, and what is other in an earlier campaign.
    """
    check_directory(results)
    if since is not None:
        check_directory(since, "--since")
    with Interruptible("interrupted"):
        from vastflow.flows.plan.explain import explained
        from vastflow.flows.plan.explain_text import explanation_json, explanation_text
        from vastflow.flows.terminal.outcome import printed

        with reading(results):
            found = explained(results, configuration, store=store, since=since)
            if as_json:
                print(json.dumps(explanation_json(found), ensure_ascii=False))
            else:
                printed(explanation_text(found))
