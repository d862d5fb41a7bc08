"""Count what each edit of a table computes again.

A campaign of everything that a key is made of, a producer, an oracle and a notebook of its own with helpers, a package and data files, a
map, a scenario file and a program, is computed once. Then, for each edit of the table, a copy of it and of vastflow's own
source is edited, and computed again over a copy of the store.

Counted is what happens, not what a key says: the program, the producer and the oracle write a line into a file each time they are
called; traces are counted as artifacts that are new. The table says of each edit what it must compute again, and what it must not.
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
JUDGED: Final[Mapping[str, int]] = {**NOTHING, "judged": RUNS}

Counts: TypeAlias = Mapping[str, int]


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


def in_binary(bed: Bed) -> None:
    """The same pixels in another format."""
    bed.file("maps/room.pgm").write_bytes(b"P5 4 4 255\n" + bytes([254] * 16))


def during(edit: Callable[[Bed], None]) -> Callable[[Bed], None]:
    """An edit while the campaign runs, all of whose results are lost so that it is computed."""

    def asked(bed: Bed) -> None:
        for stage in ("evaluate", "execute", "observe", "judge"):
            shutil.rmtree(bed.folder / "store" / stage, ignore_errors=True)
        bed.meanwhile = edit

    return asked


Edit: TypeAlias = Callable[[Bed], None]

MUST_NOT: Final[Mapping[str, Edit]] = {
    "nothing": lambda bed: None,
    "campaign: a comment": lambda bed: appended(bed.file("x.vast"), "# a comment\n"),
    "campaign: a description": lambda bed: bed.replace("x.vast", "  name: inv", "  description: x\n  name: inv"),
    "campaign: a family's name": lambda bed: bed.replace("x.vast", "- name: room", "- name: hall"),
    "campaign: fewer runs": lambda bed: bed.replace("x.vast", "runs: 2", "runs: 1"),
    "campaign: its folder's name": renamed_campaign,
    "campaign: a parameter's default written out": lambda bed: bed.replace("x.vast", "runs: 2", "runs: 2\n  seed: 0"),
    "oracle: a comment": lambda bed: appended(bed.file("judge.py"), "# a comment\n"),
    "oracle: a docstring": lambda bed: bed.replace("judge.py", '"""Judge."""', '"""Judge a run."""'),
    "oracle: no docstring": lambda bed: bed.replace("judge.py", '    """Judges."""\n', ""),
    "oracle: blank lines": lambda bed: bed.replace("judge.py", "\n\nclass", "\n\n\n\nclass"),
    "oracle: a line in two": lambda bed: bed.replace(
        "judge.py", "passed(trace, value", "passed(\n            trace, value"
    ),
    "oracle: ends of lines": lambda bed: bed.file("judge.py").write_bytes(
        bed.file("judge.py").read_bytes().replace(b"\n", b"\r\n")
    ),
    "oracle: its time": lambda bed: os.utime(bed.file("judge.py"), (1, 1)),
    "helper: a comment": lambda bed: appended(bed.file("limits.py"), "# a comment\n"),
    "helper: a docstring": lambda bed: bed.file("limits.py").write_text('"""Limits."""\nHIGHEST = 3\n'),
    "package: a comment": lambda bed: appended(bed.file("lib/deeper.py"), "# a comment\n"),
    "package: a module that is not used": lambda bed: bed.write("lib/unused.py", "UNUSED = 2\n"),
    "a module beside that is not used": lambda bed: bed.write("unused.py", "UNUSED = 2\n"),
    "a file beside that is not declared": lambda bed: bed.write("unused.txt", "2"),
    "producer: a comment": lambda bed: appended(bed.file("own.py"), "# a comment\n"),
    "producer's helper: a comment": lambda bed: appended(bed.file("values.py"), "# a comment\n"),
    "notebook: prose": lambda bed: cell(bed, 0, "source", "Looks closely."),
    "notebook: an output": lambda bed: cell(bed, 2, "outputs", [{"output_type": "stream", "text": "1"}]),
    "notebook: a comment": lambda bed: cell(bed, 1, "source", "most = 3  # runs"),
    "map: its picture's name": renamed_picture,
    "map: its picture's format": in_binary,
    "map: a comment in its header": lambda bed: appended(bed.file("maps/room.yaml"), "# a comment\n"),
    "map: another beside it": lambda bed: bed.write("maps/other.yaml", "{}"),
    "vastflow: a comment in the simulator": lambda bed: appended(bed.source("sim/run.py"), "# a comment\n"),
    "vastflow: a docstring of the judging": lambda bed: replaced(
        bed.source("oracles/judgement/judge.py"), '"""Judging: verdicts', '"""Judgement: verdicts'
    ),
    "vastflow: code of the command line": lambda bed: appended(bed.source("flows/api.py"), "\nNEW = 1\n"),
    "vastflow: code of the report": lambda bed: appended(bed.source("oracles/page/report.py"), "\nNEW = 1\n"),
    "vastflow: code of an oracle that is not asked": lambda bed: appended(
        bed.source("oracles/catalog/safety.py"), "\nNEW = 1\n"
    ),
    "vastflow: a hint in other words": lambda bed: replaced(bed.source("sim/model/names.py"), "did you", "do you"),
    "vastflow: a stray data file in a package": lambda bed: bed.source("sim/nav2/table.csv").write_text("1\n"),
    "vastflow: a stray report in a package": lambda bed: bed.source("oracles/report.html").write_text("<p>"),
    "vastflow: a scenario beside its own that nobody names": lambda bed: shutil.copy(
        bed.file("drive.osc"), bed.source("campaigns/scenarios/mine.osc")
    ),
    "a scenario beside that nobody names": lambda bed: bed.write(
        "mine.osc", "scenario mine:\n    do wait elapsed(1s)\n"
    ),
    "Numba's number of threads": lambda bed: bed.environment.update(NUMBA_NUM_THREADS="1"),
    "the locale": lambda bed: bed.environment.update(LC_ALL="C", LANG="de_DE.UTF-8"),
    "a library that is not used": lambda bed: bed.options.append("--version=networkx=99.0"),
}

MUST: Final[Mapping[str, tuple[Edit, Counts]]] = {
    "campaign: more runs": (lambda bed: bed.replace("x.vast", "runs: 2", "runs: 3"), executed(2)),
    "campaign: the seed": (lambda bed: bed.replace("x.vast", "runs: 2", "runs: 2\n  seed: 1"), executed(RUNS)),
    "campaign: the timeout": (lambda bed: bed.replace("x.vast", "timeout: 60", "timeout: 50"), executed(RUNS)),
    "campaign: a family is added": (
        lambda bed: bed.replace(
            "x.vast", "execution:", "  - name: other\n    parameters:\n      - value: '9'\nexecution:"
        ),
        executed(2),
    ),
    "campaign: a producer's parameter": (
        lambda bed: bed.replace("x.vast", "factor: 2", "factor: 3"),
        executed(RUNS, 1),
    ),
    "campaign: a parameter that a producer reads": (
        lambda bed: bed.replace("x.vast", "base: 1", "base: 4"),
        executed(RUNS, 1),
    ),
    "campaign: an oracle's parameter": (lambda bed: bed.replace("x.vast", "limit: 5", "limit: 6"), JUDGED),
    "campaign: an oracle is gone": (lambda bed: bed.replace("x.vast", "    - look.ipynb: {most: 7}\n", ""), JUDGED),
    "program: its text": (lambda bed: appended(bed.file("program.py"), "# a comment\n"), executed(RUNS)),
    "scenario: its text": (lambda bed: bed.replace("drive.osc", "timeout(60s)", "timeout(50s)"), executed(RUNS)),
    "producer: code": (
        lambda bed: bed.replace("own.py", "offset + self", "2 * offset + self"),
        {**NOTHING, "evaluated": 1},
    ),
    "producer's helper: one of two values": (
        lambda bed: bed.write("values.py", "VALUES = [1, 3]\n"),
        executed(2, 1),
    ),
    "producer's data": (lambda bed: bed.write("offset.txt", "5"), executed(RUNS, 1)),
    "map: a pixel": (lambda bed: bed.replace("maps/room.pgm", "254", "0"), {**NOTHING, "evaluated": 1}),
    "map: its resolution": (lambda bed: bed.replace("maps/room.yaml", "0.05", "0.1"), {**NOTHING, "evaluated": 1}),
    "oracle: code": (lambda bed: bed.replace("judge.py", "+ LOWEST", "- LOWEST"), JUDGED),
    "oracle: a sum that ends with its line": (
        lambda bed: bed.replace("judge.py", " + self.parameters.limit", "\n        +self.parameters.limit"),
        JUDGED,
    ),
    "oracle: its file's name": (
        lambda bed: (
            bed.file("judge.py").rename(bed.file("judges.py")),
            bed.replace("x.vast", "judge.py", "judges.py"),
        ),
        JUDGED,
    ),
    "oracle: its data": (lambda bed: bed.write("data/table.txt", "2"), JUDGED),
    "oracle: another file of its pattern": (lambda bed: bed.write("data/more.txt", "2"), JUDGED),
    "helper: a constant": (lambda bed: bed.write("limits.py", "HIGHEST = 4\n"), JUDGED),
    "package: a constant of a module's module": (lambda bed: bed.write("lib/deeper.py", "DEEP = 2\n"), JUDGED),
    "package: its first file": (lambda bed: bed.write("lib/__init__.py", "FIRST = 1\n"), JUDGED),
    "notebook: code": (lambda bed: cell(bed, 1, "source", "most = 4"), JUDGED),
    "notebook: its data": (lambda bed: bed.write("look.txt", "2"), JUDGED),
    "notebook: its parameter": (lambda bed: bed.replace("x.vast", "most: 7", "most: 8"), JUDGED),
    "the version of what an oracle imports": (lambda bed: bed.options.append("--version=httpx=99.0"), JUDGED),
    "the version of numpy": (lambda bed: bed.options.append("--version=numpy=99.0"), executed(RUNS, 1)),
    "Python's minor version": (lambda bed: bed.options.append("--python=3.99"), executed(RUNS, 1)),
    "a setting of Numba that changes code": (lambda bed: bed.environment.update(NUMBA_OPT="0"), executed(RUNS, 1)),
    "vastflow: code of the simulator": (lambda bed: appended(bed.source("sim/run.py"), "\nNEW = 1\n"), executed(RUNS)),
    "vastflow: a kernel of a controller": (
        lambda bed: appended(bed.source("sim/nav2/controllers/dwb_critics.py"), "\nNEW = 1\n"),
        executed(RUNS),
    ),
    "vastflow: an oracle's default value": (
        lambda bed: replaced(
            bed.source("oracles/catalog/success.py"), "allow_missed: bool = False", "allow_missed: bool = True"
        ),
        JUDGED,
    ),
    "the version of numba": (lambda bed: bed.options.append("--version=numba=99.0"), executed(RUNS, 1)),
    "vastflow: code of the observing": (
        lambda bed: appended(bed.source("oracles/observation/observe.py"), "\nNEW = 1\n"),
        {**NOTHING, "observed": BLOCKS},
    ),
    "vastflow: code of the judging": (
        lambda bed: appended(bed.source("oracles/judgement/judge.py"), "\nNEW = 1\n"),
        JUDGED,
    ),
    "vastflow: what every oracle extends": (
        lambda bed: appended(bed.source("oracles/judgement/oracle.py"), "\nNEW = 1\n"),
        JUDGED,
    ),
    "vastflow: what every producer extends": (
        lambda bed: appended(bed.source("producers/model/producer.py"), "\nNEW = 1\n"),
        {**NOTHING, "evaluated": 1},
    ),
    "a damaged artifact": (
        lambda bed: next((bed.folder / "store" / "judge").glob("*/*/verdicts.json")).write_text("[]"),
        {**NOTHING, "judged": RUNS // BLOCKS},
    ),
    "a copy of another artifact": (lambda bed: copied_verdicts(bed), {**NOTHING, "judged": RUNS // BLOCKS}),
}

ROBOT: Final[Mapping[str, tuple[Edit, int]]] = {
    "nothing": (lambda bed: None, 0),
    "a hint of the parameters' reader in other words": (
        lambda bed: replaced(bed.source("sim/nav2/parameters/amcl.py"), "must be <=", "has to be at most"),
        0,
    ),
    "a hint in other words": (lambda bed: replaced(bed.source("sim/model/names.py"), "did you", "do you"), 0),
    "its Nav2 file: a comment": (lambda bed: appended(bed.file("nav2.yaml"), "# a comment\n"), 0),
    "its Nav2 file: a default value written out": (
        lambda bed: bed.replace("nav2.yaml", "alpha1: 0.3", "alpha1: 0.3, alpha2: 0.2"),
        0,
    ),
    "its Nav2 file: a node that is not simulated": (
        lambda bed: appended(bed.file("nav2.yaml"), "other:\n  ros__parameters: {rate: 3}\n"),
        0,
    ),
    "its Nav2 file: another value": (lambda bed: bed.replace("nav2.yaml", "alpha1: 0.3", "alpha1: 0.31"), DRIVES),
    "a default value of a parameter that it leaves out": (
        lambda bed: replaced(
            bed.source("sim/nav2/parameters/amcl.py"), "alpha3: float = parameter(0.2", "alpha3: float = parameter(0.21"
        ),
        DRIVES,
    ),
    "its map: a pixel": (lambda bed: bed.replace("maps/hall.pgm", "254", "0"), DRIVES),
    "its goal": (lambda bed: bed.replace("driven.vast", "x: 1.4", "x: 1.5"), DRIVES),
}
"""Edits of the campaign in which a robot drives, and how many of its runs must be executed again."""

MEANWHILE: Final[Mapping[str, Edit]] = {
    "oracle: code": lambda bed: bed.replace("judge.py", "+ LOWEST", "- LOWEST"),
    "helper: a constant": lambda bed: bed.write("limits.py", "HIGHEST = 4\n"),
    "helper: it is gone": lambda bed: bed.file("limits.py").unlink(),
    "oracle's data: it is gone": lambda bed: bed.file("data/table.txt").unlink(),
    "notebook: code": lambda bed: cell(bed, 1, "source", "most = 4"),
    "producer's helper": lambda bed: bed.write("values.py", "VALUES = [5]\n"),
    "all of the plug-ins are gone": lambda bed: [
        file.unlink() for file in bed.file("").rglob("*.py") if file.name != "program.py"
    ],
}
"""Edits while the campaign runs: nothing of it changes."""


def copied_verdicts(bed: Bed) -> None:
    """The folder of one block's verdicts lies in another's place."""
    one, other, *_ = sorted((bed.folder / "store" / "judge").glob("*/*"))
    shutil.rmtree(one)
    shutil.copytree(other, one)


@dataclass(frozen=True)
class Row:
    """An edit, what it computed again, and what is wrong with that."""

    edit: str
    counts: Counts
    wrong: str


def rows(folder: Path, chosen: Callable[[str], bool] = lambda edit: True) -> Iterator[Row]:
    """Make every edit that is chosen by its name, in a folder of their own."""
    pristine = Bed.made(folder / "pristine")
    first = pristine.counted()
    yield Row("first of all", first, _wrong(pristine, first, {"evaluated": 1, "executed": RUNS, "judged": RUNS}))
    said = verdicts(pristine)
    bed = Bed(folder / "bed")
    expected: dict[str, tuple[Edit, Counts]] = {**{name: (edit, NOTHING) for name, edit in MUST_NOT.items()}, **MUST}
    for name, (edit, counts) in expected.items():
        if chosen(name):
            bed.restored(pristine.folder)
            edit(bed)
            found = bed.counted()
            yield Row(name, found, _wrong(bed, found, counts))
    yield from _driven(pristine, bed, {name: row for name, row in ROBOT.items() if chosen(f"robot: {name}")})
    for name, edit in MEANWHILE.items():
        if chosen(f"meanwhile: {name}"):
            bed.restored(pristine.folder)
            during(edit)(bed)
            found = bed.counted()
            wrong = _wrong(bed, found, {"evaluated": 1, "executed": RUNS, "judged": RUNS})
            other = "" if verdicts(bed) == said else "verdicts are others than those of what was keyed"
            yield Row(f"meanwhile: {name}", found, wrong or other)


def _driven(pristine: Bed, bed: Bed, edits: Mapping[str, tuple[Edit, int]]) -> Iterator[Row]:
    """Make edits of the campaign in which a robot drives."""
    if not edits:
        return
    pristine.vast = "driven.vast"
    first = pristine.counted()
    yield Row("robot: first of all", first, _wrong(pristine, first, {"executed": DRIVES}))
    for name, (edit, runs) in edits.items():
        bed.restored(pristine.folder)
        bed.vast = "driven.vast"
        edit(bed)
        found = bed.counted()
        yield Row(f"robot: {name}", found, _wrong(bed, found, {"executed": runs}))


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
        for row in rows(Path(folder), lambda edit: asked.only in edit):
            found.append(row)
            if not asked.json:
                print(f"{row.edit:<55}" + "".join(f"{row.counts[name]:>4}" for name in COUNTED), row.wrong, flush=True)
    wrong = [row for row in found if row.wrong]
    if asked.json:
        print(json.dumps([{"edit": row.edit, **row.counts, "wrong": row.wrong} for row in found]))
    else:
        print(f"{len(found) - 1} edits, {len(wrong)} of them wrong")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
