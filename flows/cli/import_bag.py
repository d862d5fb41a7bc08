"""The command `import`: bags of real or Gazebo robots as recorded runs of a campaign, beside simulated ones."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from vastflow.flows.cli.run import asked_request, computing
from vastflow.flows.terminal.ending import FAULT, check_writable
from vastflow.flows.terminal.options import AsJson
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.bags.imported import ImportedBag, Spread
    from vastflow.sim.model.pose import Pose


def import_bag(
    bags: Annotated[list[Path], typer.Argument(metavar="BAG...", help="Bags: folders, .mcap, .db3, or .bag files.")],
    map_file: Annotated[Path, typer.Option("--map", metavar="YAML", help="The map that the robot had.")],
    params: Annotated[
        Path | None, typer.Option(metavar="YAML", help="Nav2 parameters of the simulated robot (default: Nav2's own).")
    ] = None,
    runs: Annotated[int, typer.Option(min=0, help="Simulated runs beside each recorded one.")] = 20,
    results: Annotated[Path, typer.Option(help="Folder for campaign directories.")] = Path("results"),
    store: Annotated[str | None, typer.Option(help="Store, as for `vastflow run`.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes (default: one per core).")] = None,
    namespace: Annotated[str, typer.Option(help="The robot's namespace, such as robot1.")] = "",
    start: Annotated[
        str | None, typer.Option(metavar="X,Y,YAW", help="Pose at the bag's begin, where it has no map frame.")
    ] = None,
    goal: Annotated[str | None, typer.Option(metavar="X,Y,YAW", help="Goal, where the bag does not name it.")] = None,
    as_json: AsJson = False,
) -> None:
    """Import bags as recorded runs, judge them, and set them beside simulated runs.

    The campaign directory opens with show, compare, ui, and its report. Without a true pose in the bag the robot's estimate stands
    for it, every verdict says so, and clearance and contacts are not judged.
    """
    poses = pose_of(start, "--start"), pose_of(goal, "--goal")
    for file, option in ((map_file, "--map"), (params, "--params")):
        if file is not None and not file.is_file():
            raise UserError(f"{option}: expected a file, got {file}")
    check_writable(results, "--results")
    with TemporaryDirectory(prefix="vastflow-import-") as folder:
        from vastflow.flows.bags.imported import scenario_robot, spread_in, write_import

        try:
            file, imported = write_import(
                *(Path(folder), bags, map_file, params), runs=runs, namespace=namespace, start=poses[0], goal=poses[1]
            )
        except ValueError as error:  # of the map
            raise UserError(str(error)) from None
        request = asked_request(file, {"results": results, "store": store, "workers": workers})
        with computing() as display:
            from vastflow.flows import run_campaign

            found = run_campaign(request, observer=display)
    for note in found.notes:
        print(note, file=sys.stderr)
    spreads = {each.real: spread_in(found.directory, each.real, each.simulated) for each in imported}
    if as_json:
        print(
            json.dumps(
                {"results": str(found.directory), "spreads": {name: asdict(each) for name, each in spreads.items()}}
            )
        )
    else:
        for each in imported:
            robot = scenario_robot(found.directory, each.real)
            print("\n".join([*_told(each), *robot, *table_of(spreads[each.real])]))
        print(f"report: {found.directory / 'report.html'}")
    if found.faults:
        raise typer.Exit(FAULT)


def pose_of(text: str | None, option: str) -> "Pose | None":
    """Read `X,Y,YAW` (m, m, rad)."""
    from vastflow.sim.model.pose import Pose

    if text is None:
        return None
    try:
        x_m, y_m, yaw_rad = map(float, text.split(","))
    except ValueError:
        raise UserError(f"{option}: expected X,Y,YAW in m and rad, got {text!r}") from None
    return Pose(x_m, y_m, yaw_rad)


def _told(imported: "ImportedBag") -> list[str]:
    drive, (x_m, y_m, _) = imported.drive, imported.drive.poses[0].tolist()
    estimate = f"the robot's estimate ({drive.origin}); no clearance, no contacts"
    goal, took_s = drive.goal, drive.t_s[-1] - drive.t_s[0]
    route = f"({x_m:.2f}, {y_m:.2f}) to ({goal.x_m:.2f}, {goal.y_m:.2f}), {drive.goal_from}"
    return [
        f"{imported.real}: {drive.outcome.replace('_', ' ')} after {took_s:.1f} s, {route}",
        f"pose: {estimate if drive.truth is None else 'the true pose'}",
        *(f"note: {note}" for note in imported.notes),
    ]


def table_of(spread: "Spread") -> list[str]:
    """Return a table of signals, and what it says in all."""
    from vastflow.flows.bags.imported import LEAST_RUNS

    n = max((place.n for place in spread.places), default=0)
    if not n:
        return ["no simulated runs"]
    lines = [f"{'signal':42} {'real':>9} {'simulated: least, median, most':>32}  n  p"]
    for each in spread.places:
        range_ = "no value" if each.least is None else f"{each.least:.3f}, {each.median:.3f}, {each.most:.3f}"
        real = "no value" if each.real is None else f"{each.real:.3f}"
        said = "" if each.p is None else f" {each.p:.2f}"
        called = "" if each.outside is None else " OUTSIDE" if each.outside else " inside"
        lines.append(f"{each.signal:42} {real:>9} {range_:>32} {each.n:2}{said}{called}")
    few = f": too few to call a signal outside, which takes --runs {LEAST_RUNS}" if n < LEAST_RUNS else ""
    lines.append(f"with {n} runs no p-value is below {min(1.0, 2 / (n + 1)):.2g}{few}")
    if spread.p is not None:
        own, *others = spread.beyond
        as_many = sum(each >= own for each in others)
        lines.append(f"the real run has {own} signals beyond the range of all others, {as_many} of {len(others)} simulated runs "
                     f"have as many beyond theirs: p = {spread.p:.2g} for all signals together")  # fmt: skip
    return lines
