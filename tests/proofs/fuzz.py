"""Mutants of every kind of file: each is accepted or refused with file and place; nothing else ever happens.

Seeds are the shipped campaigns and small probes that have a bit of everything. Mutants change bytes, tokens, lines, and the tree of
what a file says; some are attacks: deep, large, or growing by aliases. Each is read

- in a process that reads many (`--mutants`), which is watched from outside: whoever ends by a signal, computes for more than 10 s
  or allocates more than 1 GB is caught; a mutant is accepted, or the reader raises its own error and that names the file;
- by a command in a process of its own (`--commands`): the exit code is 0, or 2 with the file named on stderr, without a
  traceback.

A mutant follows from the seed, its kind and its number, so `--kind vast --first 4711 --mutants 1` is that one again.

    python tests/proofs/fuzz.py [--seed N] [--kind KIND ...] [--mutants N] [--commands N] [--first N]

Prints a line for each kind, and each violation; exit code 1 when there is one.
"""

import argparse
import contextlib
import mmap
import os
import random
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parent))
from fuzz_kinds import Kind, is_named, kinds, laid_out, placed, text_of
from fuzz_mutants import mutated

__all__ = ["replace"]

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

    def add(self, word: str, cpu_s: float) -> None:
        """Count an answer: `accepted`, `refused`, or what was wrong."""
        self.slowest_s = max(self.slowest_s, cpu_s)
        if word in ("accepted", "refused"):
            setattr(self, word, getattr(self, word) + 1)
        else:
            self.violations.append(word)


def made(kind: Kind, number: int, seed: int, folder: Path) -> Path:
    """Write mutant `number` of a kind."""
    rng = random.Random(f"{seed} {kind.name} {number}")
    of = rng.choice(kind.seeds)
    return placed(kind, of, mutated(of.read_bytes(), kind.mutators, rng), folder)


def answer(kind: Kind, file: Path) -> str:
    """Outcome of reading one mutant."""
    try:
        kind.read(file)
    except kind.refusals as error:
        return "refused" if is_named(str(error), file) else f"the refusal does not name the file: {str(error)[:300]}"
    except BaseException:  # noqa: BLE001 - whatever it is, it is what is looked for
        lines = traceback.format_exc().splitlines()
        return " | ".join(line.strip() for line in lines[-5:])[:600]
    return "accepted"


def read_here(kind: Kind, numbers: range, seed: int, folder: Path) -> Iterator[tuple[int, str, float]]:
    """Read mutants one after the other in this process; number, answer and CPU time of each."""
    for number in numbers:
        file = made(kind, number, seed, folder)
        begun_s = time.process_time()
        found = answer(kind, file)
        yield number, found, time.process_time() - begun_s


def watched(kind: Kind, numbers: range, seed: int, folder: Path) -> Count:
    """Read mutants as `read_here` does, in processes under supervision."""
    count = Count()
    next_number = numbers.start
    while next_number < numbers.stop:
        board = mmap.mmap(-1, 16)
        with tempfile.TemporaryFile() as answers:
            child = os.fork()
            if child == 0:
                _child(kind, range(next_number, numbers.stop), seed, folder, board, answers.fileno())
            ended = _attended(child, board, next_number)
            last = next_number - 1
            for line in text_of(answers).splitlines():
                number, cpu_s, said = line.split("\t", 2)
                last = int(number)
                count.add(said if said in ("accepted", "refused") else f"{kind.name} {number}: {said}", float(cpu_s))
            if ended:
                last += 1
                count.add(f"{kind.name} {last}: {ended}", 0.0)
            next_number = last + 1 if ended else numbers.stop
    return count


def _child(kind: Kind, numbers: range, seed: int, folder: Path, board: mmap.mmap, answers: int) -> None:
    """Read mutants and write a line for each; never returns."""
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    board[:16] = struct.pack("qd", numbers.start, time.process_time())
    code = 3
    try:
        for number, said, cpu_s in read_here(kind, numbers, seed, folder):
            if cpu_s > MOST_CPU_S:
                said = f"{cpu_s:.1f} CPU-s"
            os.write(answers, f"{number}\t{cpu_s:.3f}\t{' '.join(said.split())}\n".encode(errors="replace"))
            board[:16] = struct.pack("qd", number + 1, time.process_time())
        code = 0
    finally:
        os._exit(code)  # whatever it raises: what the parent does at its end is not for a child


def _attended(child: int, board: mmap.mmap, first: int) -> str | None:
    """Wait for a child; how it ended where it did not end well."""
    number, since_s = first, time.monotonic()
    process = psutil.Process(child)
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return None if code == 0 else f"the process ended with {code}"
        now, begun_cpu_s = struct.unpack("qd", board[:16])
        if now != number:
            number, since_s = now, time.monotonic()
        cpu_s = sum(process.cpu_times()[:2]) - begun_cpu_s
        waited_s = time.monotonic() - since_s
        if (waited_s > MOST_CPU_S and cpu_s > MOST_CPU_S) or waited_s > MOST_WALL_S:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return f"no answer after {cpu_s:.0f} CPU-s and {waited_s:.0f} s"
        time.sleep(0.05)


def commanded(kind: Kind, numbers: range, seed: int, folder: Path) -> Count:
    """Read mutants by a command each, in a process of its own that begins with everything imported."""
    count = Count()
    for number in numbers:
        file = made(kind, number, seed, folder)
        arguments = kind.command(file, random.Random(number))
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            begun_s = time.monotonic()
            child = os.fork()
            if child == 0:
                try:
                    _command(arguments, out.fileno(), err.fileno())
                finally:
                    os._exit(1)  # whatever it raises: what the parent does at its end is not for a child
            code, used = _waited(child, begun_s)
            said, cpu_s = text_of(err), used.ru_utime + used.ru_stime
        wrong = None
        if code not in (0, 2):
            wrong = f"exit code {code}: {said[-300:]}"
        elif "Traceback" in said:
            wrong = f"a traceback: {said[-300:]}"
        elif code == 2 and not is_named(said, file):
            wrong = f"the refusal does not name the file: {said[:300]}"
        elif cpu_s > MOST_CPU_S:
            wrong = f"{cpu_s:.1f} CPU-s"
        word = "accepted" if code == 0 else "refused"
        count.add(
            f"{kind.name} {number} (vastflow {' '.join(arguments)}): {' '.join(wrong.split())}" if wrong else word,
            cpu_s,
        )
    return count


def _command(arguments: list[str], out: int, err: int) -> None:
    """Be `vastflow`; never returns."""
    os.dup2(out, 1)
    os.dup2(err, 2)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", errors="backslashreplace", closefd=False)  # noqa: SIM115 - as Python's own
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (15, 20))
    sys.argv = ["vastflow", *arguments]
    code = 0
    try:
        from vastflow.flows.cli.__main__ import main

        main()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 0 if error.code is None else 1
    except BaseException:  # noqa: BLE001 - as Python's own end does
        traceback.print_exc()
        code = 1
    with contextlib.suppress(Exception):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def _waited(child: int, begun_s: float) -> tuple[int, resource.struct_rusage]:
    while True:
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status), used
        if time.monotonic() - begun_s > MOST_WALL_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)


def main() -> int:
    """Fuzz, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", default=[])
    parser.add_argument("--mutants", type=int, default=10_000)
    parser.add_argument("--commands", type=int, default=300)
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
            for how, read, n in (("in process", watched, asked.mutants), ("by command", commanded, asked.commands)):
                begun_s = time.monotonic()
                count = read(kind, range(asked.first, asked.first + n), asked.seed, folder)
                n_violations += len(count.violations)
                print(
                    f"{kind.name:10} {how}: {n:6,} mutants, {count.accepted:6,} accepted, {count.refused:6,} refused, "
                    f"{len(count.violations)} violations; slowest {count.slowest_s:.2f} CPU-s; {time.monotonic() - begun_s:.0f} s",
                    flush=True,
                )
                print(*count.violations, sep="\n", end="\n" * bool(count.violations), flush=True)
    return int(n_violations > 0)


if __name__ == "__main__":
    sys.exit(main())
