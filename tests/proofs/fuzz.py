"""Mutants of every kind of file: each is accepted or refused with file and place; nothing else ever happens.

Seeds are the shipped campaigns and small probes that have a bit of everything. Mutants change bytes, tokens, lines, and the tree of
what a file says; some are attacks: deep, large, or growing by aliases. Each is read by a command of vastflow in a process that reads
many and is watched from outside. The exit code is 0, or 2 with the file named on stderr; whoever raises, ends by a signal, computes
for more than 10 s, allocates more than 1 GB, or does not answer is caught.

A mutant follows from the seed, its kind and its number, so `--kind vast --first 4711 --mutants 1` is that one again.

    python tests/proofs/fuzz.py [--seed N] [--kind KIND ...] [--mutants N] [--first N]

Prints a line for each kind, and each violation; exit code 1 when there is one.
"""

import argparse
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import psutil
from fuzz_kinds import Kind, is_named, kinds, laid_out, placed
from fuzz_mutants import mutated
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app

MOST_CPU_S = 10.0
MOST_WALL_S = 120.0
"""For what waits without computing; the machine may be busy."""
MOST_BYTES = 2**30


@dataclass
class Count:
    """Outcomes of the mutants of one kind."""

    accepted: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    violations: list[str] = field(default_factory=list)

    def add(self, mutant: str, word: str, cpu_s: float) -> None:
        """Count an answer: `accepted`, `refused`, or what was wrong."""
        self.slowest_s = max(self.slowest_s, cpu_s)
        if cpu_s > MOST_CPU_S:
            word = f"{word} after {cpu_s:.1f} CPU-s"
        if word in ("accepted", "refused"):
            setattr(self, word, getattr(self, word) + 1)
        else:
            self.violations.append(f"{mutant}: {word}")


def answer(file: Path, arguments: list[str]) -> str:
    """Outcome of reading one mutant by a command."""
    result = CliRunner().invoke(app, arguments)
    said = " ".join(result.stderr.split())
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return " | ".join(line.strip() for line in traceback.format_exception(result.exception)[-3:])[-600:]
    if result.exit_code not in (0, 2) or "Traceback" in said:
        return f"exit code {result.exit_code}: {said[-300:]}"
    if result.exit_code == 2 and not is_named(said, file):
        return f"the refusal does not name the file: {said[:300]}"
    return "refused" if result.exit_code else "accepted"


def read_here(kind: Kind, numbers: range, seed: int, folder: Path) -> Iterator[tuple[str, float]]:
    """Read mutants one after the other in this process; answer and CPU time of each."""
    for number in numbers:
        rng = random.Random(f"{seed} {kind.name} {number}")
        of = rng.choice(kind.seeds)
        file = placed(kind, of, mutated(of.read_bytes(), kind.mutators, rng), folder)
        begun_s = time.process_time()
        found = answer(file, kind.command(file, rng))
        yield found, time.process_time() - begun_s


def _read_and_send(kind: Kind, numbers: range, seed: int, folder: Path, answers: Connection) -> None:
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
    for each in read_here(kind, numbers, seed, folder):
        answers.send(each)


def watched(kind: Kind, numbers: range, seed: int, folder: Path) -> Count:
    """Read mutants as `read_here` does, in processes under supervision."""
    count, fork = Count(), multiprocessing.get_context("fork")
    while numbers:
        receiver, sender = fork.Pipe(duplex=False)
        child = fork.Process(target=_read_and_send, args=(kind, numbers, seed, folder, sender))
        child.start()
        sender.close()
        try:
            for number in numbers:
                if not receiver.poll(MOST_WALL_S):
                    child.kill()
                count.add(f"{kind.name} {number}", *receiver.recv())
        except EOFError:
            child.join()
            count.add(f"{kind.name} {number}", f"no answer, the process ended with {child.exitcode}", 0.0)
        child.join()
        numbers = range(number + 1, numbers.stop)
    return count


def main() -> int:
    """Fuzz, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", default=[])
    parser.add_argument("--mutants", type=int, default=2_000)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    n_violations = 0
    with tempfile.TemporaryDirectory(prefix="vastflow-fuzz-") as name:
        folder = Path(name)
        os.environ["VASTFLOW_STORE"] = str(folder / "store")
        laid_out(folder)
        for kind in kinds(folder):
            if asked.kind and kind.name not in asked.kind:
                continue
            count = watched(kind, range(asked.first, asked.first + asked.mutants), asked.seed, folder)
            n_violations += len(count.violations)
            print(
                f"{kind.name:10} {asked.mutants:6,} mutants, {count.accepted:6,} accepted, {count.refused:6,} refused, "
                f"{len(count.violations)} violations; slowest {count.slowest_s:.2f} CPU-s",
                *count.violations,
                sep="\n",
                flush=True,
            )
    return int(n_violations > 0)


if __name__ == "__main__":
    sys.exit(main())
