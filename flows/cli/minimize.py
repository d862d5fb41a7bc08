"""The command `minimize`: the smallest configuration that still fails, which shows the cause of a failure."""

import json
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from vastflow.flows.cli.consent import Trust, executing
from vastflow.flows.cli.run import computing
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import check_writable, writing
from vastflow.flows.terminal.options import AsJson, ConfigurationName, OracleName, Out, ResultsFolder, asking
from vastflow.sim.model.faults import UserError


@asking("store", "workers")
def minimize(
    results: ResultsFolder,
    configuration: ConfigurationName,
    asked: Mapping[str, Any],
    oracle: OracleName = None,
    rate: Annotated[
        float, typer.Option(help="Failure rate from which a configuration fails, above 0 and below 1.")
    ] = 0.5,
    out: Out = None,
    trust: Trust = False,
    as_json: AsJson = False,
) -> None:
    """Reduce a failing configuration to the smallest one that still fails.

    Removes obstacles, differences of the world, waypoints, and parameters, moves the rest nearer to defaults, and shortens the
    path, while a sequential test shows that it still fails. Writes a campaign file of what is left to
    RESULTS/minimized/CONFIGURATION, and names what can't be removed. Cached results are not computed again. The system under
    test must be a robot.
    """
    check_directory(results)
    if not 0.0 < rate < 1.0:
        raise UserError(f"--rate: expected a failure rate above 0 and below 1, got {rate:g}")
    folder = out or results / "minimized" / configuration
    check_writable(folder, "--out")
    with executing(results, trust), computing() as display:
        from vastflow.flows.analysis.minimize import minimize_configuration

        found = minimize_configuration(results, configuration, oracle=oracle, rate=rate, observer=display, **asked)
    with writing(folder, "--out"):
        written = [str(each) for each in found.write(folder)]
    from vastflow.flows.analysis.minimized import minimized_json, minimized_text

    if as_json:
        print(json.dumps(minimized_json(found, written)))
    else:
        for line in minimized_text(found, written):
            print(line)
