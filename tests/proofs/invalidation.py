"""Count what each edit of a table computes again.

A campaign of everything that a key is made of, a producer, an oracle and a notebook of its own with helpers, a package and data files, a
map, a scenario file and a program, is computed once. Then, for each edit of the table, a copy of it and of vastflow's own
source is edited, and computed again over a copy of the store.

Counted is what happens, not what a key says: the program, the producer, the oracle (`judged`) and the notebook (`looked`) write lines
into a file each time they are called; traces and verdicts are counted as artifacts that are new. The table says of each edit what it must compute again, and what it must not.
Edits of `ROBOT` are those of a second campaign, in which a robot drives: its runs are counted as they are recorded.

    python tests/proofs/invalidation.py [--only WORDS] [--json]

Prints a line for each edit and the figures; exit code 1 where one computed too little or too much.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from invalidation_bed import BLOCKS, COUNTED, DRIVES, RUNS, Bed, appended, replaced, verdicts

NOTHING: Final[Mapping[str, int]] = dict.fromkeys(COUNTED, 0)
GATHERED: Final[Mapping[str, int]] = {**NOTHING, "gathered": BLOCKS}
"""Verdicts that are there, or of an oracle of vastflow's own, and causes of failures."""
JUDGED: Final[Mapping[str, int]] = {**GATHERED, "judged": RUNS}
LOOKED: Final[Mapping[str, int]] = {**GATHERED, "looked": RUNS}
EVALUATED: Final[Mapping[str, int]] = {**NOTHING, "evaluated": 1}
ONE_BLOCK: Final[Mapping[str, int]] = {**NOTHING, "judged": RUNS // BLOCKS, "looked": RUNS // BLOCKS}
ALL: Final[Mapping[str, int]] = {"evaluated": 1, "executed": RUNS, "judged": RUNS, "looked": RUNS}
DRIVEN: Final[Mapping[str, int]] = {"executed": DRIVES}
KEPT: Final[Mapping[str, int]] = {"executed": 0}
ASKED_JUDGE: Final = "    - judge.py:Judge: {limit: 5}\n"
ASKED_LOOK: Final = "    - look.ipynb: {most: 7}\n"

Counts: TypeAlias = Mapping[str, int]
Edit: TypeAlias = Callable[[Bed], object]


def executed(runs: int, evaluated: int = 0) -> Counts:
    """Bounds on what an edit of `runs` runs computes again."""
    return {"evaluated": evaluated, "executed": runs}


def renamed_campaign(bed: Bed) -> None:
    """The campaign's folder lies elsewhere."""
    bed.file("").rename(bed.folder / "elsewhere")
    bed.campaign = "elsewhere"


def cell(bed: Bed, number: int, key: str, value: object) -> None:
    """Edit a cell of the notebook."""
    document = json.loads(bed.file("look.ipynb").read_text())
    document["cells"][number][key] = value
    bed.file("look.ipynb").write_text(json.dumps(document, indent=2))


def renamed_picture(bed: Bed) -> None:
    """The map's picture has another name."""
    bed.file("maps/room.pgm").rename(bed.file("maps/cellar.pgm"))
    bed.replace("maps/room.yaml", "room.pgm", "cellar.pgm")


@dataclass(frozen=True)
class swap:
    """Replace a text in a file of the campaign, or of vastflow where its name begins so."""

    name: str
    old: str
    new: str

    def __call__(self, bed: Bed) -> None:
        replaced(bed.path(self.name), self.old, self.new)


def add(name: str, end: str = "# a comment\n") -> Edit:
    """Add to the end of such a file."""
    return lambda bed: appended(bed.path(name), end)


def code(name: str) -> Edit:
    return add(f"vastflow/{name}", "\nNEW = 1\n")


def text(name: str, written: str) -> Edit:
    return lambda bed: bed.write(name, written)


def option(given: str) -> Edit:
    return lambda bed: bed.options.append(given)


MUST_NOT: Final[Mapping[str, Edit]] = {
    "nothing": lambda bed: None,
    "campaign: a comment": add("x.vast"),
    "campaign: a description": swap("x.vast", "  name: inv", "  description: x\n  name: inv"),
    "campaign: a family's name": swap("x.vast", "- name: room", "- name: hall"),
    "campaign: fewer runs": swap("x.vast", "runs: 2", "runs: 1"),
    "campaign: its folder's name": renamed_campaign,
    "campaign: oracles in another order": swap("x.vast", ASKED_JUDGE + ASKED_LOOK, ASKED_LOOK + ASKED_JUDGE),
    "campaign: a parameter's default written out": swap("x.vast", "runs: 2", "runs: 2\n  seed: 0"),
    "config file: its name in the campaign": lambda bed: (
        bed.replace("x.vast", "{program:", "{other:"),
        bed.replace("x.vast", "sut.program", "sut.other"),
    ),
    "oracle: a comment": add("judge.py"),
    "oracle: ends of lines": lambda bed: bed.file("judge.py").write_bytes(
        bed.file("judge.py").read_bytes().replace(b"\n", b"\r\n")
    ),
    "oracle: its time": lambda bed: os.utime(bed.file("judge.py"), (1, 1)),
    "helper: a comment": add("limits.py"),
    "producer: a comment": add("own.py"),
    "notebook: a comment": lambda bed: cell(bed, 1, "source", "most = 3  # runs"),
    "map: its picture's name": renamed_picture,
    "map: its picture's format": lambda bed: bed.file("maps/room.pgm").write_bytes(b"P5 4 4 255\n" + b"\xfe" * 16),
    "map: another beside it": text("maps/other.yaml", "{}"),
    "vastflow: a comment in the simulator": add("vastflow/sim/run.py"),
    "vastflow: code of the command line": code("flows/api.py"),
    "vastflow: code of the report": code("oracles/page/report.py"),
    "vastflow: code of an oracle that is not asked": code("oracles/catalog/safety.py"),
    "vastflow: a hint in other words": swap("vastflow/sim/model/names.py", "did you", "do you"),
    "vastflow: a stray data file in a package": lambda bed: bed.source("sim/nav2/table.csv").write_text("1\n"),
    "vastflow: a stray report in a package": lambda bed: bed.source("oracles/report.html").write_text("<p>"),
    "vastflow: a scenario beside its own that nobody names": lambda bed: shutil.copy(
        bed.file("drive.osc"), bed.source("campaigns/scenarios/mine.osc")
    ),
    "a scenario beside that nobody names": text("mine.osc", "scenario mine:\n    do wait elapsed(1s)\n"),
    "Numba's number of threads": lambda bed: bed.environment.update(NUMBA_NUM_THREADS="1"),
    "the locale": lambda bed: bed.environment.update(LC_ALL="C", LANG="de_DE.UTF-8"),
    "a library that is not used": option("--version=networkx=99.0"),
}

MUST: Final[Mapping[str, tuple[Edit, Counts]]] = {
    "campaign: more runs": (swap("x.vast", "runs: 2", "runs: 3"), executed(2)),
    "campaign: the seed": (swap("x.vast", "runs: 2", "runs: 2\n  seed: 1"), executed(RUNS)),
    "campaign: the timeout": (swap("x.vast", "timeout: 60", "timeout: 50"), executed(RUNS)),
    "campaign: a family is added": (
        swap("x.vast", "execution:", "  - name: other\n    parameters:\n      - value: '9'\nexecution:"),
        executed(2),
    ),
    "campaign: a producer's parameter": (swap("x.vast", "factor: 2", "factor: 3"), executed(RUNS, 1)),
    "campaign: a parameter that a producer reads": (swap("x.vast", "base: 1", "base: 4"), executed(RUNS, 1)),
    "campaign: an oracle's parameter": (swap("x.vast", "limit: 5", "limit: 6"), JUDGED),
    "campaign: an oracle is gone": (swap("x.vast", ASKED_LOOK, ""), GATHERED),
    "campaign: the other oracle is gone": (swap("x.vast", ASKED_JUDGE, ""), GATHERED),
    "campaign: an oracle of vastflow's own is added": (
        swap("x.vast", ASKED_LOOK, ASKED_LOOK + "    - safety: {}\n"),
        GATHERED,
    ),
    "campaign: an oracle is added": (
        lambda bed: (
            shutil.copy(bed.file("judge.py"), bed.file("other.py")),
            bed.replace("x.vast", ASKED_JUDGE, "    - other.py:Judge: {limit: 5}\n" + ASKED_JUDGE),
        ),
        JUDGED,
    ),
    "campaign: an oracle is gone, and a parameter of the other": (
        swap("x.vast", ASKED_JUDGE + ASKED_LOOK, ASKED_JUDGE.replace("5", "6")),
        JUDGED,
    ),
    "config file: a parameter in the campaign": (swap("x.vast", "gain: 2", "gain: 3"), executed(RUNS)),
    "config file: its other parameter": (swap("program.yaml", "other: 1", "other: 2"), executed(RUNS)),
    "program: its text": (add("program.py"), executed(RUNS)),
    "scenario: its text": (swap("drive.osc", "timeout(60s)", "timeout(50s)"), executed(RUNS)),
    "producer: code": (swap("own.py", "offset + self", "2 * offset + self"), EVALUATED),
    "producer's helper: one of two values": (text("values.py", "VALUES = [1, 3]\n"), executed(2, 1)),
    "producer's data": (text("offset.txt", "5"), executed(RUNS, 1)),
    "map: a pixel": (swap("maps/room.pgm", "254", "0"), EVALUATED),
    "map: its resolution": (swap("maps/room.yaml", "0.05", "0.1"), EVALUATED),
    "oracle: code": (swap("judge.py", "+ LOWEST", "- LOWEST"), JUDGED),
    "oracle: its file's name": (
        lambda bed: (
            bed.file("judge.py").rename(bed.file("judges.py")),
            bed.replace("x.vast", "judge.py", "judges.py"),
        ),
        JUDGED,
    ),
    "oracle: its data": (text("data/table.txt", "2"), JUDGED),
    "helper: a constant": (text("limits.py", "HIGHEST = 4\n"), JUDGED),
    "package: a constant of a module's module": (text("lib/deeper.py", "DEEP = 2\n"), JUDGED),
    "campaign: the notebook's parameter": (swap("x.vast", "most: 7", "most: 8"), LOOKED),
    "notebook: code": (lambda bed: cell(bed, 1, "source", "most = 4"), LOOKED),
    "notebook: its data": (text("look.txt", "2"), LOOKED),
    "the version of what an oracle imports": (option("--version=httpx=99.0"), JUDGED),
    "the version of numpy": (option("--version=numpy=99.0"), executed(RUNS, 1)),
    "Python's minor version": (option("--python=3.99"), NOTHING),
    "a setting of Numba that changes code": (lambda bed: bed.environment.update(NUMBA_OPT="0"), executed(RUNS, 1)),
    "vastflow: code of the simulator": (code("sim/run.py"), executed(RUNS)),
    "vastflow: a kernel of a controller": (code("sim/nav2/controllers/dwb_critics.py"), executed(RUNS)),
    "vastflow: an oracle's default value": (
        swap("vastflow/oracles/catalog/success.py", "allow_missed: bool = False", "allow_missed: bool = True"),
        GATHERED,
    ),
    "the version of numba": (option("--version=numba=99.0"), executed(RUNS, 1)),
    "vastflow: code of the observing": (code("oracles/observation/observe.py"), {**NOTHING, "observed": BLOCKS}),
    "vastflow: code of the judging": (code("oracles/judgment/judge.py"), {**JUDGED, "looked": RUNS}),
    "vastflow: what every producer extends": (code("producers/model/producer.py"), EVALUATED),
    "a damaged artifact": (
        lambda bed: next((bed.folder / "store" / "judge").glob("*/*/verdicts.json")).write_text("[]"),
        ONE_BLOCK,
    ),
}

ROBOT: Final[Mapping[str, tuple[Edit, Counts]]] = {
    "nothing": (lambda bed: None, KEPT),
    "a hint of the parameters' reader in other words": (
        swap("vastflow/sim/nav2/parameters/amcl.py", "model is not Omni", "model is another than Omni"),
        KEPT,
    ),
    "its Nav2 file: a comment": (add("nav2.yaml"), KEPT),
    "its Nav2 file: a default value written out": (swap("nav2.yaml", "alpha1: 0.3", "alpha1: 0.3, alpha2: 0.2"), KEPT),
    "its Nav2 file: a node that is not simulated": (add("nav2.yaml", "other:\n  ros__parameters: {rate: 3}\n"), KEPT),
    "its Nav2 file: another value": (swap("nav2.yaml", "alpha1: 0.3", "alpha1: 0.31"), DRIVEN),
    "a default value that Nav2's code declares of a parameter that it leaves out": (
        swap("vastflow/sim/nav2/parameter_files/declared.txt", "alpha3=0.2@", "alpha3=0.21@"),
        DRIVEN,
    ),
    "a default value that counts without a file only": (
        swap("vastflow/sim/nav2/parameters/amcl.py", "alpha3: float = parameter(0.2", "alpha3: float = parameter(0.21"),
        KEPT,
    ),
    "its map: a pixel": (swap("maps/hall.pgm", "254", "0"), DRIVEN),
    "its goal": (swap("driven.vast", "x: 1.4", "x: 1.5"), DRIVEN),
}
"""Edits of the campaign in which a robot drives, and how many of its runs must be executed again."""

MEANWHILE: Final[Mapping[str, Edit]] = {
    "oracle: code": swap("judge.py", "+ LOWEST", "- LOWEST"),
    "helper: a constant": text("limits.py", "HIGHEST = 4\n"),
    "notebook: code": lambda bed: cell(bed, 1, "source", "most = 4"),
    "producer's helper": text("values.py", "VALUES = [5]\n"),
    "all of the plug-ins are gone": lambda bed: [
        file.unlink() for file in bed.file("").rglob("*.py") if file.name != "program.py"
    ],
}
"""Edits while the campaign runs: nothing of it changes."""


def rows(folder: Path, chosen: Callable[[str], bool] = lambda edit: True) -> Iterator[tuple[str, Counts, str]]:
    """Make the chosen edits: each one's name, what it computed again, and what is wrong."""
    pristine, bed = Bed.made(folder / "pristine"), Bed(folder / "bed")
    first = pristine.counted()
    yield "first of all", first, _wrong(pristine, first, ALL)
    said = verdicts(pristine)
    robot = {f"robot: {name}": row for name, row in ROBOT.items() if chosen(f"robot: {name}")}
    for name, (edit, counts) in {**{name: (edit, NOTHING) for name, edit in MUST_NOT.items()}, **MUST, **robot}.items():
        if name in robot and pristine.vast != "driven.vast":
            pristine.vast = "driven.vast"
            first = pristine.counted()
            yield "robot: first of all", first, _wrong(pristine, first, {"executed": DRIVES})
        if chosen(name):
            bed.restored(pristine.folder)
            bed.vast = pristine.vast
            edit(bed)
            found = bed.counted()
            yield name, found, _wrong(bed, found, counts)
    for name, edit in MEANWHILE.items():
        if chosen(f"meanwhile: {name}"):
            bed.restored(pristine.folder)
            for stage in ("evaluate", "execute", "observe", "judge"):
                shutil.rmtree(bed.folder / "store" / stage, ignore_errors=True)
            bed.meanwhile = edit
            found = bed.counted()
            other = "" if verdicts(bed) == said else "verdicts are others than those of what was keyed"
            yield f"meanwhile: {name}", found, _wrong(bed, found, ALL) or other


def _wrong(bed: Bed, found: Counts, expected: Counts) -> str:
    other = [f"{name} {found[name]}, not {count}" for name, count in expected.items() if found[name] != count]
    return "; ".join([*other, *dict.fromkeys(bed.broken)])


def main() -> None:
    """Print the table; exit code 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="edits with these words in their names")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory(prefix="vastflow-invalidation-") as folder:
        for edit, counts, wrong in rows(Path(folder), lambda edit: asked.only in edit):
            found.append({"edit": edit, **counts, "wrong": wrong})
            if not asked.json:
                print(f"{edit:<55}" + "".join(f"{counts[name]:>4}" for name in COUNTED), wrong, flush=True)
    n_wrong = sum(bool(row["wrong"]) for row in found)
    print(json.dumps(found) if asked.json else f"{len(found) - 1} edits, {n_wrong} of them wrong")
    sys.exit(1 if n_wrong else 0)


if __name__ == "__main__":
    main()
