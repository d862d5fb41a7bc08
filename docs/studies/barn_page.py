"""The page of the public benchmark BARN: runs what is missing, and writes figures from its campaign directories.

    python docs/studies/barn_page.py --worlds DATA --params NAV2.yaml --published dwa_out.txt

runs MPPI, DWB, and Regulated Pure Pursuit at 0.5 and 2 m/s in 50 worlds, ten times each, and the Nav2 file's own controller once in all 300,
and writes `docs/benchmarks.md`. What the store has is not run again. Without `--published` the page has no per-world comparison.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
import typer
from bench_show import loop_s
from jinja2 import Environment, StrictUndefined
from scipy.stats import spearmanr

from vastflow.flows.cli.barn import barn_worlds
from vastflow.oracles.catalog.barn import scores
from vastflow.oracles.statistics.intervals import LEVEL, clustered_interval, normal_quantile
from vastflow.oracles.statistics.measured import interval_of_mean

PAGE: Final = Path(__file__).parents[1] / "benchmarks.md"
PICTURE: Final = "images/barn-hardest-worlds.png"
RATES: Final = ("arrived", "collided", "timed_out")
OWN: Final = "as in the Nav2 file"
"""Name of the controller whose speed the campaign leaves alone."""
_METRICS: Final = (*RATES, "time", "score_2_8", "score_4_8")
_TEMPLATE: Final = Path(__file__).with_name("barn_page.md.j2")
_NEAR_ONE: Final = 1 - 1e-9

Runs: TypeAlias = pd.DataFrame
"""A row for each run: `world`, `arrived`, `collided`, `timed_out`, `time` (s), `score_2_8`, `score_4_8`, NaN where it was not judged; `cpu_s`."""


class Mean(NamedTuple):
    """A mean over worlds, with its interval for other worlds like these."""

    value: float
    low: float
    high: float

    def text(self, digits: int) -> str:
        return f"{self.value:.{digits}f} [{self.low:.{digits}f}, {self.high:.{digits}f}]"


def mean_over_worlds(runs: Runs, column: str) -> Mean | None:
    """The mean of the worlds' means, as the benchmark has it; times are those of runs that arrived. None for fewer than two worlds."""
    kept = runs[runs["arrived"] == 1] if column == "time" else runs
    by_world = kept.groupby("world")[column]
    # One of ten runs may have compiled the kernels.
    means = (by_world.median() if column == "cpu_s" else by_world.mean()).dropna().to_numpy()
    if len(means) < 2:
        return None
    found = clustered_interval(by_world.sum(), by_world.count()) if column in RATES else None
    low, high = (found.low, found.high) if found else interval_of_mean(means, 1 - LEVEL) or (np.nan, np.nan)
    return Mean(float(means.mean()), low, high)


def hardness(runs: Runs) -> pd.DataFrame:
    """Share of failed runs, and mean time (s) of those that arrived, NaN without one, by world."""
    time_s = runs["time"].where(runs["arrived"] == 1)
    return runs.assign(failures=1 - runs["arrived"], time=time_s).groupby("world")[["failures", "time"]].mean()


def correlations(a: Runs, b: Runs) -> dict[str, tuple[Mean | None, int]]:
    """Spearman's correlation of `hardness`, and the number of worlds that both have; None where either is the same in all.

    Intervals are Bonett's and Wright's (Psychometrika 65 (2000) 23). A bootstrap's would be too narrow where only a few worlds have failures.
    """
    found: dict[str, tuple[Mean | None, int]] = {}
    a, b = hardness(a), hardness(b)
    for column in ("failures", "time"):
        x, y = pd.concat([a[column], b[column]], axis=1, join="inner").dropna().to_numpy().T
        found[column] = None, len(x)
        if len(x) > 3 and np.ptp(x) and np.ptp(y):
            value = float(spearmanr(x, y).statistic)
            half = normal_quantile(LEVEL) * np.sqrt((1 + value**2 / 2) / (len(x) - 3))
            middle = np.arctanh(np.clip(value, -_NEAR_ONE, _NEAR_ONE))
            found[column] = Mean(value, *np.tanh((middle - half, middle + half)).tolist()), len(x)
    return found


def published_runs(file: Path, lengths_m: Mapping[int, float]) -> Runs:
    """The runs of a file of the benchmark's own tool; the scores in it are of an older metric, and not read."""
    runs = pd.read_csv(file, sep=r"\s+", names=["world", *_METRICS[:4]], usecols=range(5))
    rows = zip(runs["world"], runs["time"], runs["arrived"], strict=True)
    return runs.join(pd.DataFrame([scores(time_s, lengths_m[world], bool(arrived)) for world, time_s, arrived in rows]))


def runs_of(directory: Path) -> dict[str, Runs]:
    """The runs of each controller of a campaign directory of `vastflow init barn`, in the order of its file."""
    frame = pd.read_parquet(directory / "runs_wide.parquet")
    lines = (directory / "logs" / "runs.jsonl").read_text(encoding="utf-8").splitlines()
    logged = [(each["configuration"], run) for each in map(json.loads, lines) for run in each["runs"]]
    spent_s = {(name, run["run_index"]): run["cpu_s"] for name, run in logged}
    frame["cpu_s"] = [spent_s.get(key) for key in zip(frame["configuration"], frame["run_index"], strict=True)]
    frame = frame.rename(columns=lambda name: re.sub(r"^barn\.(\w+)( \(s\))?$", r"\1", name))
    frame["world"] = frame["world"].str.removeprefix("world_").astype(int)
    named = pd.Series(OWN, frame.index)
    if "controller" in frame:
        speed = frame.filter(like="FollowPath.").max(axis=1)
        named = frame["controller"].astype(str).str.upper() + speed.map(" {:g} m/s".format)
    by_name = frame[["world", *_METRICS, "cpu_s"]].groupby(named, sort=False)
    return {str(name): runs for name, runs in by_name}


def barn_page(
    protocol: Mapping[str, Runs], every_world: Mapping[str, Runs], published: Runs | None, loops_s: Sequence[float]
) -> str:
    """The page of results; the same results give the same text.

    Args:
        protocol, every_world: Runs of each controller in the worlds of the protocol, and in all.
        published: Those of ROS 1's DWA.
        loops_s: CPU time of the loop before and after the runs.
    """
    alike = {}
    if published is not None:
        odd = published.groupby("world").cumcount() % 2 == 1
        alike = {name: correlations(runs, published) for name, runs in protocol.items()}
        alike["half of the published runs, with the other half"] = correlations(published[odd], published[~odd])
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters["mean"] = lambda mean, digits=3: "–" if mean is None else mean.text(digits)
    return environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        rows=[_row(*each) for each in (*protocol.items(), *every_world.items())],
        published=None if published is None else _row("", published),
        correlations=alike,
        hardest={name: _hardest(runs) for name, runs in protocol.items()},
        loops_s=loops_s,
        own=OWN,
        picture=PICTURE,
    )


def _row(name: str, runs: Runs) -> dict[str, Any]:
    counts = {"worlds": runs["world"].nunique(), "runs": len(runs), "judged": runs["arrived"].count()}
    means = {column: mean_over_worlds(runs, column) for column in runs.columns.drop("world")}
    return {"name": name, **counts, **means}


def _hardest(runs: Runs) -> list[tuple[int, float]]:
    """The ten worlds with most failures that had any, with their shares."""
    failures = hardness(runs)["failures"].sort_values(ascending=False, kind="stable")
    return [(int(world), float(share)) for world, share in failures[failures > 0][:10].items()]


def main(
    worlds: Annotated[Path, typer.Option(help="Data of BARN, as `vastflow init barn` takes it.")],
    params: Annotated[Path, typer.Option(help="A Nav2 file without a map.")],
    published: Annotated[Path | None, typer.Option(help="The file res/dwa_out.txt of a clone of BARN.")] = None,
    results: Annotated[Path, typer.Option(help="Folder for campaign directories.")] = Path("results"),
    page: Annotated[Path, typer.Option(help="Where the page is written, its picture in images/.")] = PAGE,
    every: Annotated[int, typer.Option(help="Take every n-th of the 300 worlds.")] = 6,
    runs: Annotated[int, typer.Option(help="Runs of each controller in each of them.")] = 10,
) -> None:
    """Run MPPI, DWB, and Regulated Pure Pursuit in the worlds of BARN, and write the page of their results."""
    file = results / "barn-loops.json"
    before_s = loop_s()
    asked = (every, runs, True), (max(every // 6, 1), 1, False)
    found = [_campaign(worlds, params, results, *each) for each in asked]
    if any(each["executed"] for each in found) or not file.is_file():
        file.write_text(json.dumps([before_s, loop_s()]))
    protocol, every_world = (Path(each["results"]) for each in found)
    lengths_m = {number: world.length_m for number, world in barn_worlds(worlds, 1).items()}
    theirs = published and published_runs(published, lengths_m)
    text = barn_page(runs_of(protocol), runs_of(every_world), theirs, json.loads(file.read_text()))
    page.write_text(text, encoding="utf-8")
    picture = page.parent / PICTURE
    picture.parent.mkdir(exist_ok=True)
    shutil.copy(protocol / "figures" / "maps.png", picture)
    print(f"written: {page}, {picture}")


def _campaign(worlds: Path, params: Path, results: Path, every: int, runs: int, varied: bool) -> Any:
    """The summary of a campaign in every so many worlds, of all controllers or of the file's own."""
    with tempfile.TemporaryDirectory(prefix="barn-page-") as folder:
        file = Path(folder) / "barn" / "barn.vast"
        _vastflow("init", file.parent, "--worlds", worlds, "--params", params.absolute(), "--every", every)
        if varied:
            text = file.read_text(encoding="utf-8")
            file.write_text(re.sub(r"^      # (- OneOf|    )", r"      \1", text, flags=re.MULTILINE), encoding="utf-8")
        return json.loads(_vastflow("run", file, "--runs", runs, "--results", results, "--json"))


def _vastflow(*given: object) -> str:
    command = [sys.executable, "-m", "vastflow.flows.cli", *map(str, given)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


if __name__ == "__main__":
    typer.run(main)
