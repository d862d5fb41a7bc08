"""Mutants of whatever users hand in: each is read, or refused in a sentence; nothing else ever happens.

Files are mutated by bytes, lines, tokens, and trees, tables by columns, or replaced by attacks: deep, large, growing by aliases, a pipe,
a device, a link in a circle. Each mutant is read in a process that reads many and is watched from outside. A command's exit code is 0 or
1, or 2 with the place named on stderr. An explorer replies to the list and three addresses of a mutant, drawn by its number, without
a failure, and goes on listing and opening the campaign beside it. Whoever raises, ends by a signal, computes for more than 10 s, allocates more than 2 GB, or does not
answer is a violation.

A mutant follows from the seed, its kind and its number, so `--kind "campaign file" --first 4711 --mutants 1` is that one again.

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
import warnings
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from mutants import Kind, laid_out

MOST_CPU_S = 10.0
MOST_WALL_S = 120.0
"""For what waits without computing; the machine may be busy."""
MOST_BYTES = 2 * 2**30


@dataclass
class Count:
    """Outcomes of the mutants of one kind."""

    accepted: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    cpu_s: float = 0.0
    violations: list[str] = field(default_factory=list)

    def add(self, mutant: str, word: str, cpu_s: float) -> None:
        """Count an answer: `accepted`, `refused`, or what was wrong."""
        self.slowest_s, self.cpu_s = max(self.slowest_s, cpu_s), self.cpu_s + cpu_s
        if cpu_s > MOST_CPU_S:
            word = f"{word} after {cpu_s:.1f} CPU-s"
        if word in ("accepted", "refused"):
            setattr(self, word, getattr(self, word) + 1)
        else:
            self.violations.append(f"{mutant}: {word}")


def answers(name: str, kind: Kind, numbers: range, seed: int, sender: Connection) -> None:
    """Read mutants one after the other, and send the answer and the CPU time of each."""
    warnings.simplefilter("ignore")
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
    for number in numbers:
        begun_s = time.process_time()
        try:
            word = kind.answer(random.Random(f"{seed} {name} {number}"))
        except Exception as error:  # noqa: BLE001 - which is the violation that is looked for
            word = f"{type(error).__name__}: {error}"[:300]
        sender.send((word, time.process_time() - begun_s))


def watched(name: str, kind: Kind, numbers: range, seed: int) -> Count:
    """Count the answers of processes under supervision; one that ends or waits is replaced."""
    count, fork = Count(), multiprocessing.get_context("fork")
    while numbers:
        receiver, sender = fork.Pipe(duplex=False)
        child = fork.Process(target=answers, args=(name, kind, numbers, seed, sender))
        child.start()
        sender.close()
        number = numbers.start
        try:
            for number in numbers:
                if not receiver.poll(MOST_WALL_S):
                    child.kill()
                count.add(f"{name} {number}", *receiver.recv())
        except EOFError:
            child.join()
            count.add(f"{name} {number}", f"no answer, the process ended with {child.exitcode}", 0.0)
        child.join()
        numbers = range(number + 1, numbers.stop)
    return count


def main() -> int:
    """Fuzz, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", default=[])
    parser.add_argument("--mutants", type=int, default=3_000)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    n_violations = 0
    with tempfile.TemporaryDirectory(prefix="vastflow-fuzz-") as folder:
        os.environ["VASTFLOW_STORE"] = f"{folder}/store"
        kinds = laid_out(Path(folder))
        if unknown := {*asked.kind} - {*kinds}:
            parser.error(f"--kind: expected one of {', '.join(kinds)}, got {', '.join(unknown)}")
        for name in asked.kind or kinds:
            count = watched(name, kinds[name], range(asked.first, asked.first + asked.mutants), asked.seed)
            n_violations += len(count.violations)
            print(
                f"{name:20} {asked.mutants:6,} mutants, {count.accepted:6,} accepted, {count.refused:6,} refused, "
                f"{len(count.violations)} violations; {count.cpu_s:.0f} CPU-s, slowest {count.slowest_s:.2f}",
                *count.violations,
                sep="\n",
                flush=True,
            )
    return int(n_violations > 0)


if __name__ == "__main__":
    sys.exit(main())
