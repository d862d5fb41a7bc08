"""The command `replay`: a recorded run executed again, and pictures of it."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.cli.consent import Trust, executing
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import AsJson, ConfigurationName, Out, ResultsFolder
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.oracles.replay.recorded import RecordedRun
    from vastflow.oracles.replay.story import Story
    from vastflow.sim.replay import Difference, Replay

FILM_EVERY_S: Final = 0.5
SPEED: Final = 2.0
"""Speed of a film, as a multiple of simulated time."""
KINDS: Final = (".mp4", ".gif")
LAST_MS: Final = 2000
"""Duration of a film's last picture."""
STRIP: Final = "strip.png"
FRAMES: Final = "frames"


@dataclass(frozen=True, slots=True)
class ShownTicks:
    """Ticks of a run to draw.

    Attributes:
        last: None for the end of the executed run, which may differ from the recorded one.
        strip: Ticks of the picture strip; empty for a choice between `first` and `last`.
        notes: Sentences on rounded times.
    """

    first: int
    last: int | None
    strip: Sequence[int]
    film: Sequence[int]
    notes: Sequence[str]


def replay(
    results: ResultsFolder,
    configuration: ConfigurationName,
    run: Annotated[int, typer.Argument(metavar="RUN", help="Index of a run, from 0.", min=0)],
    at: Annotated[
        list[float] | None, typer.Option(metavar="S", help="Simulated time to draw (may be repeated).")
    ] = None,
    every: Annotated[
        float | None, typer.Option(metavar="S", help="Seconds between pictures (with --film: of the film).")
    ] = None,
    since: Annotated[float | None, typer.Option("--from", metavar="S", help="First time to draw.")] = None,
    until: Annotated[float | None, typer.Option("--to", metavar="S", help="Last time to draw.")] = None,
    film: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Make a film too: .mp4 (H.264), or .gif for a README."),
    ] = None,
    out: Out = None,
    trust: Trust = False,
    as_json: AsJson = False,
) -> None:
    """Execute a recorded run again and draw it.

    Writes a picture strip of the start, the events, and the end, or of the given times, to RESULTS/replays/. Warns if the
    simulator or the kind of machine differs from the recording's. Exit code 1 if the executed run is not the recorded one,
    bit for bit.
    """
    check_directory(results)
    if film is not None and film.suffix.lower() not in KINDS:
        raise UserError(f"--film {film}: expected a file with the suffix {', '.join(KINDS)}")
    from vastflow.flows.results.provenance import origin_differences, versions
    from vastflow.oracles.replay.recorded import needs_code, recorded_run
    from vastflow.sim.replay import first_difference
    from vastflow.tasks.keys.keys import EXECUTE_SOURCE, numeric_class
    from vastflow.tasks.keys.source import installed_tree

    folder = out or results / "replays" / f"{configuration}-{run}"
    with reading(results):
        recorded = recorded_run(results, configuration, run)
    if not recorded.recording.columns:
        where = f"What its programs wrote is in outputs/{recorded.configuration}.zip."
        raise UnusableDirectory(f"{results}: {configuration} has no robot, so there is nothing to draw. {where}")
    asked = _read_times(recorded, at or [], every, since, until, film is not None)
    with writing(folder, "--out"):
        (folder / FRAMES).mkdir(parents=True, exist_ok=True)
    for note in asked.notes:
        print(note, file=sys.stderr)
    title = f"{configuration}, run {run}"
    differs = origin_differences(
        recorded.metadata, numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), recorded.scenario.system
    )
    for words in differs:
        print(f"{title}: {words}, so that the run executed here may differ", file=sys.stderr)
    with executing(results, trust, code=needs_code(recorded)), Interruptible("interrupted"):
        try:
            replayed, ticks = _execute(recorded, asked)
        except ValueError as error:  # a scenario of another version
            what = f"{configuration} can't be executed by this version: {error}"
            raise UnusableDirectory(f"{results}: {what}") from None
        difference = first_difference(recorded.recording, replayed.recording)
        if difference is not None:
            made = versions(recorded.metadata, same_origin=not differs)
            print(f"{title}: NOT THE RECORDED RUN: {difference}\n{made}", file=sys.stderr)
        with writing(folder, "--out"):
            story = _story(title, recorded, replayed, difference)
            written = _draw(folder, story, replayed, ticks)
        if film is not None:
            with writing(film, "--film"):
                _write_film(film, story, replayed, asked, FILM_EVERY_S if every is None else every)
            written["film"] = str(film)
    if as_json:
        equality = {"equal": difference is None, "difference": difference and str(difference), "differs": differs}
        print(json.dumps({**equality, **written}))
        raise typer.Exit(0 if difference is None else 1)
    if recorded.configuration != configuration:
        print(f"{configuration} has the content of {recorded.configuration}, whose runs were recorded")
    if difference is None:
        print(f"{title}: executed again, equal to the recording bit for bit")
    ran = replayed.recording.run
    print(f"{ran.outcome.replace('_', ' ')}{': ' if ran.reason else ''}{ran.reason}, {ran.simulated_s:.2f} s simulated")
    print(f"strip: {written['strip']}\nframes: {len(written['frames'])} in {folder / FRAMES}")
    if film is not None:
        print(f"film: {film}")
    raise typer.Exit(0 if difference is None else 1)


def _read_times(
    recorded: "RecordedRun",
    at_s: list[float],
    every_s: float | None,
    from_s: float | None,
    to_s: float | None,
    filmed: bool,
) -> ShownTicks:
    from vastflow.oracles.replay.still import MOST
    from vastflow.oracles.replay.story import rounded, span_of, step_of, tick_at, whole_run

    whole = whole_run(recorded.recording.run.simulated_s)
    span = span_of(from_s, to_s, whole)
    regular = span.every(step_of(FILM_EVERY_S if every_s is None else every_s))
    strip = {tick_at("--at", t_s, whole) for t_s in at_s}
    if every_s is not None and not filmed:
        strip |= {*regular}
    if len(strip) > MOST:
        raise UserError(f"{len(strip)} pictures are too many for a strip of at most {MOST}. Use --film for a film.")
    given = [*(("--at", t_s) for t_s in at_s), ("--every", every_s), ("--from", from_s), ("--to", to_s)]
    notes = [note for option, t_s in given if t_s is not None for note in rounded(option, [t_s])]
    last = None if to_s is None else span.last
    return ShownTicks(span.first, last, sorted(strip), regular if filmed else [], notes)


def _execute(recorded: "RecordedRun", asked: ShownTicks) -> "tuple[Replay, list[int]]":
    """Return the run with its snapshots, and the ticks of the strip.

    The run is executed twice, since its events decide which ticks are drawn.
    """
    from vastflow.oracles.replay.story import highlights, view_of
    from vastflow.sim.kernels.numeric import kernel_cache_dir
    from vastflow.sim.reading.script import script_of
    from vastflow.sim.replay import replay as execute

    if not kernel_cache_dir().exists():
        print("compiling the simulator's kernels, once for each version", file=sys.stderr)
    run = recorded.scenario, recorded.recording.run.run_index, recorded.seed
    seen = execute(*run, {})
    last = len(seen.moments) - 1  # not the recorded one's where the two differ
    strip = [tick for tick in asked.strip if tick <= last]
    if not strip:
        end = last if asked.last is None else min(asked.last, last)
        strip = highlights(seen.recording.run, min(asked.first, end), end)
    view = view_of(seen.moments, script_of(recorded.scenario).goals)
    ticks = sorted({*strip, *(min(tick, last) for tick in asked.film)})
    return execute(*run, {tick: view[tick] for tick in ticks}), strip


def _story(title: str, recorded: "RecordedRun", replayed: "Replay", difference: "Difference | None") -> "Story":
    from vastflow.oracles.query.scene import zones_of
    from vastflow.oracles.replay.story import Story, view_of
    from vastflow.sim.reading.script import script_of
    from vastflow.sim.world.environment import world_of

    metadata = recorded.metadata
    equal = "" if difference else ", equal to the recording bit for bit"
    world = world_of(recorded.scenario.environment)
    assert world is not None  # else it would not have been executed
    return Story(
        title=title,
        subtitle=f"{metadata['name']}, {metadata['created'].replace('T', ' ')}{equal}",
        run=replayed.recording.run,
        judgment="not judged" if difference else recorded.judgment,
        warning="" if difference is None else str(difference),
        occupancy=world.walls,
        moments=replayed.moments,
        view=view_of(replayed.moments, script_of(recorded.scenario).goals),
        zones=zones_of([recorded.scenario]),
    )


def _draw(folder: Path, story: "Story", replayed: "Replay", ticks: list[int]) -> dict[str, Any]:
    from vastflow.oracles.figures.style import png
    from vastflow.oracles.replay.still import still_images, strip_figure

    snapshots = {snapshot.moment.tick: snapshot for snapshot in replayed.snapshots}
    chosen = [snapshots[tick] for tick in ticks]
    (folder / STRIP).write_bytes(png(strip_figure(story, chosen)))
    frames = []
    for snapshot, still in zip(chosen, still_images(story, chosen), strict=True):
        t_s = round(snapshot.moment.t_s, 2)
        file = folder / FRAMES / f"{t_s:07.2f}s.png"
        still.save(file)
        frames.append({"t_s": t_s, "file": str(file)})
    return {"frames": frames, "strip": str(folder / STRIP), "film": None}


def _write_film(file: Path, story: "Story", replayed: "Replay", asked: ShownTicks, every_s: float) -> None:
    from vastflow.oracles.figures.film import FilmError, write_film
    from vastflow.oracles.replay.still import still_images

    shown = set(asked.film)
    snapshots = [snapshot for snapshot in replayed.snapshots if snapshot.moment.tick in shown]
    file.parent.mkdir(parents=True, exist_ok=True)
    print(f"drawing a film of {len(snapshots)} pictures", file=sys.stderr)
    try:
        write_film(file, still_images(story, snapshots), round(1000 * every_s / SPEED), LAST_MS)
    except FilmError as error:
        raise UserError(f"--film {file}: {error}") from None
