"""Estimate the share of defects that quick tests find: mutants drawn by chance, one operator, constant, or branch each.

Half of them are drawn in kernels, the others in the rest of `sim`, `producers`, `oracles/statistics`, and `tasks/keys`. Tests of the mutated folder run
first, those that import the mutated module before the others, until the first that fails. With `--all`, those that survive meet the rest of the quick tests.

    python tests/proofs/mutants_by_chance.py [--count 100] [--seed 1] [--all] FILE

FILE gets a line of JSON for each mutant; those that it has already are not run again. Exit code 0: the share is a figure, not a promise.
A mutant that doesn't compile, and one that leaves the module as it was, are no mutants and are drawn again.
"""

import argparse
import ast
import json
import os
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from robot_mutants import NO_FINDING, ROOT, copied

from vastflow.oracles.statistics.intervals import wilson_intervals

PLACES: Final = {"sim": "sim", "producers": "producers", "oracles/statistics": "oracles", "tasks/keys": "tasks"}
"""Folders that mutants are drawn in, to the folder of their tests."""
KERNEL: Final = {"njit", "inner", "addressed", "kernel"}
TIMEOUT_S: Final = 600
"""Timeout of one test. A mutant that never ends counts as found: nobody would overlook it."""

COMPARED: Final[dict[type[ast.cmpop], str]] = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.In: "not in", ast.NotIn: "in",
    ast.Is: "is not", ast.IsNot: "is",
}  # fmt: skip
COMPUTED: Final[dict[type[ast.operator], str]] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.FloorDiv: "*",
}


class Mutant(NamedTuple):
    """A replacement of what lies between two offsets of a file."""

    file: str
    line: int
    start: int
    end: int
    new: str
    in_kernel: bool

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.new.encode() + source[self.end :]


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield each mutant of the functions of a module."""
    source = file.read_bytes()
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))

    def span(node: Any) -> tuple[int, int]:
        return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

    def between(left: ast.expr, right: ast.expr, new: str) -> Iterator[tuple[tuple[int, int], str]]:
        start, end = span(left)[1], span(right)[0]
        if not set(source[start:end]) & set(b"()#"):
            yield (start, end), f" {new} "

    def changes(node: ast.AST) -> Iterator[tuple[tuple[int, int], str]]:
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in COMPARED:
                yield from between(left, right, COMPARED[type(op)])
            case ast.BinOp(left=left, op=op, right=right) if type(op) in COMPUTED:
                yield from between(left, right, COMPUTED[type(op)])
            case ast.BoolOp(op=op, values=[left, right]):
                yield from between(left, right, "or" if isinstance(op, ast.And) else "and")
            case ast.Constant(value=bool(value)):
                yield span(node), str(not value)
            case ast.Constant(value=int(value)):
                yield span(node), str(value + 1)
            case ast.Constant(value=float(value)):
                yield span(node), repr(value * 1.1 or 1.0)
            case ast.If(test=test) | ast.IfExp(test=test) | ast.While(test=test):
                yield span(test), f"(not ({source[slice(*span(test))].decode()}))"
            case _:
                pass

    def walk(node: ast.AST, in_kernel: bool, in_function: bool) -> Iterator[Mutant]:
        if isinstance(node, ast.FunctionDef):
            in_function, in_kernel = (
                True,
                in_kernel or any(isinstance(d, ast.Name) and d.id in KERNEL for d in node.decorator_list),
            )
        if in_function:
            for (start, end), new in changes(node):
                if source[start:end].strip() != new.strip().encode():
                    yield Mutant(file.relative_to(ROOT).as_posix(), node.lineno, start, end, new, in_kernel)  # type: ignore[attr-defined]
        if isinstance(node, ast.FunctionDef):
            children: Sequence[ast.AST] = node.body  # neither annotations nor defaults
        elif isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert | ast.AnnAssign) and not getattr(
            node, "value", None
        ):
            return  # words, not results
        else:
            children = list(ast.iter_child_nodes(node))
        for child in children:
            yield from walk(child, in_kernel, in_function)

    yield from walk(ast.parse(source), False, False)


def drawn(seed: int) -> Iterator[Mutant]:
    """Yield mutants by chance, by turns in kernels and elsewhere."""
    every = [
        mutant
        for place in PLACES
        for file in sorted((ROOT / place).rglob("*.py"))
        if "conformance" not in file.name
        for mutant in mutants_of(file)
    ]
    chance = random.Random(seed)
    sides = [[mutant for mutant in every if mutant.in_kernel is side] for side in (True, False)]
    for side in sides:
        chance.shuffle(side)
    for pair in zip(*sides, strict=False):
        yield from pair


def tests_of(checkout: Path, mutant: Mutant) -> tuple[list[str], list[str]]:
    """Test files of the mutated folder, the nearest first, and all others."""
    place = next(tests for folder, tests in PLACES.items() if mutant.file.startswith(f"{folder}/"))
    module = "vastflow." + mutant.file.removesuffix(".py").replace("/", ".")

    def distance(file: Path) -> tuple[int, str]:
        text, stem = file.read_text(encoding="utf-8"), module.rpartition(".")[2]
        near = (
            module in text or re.search(rf"{re.escape(module.rpartition('.')[0])} import .*\b{stem}\b", text)
        ) is not None
        return (0 if near or stem in file.stem else 1 if module.rpartition(".")[0] in text else 2), file.name

    files = sorted(checkout.joinpath("tests").rglob("test_*.py"))
    own = sorted((file for file in files if file.relative_to(checkout / "tests").parts[0] == place), key=distance)
    return [str(file) for file in own], [str(file) for file in files if file not in own]


def run_tests(checkout: Path, tests: Sequence[str], home: Path) -> tuple[str, str, float]:
    """Return whether a mutant was `found`, `survived`, or is `none`, the test that found it, and CPU-seconds."""
    known = {
        **os.environ,
        "PYTHONPATH": str(checkout / ".package"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "XDG_CACHE_HOME": str(home),
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        "--tb=line",
        f"--timeout={TIMEOUT_S}",
        "--timeout-method=thread",  # a kernel that never ends takes no signals
        *tests,
    ]
    before_s = sum(os.times()[2:4])
    done = subprocess.run(command, cwd=checkout, env=known, check=False, capture_output=True, text=True)
    cpu_s = sum(os.times()[2:4]) - before_s
    if done.returncode == 0:
        return "survived", "", cpu_s
    if "Timeout" not in done.stdout and NO_FINDING.search(done.stdout):
        return "none", done.stdout[-300:], cpu_s
    failed = re.search(r"^(?:SUBFAILED|FAILED|ERROR)\S*(?:.*?\] )?\s*(\S+)", done.stdout, re.MULTILINE)
    return "found", failed[1] if failed else done.stdout[-300:], cpu_s


def main() -> int:
    """Append a line for each mutant, and print the share."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--all", action="store_true")
    asked = parser.parse_args()
    known = {}
    if asked.file.exists():
        known = {tuple(row["mutant"]): row for row in map(json.loads, asked.file.read_text().splitlines())}
    counted: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        checkout = copied(Path(folder))
        for mutant in drawn(asked.seed):
            row = known.get(tuple(mutant)) or {"mutant": mutant, "outcome": ""}
            if row["outcome"] == "" or (asked.all and row["outcome"] == "survived" and not row.get("all")):
                file, (own, others) = checkout / mutant.file, tests_of(checkout, mutant)
                source = file.read_bytes()
                file.write_bytes(mutant.applied(source))
                was, now = source[mutant.start : mutant.end].decode(), mutant.new
                shared = None if mutant.in_kernel else asked.file.absolute().with_suffix(".cache")
                with tempfile.TemporaryDirectory(prefix="home-") as own_cache:
                    home = shared or Path(own_cache)
                    outcome, test, cpu_s = ("survived", "", 0.0) if row["outcome"] else run_tests(checkout, own, home)
                    if asked.all and outcome == "survived":
                        outcome, test, more_s = run_tests(checkout, others, home)
                        cpu_s += more_s
                file.write_bytes(source)
                line = source.splitlines()[mutant.line - 1].decode().strip()
                row = {"mutant": mutant, "outcome": outcome, "test": test.replace(f"{checkout}/", ""), "cpu_s": round(row.get("cpu_s", 0) + cpu_s),
                       "all": asked.all, "line": line, "was": was, "now": now}  # fmt: skip
                with asked.file.open("a") as log:
                    log.write(json.dumps(row) + "\n")
                print(
                    f"{row['outcome']:9}{row['cpu_s']:5} s  {mutant.file}:{mutant.line}: {line!r}: {was!r} → {now!r}  {row['test']}",
                    flush=True,
                )
            counted += [row] if row["outcome"] != "none" else []
            if len(counted) == asked.count:
                break
    found = sum(row["outcome"] == "found" for row in counted)
    low, high = wilson_intervals([found], [len(counted)])[0]
    print(
        f"\n{found} of {len(counted)} found, {found / len(counted):.0%} ({low:.0%} to {high:.0%}); {sum(row['cpu_s'] for row in counted) / 60:.0f} CPU-min"
    )
    for row in counted:
        if row["outcome"] == "survived":
            print(f"- {row['mutant'][0]}:{row['mutant'][1]}: {row['line']}: {row['was']} → {row['now']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
