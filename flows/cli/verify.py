"""The command `verify`: the digests of a publication, and some of its runs executed again."""

import secrets
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Final

import typer

from vastflow.flows.cli.consent import executing
from vastflow.flows.terminal.ending import BAD_INPUT, Interruptible, writing
from vastflow.sim.model.faults import UserError

WRONG: Final = 1
_SHOWN: Final = 20
_DIGITS: Final = 9


def verify(
    archive: Annotated[Path, typer.Argument(metavar="ARCHIVE", help="An archive that `vastflow publish` wrote.")],
    runs: Annotated[
        str, typer.Option(metavar="N", help="Runs to execute again; `all`, or 0 for digests alone.")
    ] = "10",
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="Seed of the drawn runs (default: a random one, which is shown).")
    ] = None,
    trust: Annotated[
        bool, typer.Option("--trust", help="Execute code in the archive that you did not make, now and from now on.")
    ] = False,
) -> None:
    """Verify a published campaign.

    Compares the digest of every file with the manifests of BagIt, and executes randomly drawn runs again, which must equal
    their recordings bit for bit. Exit code 1 if something is wrong, 2 if it can't be checked.
    """
    if runs != "all" and not runs.isdecimal():
        raise UserError(f"--runs: expected a number or 'all', got {runs!r:.40}")
    number = None if runs == "all" else int(runs)
    with Interruptible("Interrupted. Nothing was shown."):
        from vastflow.flows.publication.bag import opened_bag
        from vastflow.flows.publication.verification import check_files

        with opened_bag(archive) as bag, TemporaryDirectory(prefix="vastflow-") as scratch:
            directory = Path(scratch) / "campaign"
            directory.mkdir()
            with writing(directory):
                equal, wrong = check_files(bag, None if number == 0 else directory)
            for name, what in [*wrong.items()][:_SHOWN]:
                print(f"{what}: {repr(name)[1:-1]}")  # names of strangers may move the cursor
            print(f"digests: {equal} files equal, {len(wrong)} wrong")
            code = WRONG if wrong else 0
            if number != 0:
                drawn_by = secrets.randbelow(10**_DIGITS) if seed is None else seed
                code = max(code, _execute(archive, directory, number, drawn_by, trust), key=(0, BAD_INPUT, WRONG).index)
    raise typer.Exit(code)


def _execute(archive: Path, directory: Path, number: int | None, seed: int, trust: bool) -> int:
    from vastflow.flows.publication.verification import execute_again, population_of, sample_of, shown_text
    from vastflow.flows.results.provenance import origin_differences, versions
    from vastflow.oracles.replay.recorded import needs_code, recorded_run
    from vastflow.oracles.results.unusable import UnusableDirectory
    from vastflow.tasks.keys.keys import EXECUTE_SOURCE, numeric_class
    from vastflow.tasks.keys.source import installed_tree

    differs: list[str] = []
    made = ""
    try:
        population = population_of(directory)
        drawn = sample_of(population.runs, number, seed)
        has_code = any(needs_code(recorded_run(directory, *each)) for each in dict(drawn).items())
        for recorded in (recorded_run(directory, *each) for each in drawn[:1]):
            here = numeric_class(), installed_tree().digest(*EXECUTE_SOURCE)
            differs = origin_differences(recorded.metadata, *here, recorded.scenario.system)
            made = versions(recorded.metadata, same_origin=not differs)
    except UnusableDirectory as error:
        print(f"No run can be executed again: {str(error).replace(str(directory), str(archive))}")
        return BAD_INPUT
    for words in differs:
        print(f"{words}, so that runs executed here may differ", file=sys.stderr)
    what = "the simulator, and code of the archive" if has_code else "the simulator alone, and no code of the archive"
    print(f"executing {len(drawn)} of {len(population.runs)} runs again (--seed {seed}): {what}", file=sys.stderr)
    executed = []
    with executing(directory, trust, code=has_code, called=archive):
        for run in execute_again(directory, drawn, has_code):
            executed.append(run)
            if run.outcome != "equal":
                print(f"{run.outcome}: {run.configuration}, run {run.run_index}: {run.words}")
    outcomes = {run.outcome for run in executed}
    if "different" in outcomes and made:
        print(made)
    print(shown_text(population, executed))
    if "different" in outcomes:
        return BAD_INPUT if differs else WRONG
    return BAD_INPUT if "unusable" in outcomes or not executed else 0
