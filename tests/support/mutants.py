"""Mutants of every kind of file and directory that users hand in, and their readers."""

import copy
import hashlib
import json
import os
import platform
import random
import re
import shutil
import struct
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias
from unittest.mock import patch

import explored
import numpy as np
import pyarrow.parquet as pq
import yaml
from damages import EVENTS, KINDS, TEXTS, column_changed, of_another_kind, with_values
from explored import addresses_of, explorer_of, write_explored
from PIL import Image
from starlette.testclient import TestClient
from synthetic import walled_room, write_map
from typer.testing import CliRunner
from whole_directory import ConfigurationResult, write_results

from vastflow.deployments.explorer import server
from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.pages import Pages
from vastflow.deployments.explorer.run_page import KeptExecutions
from vastflow.flows.cli.__main__ import app
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.judgment.verdict import Metric, Verdict
from vastflow.sim.model.faults import UserError
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import open_store

Mutator: TypeAlias = Callable[[bytes, random.Random], bytes]
Command: TypeAlias = Callable[[Path, random.Random], Sequence[object]]
Reader: TypeAlias = Callable[[Path, random.Random], str]
"""Reads a directory, or a part of it by chance, and returns the outcome."""

ROOT: Final = Path(__file__).parents[2]
MOST_BYTES: Final = 2_000_000
TOKEN: Final = re.compile(r"[^\W\d]\w*|\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[ \t]+|.", re.DOTALL)
NUMBERS: Final = (
    *("0", "-1", "-0.0", "1e-9", "1e9", "1e308", "1e999", "1e999999", ".5", "3.", "007", "0x1F", "0b1", "1_000", "12:30:45"),
    *(".nan", ".inf", "-.inf", "NaN", "Infinity", "2024-13-45", "2024-01-01", "9" * 40, "9" * 5000, "1000000000", "٣", "65536"),
    *("2147483648", "9223372036854775808", "-9223372036854775809", "0.1", "100", "1000000"),
)  # fmt: skip
ODD: Final[tuple[Any, ...]] = (
    *(None, True, False, 0, -1, 10**9, 10**18, 10**400, 1e-300, 1e300, float("inf"), float("nan"), "", " ", "\0", "é", "\ud800"),
    *("../../etc/passwd", "/dev/zero", "/", ".", "~", "@goal_pose", "@", "${x}", "$x", "a.py:B", "x.ipynb", "*", "[", "%s", "{}", "\n"),
    *([], {}, [[]], [None], {"": 0}, {"a": {"b": {}}}, [1, "a", None], "x" * 5000, ["x"] * 2000, list(range(500))),
)  # fmt: skip
PIECES: Final = (
    *("&a ", "*a", "<<", "!!python/object:os.system", "!!binary", "!!set", "!!timestamp", "!x", "? ", ": ", "- ", "---\n", "...\n"),
    *("{", "}", "[", "]", ",", ":", "'", '"', "#", "%YAML 1.1\n", "\t", "\r", "\0", "\x85", "\u2028", "\ufeff", "\\", "@", "`", "null"),
)  # fmt: skip
BYTES: Final = (b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[31m", b"\r\n", *(bytes([byte]) for byte in range(256)))
INDENTATIONS: Final = tuple(b" " * number for number in (1, 2, 4, 300))


def edited(parts: Sequence[Any], odd: Sequence[Any], rng: random.Random) -> list[Any]:
    """Parts of which some are left out, doubled, moved, or joined by odd ones."""
    parts = list(parts)
    for _ in range(rng.choice((1, 1, 2, 5))):
        start, other = (rng.randrange(len(parts) + 1) for _ in range(2))
        stop = start + rng.choice((0, 1, 1, 2, 8, 60, 3000))
        block, strange = parts[start:stop], [rng.choice(odd)]
        alternatives = [], block * 2, block * 50, strange, strange + block, strange * 2000, parts[other : other + 1]
        parts[start:stop] = rng.choice(alternatives)
    return parts


def bytes_changed(content: bytes, rng: random.Random) -> bytes:
    return b"".join(edited([content[k : k + 1] for k in range(len(content))], BYTES, rng))


def lines_changed(content: bytes, rng: random.Random) -> bytes:
    return b"".join(edited(content.splitlines(keepends=True), INDENTATIONS, rng))


def tokens_changed(files: Sequence[Path]) -> Mutator:
    """Change tokens, also to those of other files, and numbers to odd ones."""
    words = *sorted({word for file in files for word in file.read_text().split()}), *PIECES

    def mutate(content: bytes, rng: random.Random) -> bytes:
        tokens = TOKEN.findall(content.decode("utf-8", "replace"))
        numbers = [k for k, token in enumerate(tokens) if token[0].isdigit()]
        if numbers and rng.random() < 0.3:
            tokens[rng.choice(numbers)] = rng.choice(NUMBERS)
        else:
            tokens = edited(tokens, words, rng)
        return "".join(tokens).encode("utf-8", "replace")

    return mutate


def tree_changed(read: Callable[[bytes], Any], write: Callable[[Any], str]) -> Mutator:
    """Replace, move, leave out, repeat, or wrap values of a tree of mappings and lists."""

    def mutate(content: bytes, rng: random.Random) -> bytes:
        try:
            tree = {"": read(content)}
        except Exception:  # noqa: BLE001 - a seed of which there is no tree
            return bytes_changed(content, rng)
        for _ in range(rng.choice((1, 1, 2, 4))):
            places = list(_places(tree))
            (holder, key), (other, name) = rng.choice(places), rng.choice(places)
            value, what = holder[key], rng.randrange(6)
            if what == 0 and holder is not tree:
                del holder[key]
            elif what == 1 and holder is not tree and isinstance(holder, dict):
                holder[rng.choice((*map(str, ODD[:8]), "zz"))] = holder.pop(key)
            elif what == 2:
                holder[key] = copy.deepcopy(other[name])
            elif what == 3:
                for _ in range(rng.choice((1, 3, 60, 150))):
                    holder[key] = rng.choice(([holder[key]], {"a": holder[key]}))
            elif what == 4 and type(value) in (int, float, list):
                holder[key] = value * rng.choice((0, 2, -1) if isinstance(value, list) else (-1, 0, 2, 1e6, 1e-6))
            else:
                holder[key] = copy.deepcopy(rng.choice(ODD))
        try:
            return write(tree[""]).encode("utf-8", "replace")
        except Exception:  # noqa: BLE001 - what no YAML or JSON can say
            return bytes_changed(content, rng)

    return mutate


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


yaml_tree: Final = tree_changed(yaml.safe_load, lambda tree: yaml.safe_dump(tree, sort_keys=False, allow_unicode=True))
json_tree: Final = tree_changed(json.loads, json.dumps)


def picture_changed(content: bytes, rng: random.Random) -> bytes:
    """Change sizes in a picture's header."""
    size = rng.choice((0, -1, 1, 20, 255, 5000, 65535, 70_000, 1_000_000, 2**31 - 1))
    if content[:1] == b"P":
        return content[:2] + b" %d %d 255\n" % (size, rng.choice((size, 20))) + content[12:]
    if content[:2] == b"BM":
        at = rng.choice((2, 10, 14, 18, 22, 26, 28, 30, 34, 46))
        return content[:at] + struct.pack("<i", size) + content[at + 4 :]
    at = 16 + 4 * rng.randrange(2)
    return content[:at] + struct.pack(">i", size) + content[at + 4 :]


def attack(content: bytes, rng: random.Random) -> bytes:
    """Return content built to be deep, large, or without end."""
    n = rng.choice((150, 3000, 100_000))
    nines = ", ".join(["*a%d"] * 9)
    deep = rng.choice((b"[", b"{a: ", b"- ", b"(", b"{", b'{"a":', b"? ", b"not ", b"-", b'[{"a":', b"!", b"&a ")) * n
    alternatives = (
        b"",
        deep,
        content + b"\n" + deep,
        b"\n".join(b"%*sa:" % (k % 1500, b"") for k in range(min(n, 1500))),
        b"\n".join(b"%*sserial:" % (4 * k, b"") for k in range(min(n, 600))),
        ("a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{nines % ((k - 1,) * 9)}]\n" for k in range(1, 30))).encode(),
        b"a0: &a0 {x: 1}\n" + b"".join(b"a%d: &a%d {<<: [*a%d, *a%d]}\n" % (k, k, k - 1, k - 1) for k in range(1, 40)),
        b"a: &a [*a]\n" + content,
        content.replace(b" ", b"\xc2\xa0"),
        content.decode("latin-1").encode("utf-16"),
        content * min(n // max(len(content), 1) + 1, 400),
        b'"' + b"a" * n + b'": ' + b"1" * n,
        rng.randbytes(min(n, 3000)),
        content.replace(b".", b"." + b"a." * min(n, 3000), 1),
        content.replace(b":", b":" + b" 1 +" * min(n, 3000), 1),
    )
    return rng.choice(alternatives)


class Kind(Protocol):
    """A kind of what users hand in, and its readers."""

    def answer(self, rng: random.Random) -> str:
        """Make a mutant and read it: `accepted`, `refused`, or what else came of it."""


def answer_of(command: Sequence[object], *named: str) -> str:
    """Return the outcome of a command; a refusal has to name one of the places."""
    result = CliRunner().invoke(app, [str(each) for each in command])
    said = " ".join(result.stderr.split())
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        lines = [line.strip() for line in traceback.format_exception(result.exception)[-3:]]
        return f"{command[0]}: {' | '.join(lines)[-600:]}"
    if result.exit_code not in (0, 1, 2) or "Traceback" in said:
        return f"{command[0]}: exit code {result.exit_code}: {said[-300:]}"
    if result.exit_code == 2 and not any(each in said for each in named):
        return f"{command[0]}: the refusal names none of {', '.join(named)}: {said[:300]}"
    return "refused" if result.exit_code else "accepted"


@dataclass(frozen=True)
class FileKind:
    """A kind of file that a command reads.

    Attributes:
        seeds: Files below the folder that mutants are made in.
        command: Arguments of vastflow for a mutant.
    """

    seeds: Sequence[Path]
    mutators: Sequence[Mutator]
    command: Command

    def answer(self, rng: random.Random) -> str:
        """Write a mutant where its seed's neighbors are, and read it by the command."""
        seed = rng.choice(self.seeds)
        file = seed.with_name(f"mutant{seed.suffix}")
        if file.is_dir() and not file.is_symlink():
            file.rmdir()
        file.unlink(missing_ok=True)
        if rng.random() < 0.02:
            of_another_kind(file, rng.choice(KINDS))
        else:
            file.write_bytes(_mutated(seed.read_bytes(), self.mutators, rng))
        return answer_of(self.command(file, rng), file.name)


def _mutated(content: bytes, mutators: Sequence[Mutator], rng: random.Random) -> bytes:
    mutate = attack if rng.random() < 0.06 else rng.choice(mutators)
    try:
        return mutate(content, rng)[:MOST_BYTES]
    except (RecursionError, MemoryError, ArithmeticError):  # too deep to be written, or too large to be multiplied
        return bytes_changed(content, rng)[:MOST_BYTES]


@dataclass(frozen=True)
class DirectoryKind:
    """Campaign directories, damaged in one place or some, which commands or an explorer read.

    Attributes:
        seed: A whole directory.
        readers: Return the outcome of reading a damaged copy.
    """

    seed: Path
    place: Path
    readers: Sequence[Reader]

    def answer(self, rng: random.Random) -> str:
        """Damage a copy of the seed, and give it to one of the readers."""
        shutil.rmtree(self.place, ignore_errors=True)
        self.place.mkdir()
        path = self.place / self.seed.name
        shutil.copytree(self.seed, path)
        self._damage(path, rng)
        return rng.choice(self.readers)(path, rng)

    def _damage(self, path: Path, rng: random.Random) -> None:
        files = [file for file in sorted(path.rglob("*")) if file.is_file()]
        tables = [file for file in files if file.suffix == ".parquet"]
        for k in range(rng.choice((1, 1, 1, 2))):
            if k:
                files = [file for file in files if file.is_file() and not file.is_symlink()]
                tables = [file for file in tables if file in files and is_table(file)]
                if not tables or path / "metadata.json" not in files or not is_json(path / "metadata.json"):
                    return
            what = rng.random()
            if what < 0.1:
                of_another_kind(rng.choice([*files, *{file.parent for file in files} - {path}]), rng.choice(KINDS))
            elif what < 0.55:
                column_changed(rng.choice(tables), rng)
            elif what < 0.75:
                with_values(path / "metadata.json", rng)
            else:
                file = rng.choice(files)
                changes = (bytes_changed, lines_changed, json_tree) if file.suffix == ".json" else (bytes_changed,)
                file.write_bytes(_mutated(file.read_bytes(), changes, rng))


@dataclass(frozen=True)
class EventsKind:
    """Folders of campaigns that run or were stopped, with events of which some are mutants."""

    place: Path
    reader: Reader

    def answer(self, rng: random.Random) -> str:
        """Write a folder of events, and read it."""
        shutil.rmtree(self.place, ignore_errors=True)
        path = self.place / f".office-2026-11-21-060000.{rng.choice(('running', 'partial'))}"
        path.mkdir(parents=True)
        seed = rng.choice(EVENTS)
        mutators = bytes_changed, lines_changed, lambda content, rng: content
        (path / "events.jsonl").write_bytes(_mutated(seed, mutators, rng) if len(seed) < 100_000 else seed)
        if rng.random() < 0.1:
            of_another_kind(path / rng.choice(("events.jsonl", ".writer.json", "stop.json")), rng.choice(KINDS))
        if rng.random() < 0.3 and not os.path.lexists(path / ".writer.json"):
            (path / ".writer.json").write_text(rng.choice((*TEXTS, json.dumps(rng.choice(WRITERS)))))
        return self.reader(path, rng)


WRITERS: Final = tuple(
    {"host": platform.node(), "pid": pid, "began_s": 1.0} for pid in (-1, 0, 2**31, 10**400, "1", None, [], 1.5)
)


@dataclass(frozen=True)
class ManifestKind:
    """Manifests of a store with a right checksum and any content, and damaged files of artifacts."""

    place: Path

    def answer(self, rng: random.Random) -> str:
        """Write a store whose artifact is damaged, look it up, and verify the store."""
        shutil.rmtree(self.place, ignore_errors=True)
        key = "execute/ab/abcd/0-3"
        open_store(self.place).put(key, {"a.bin": b"one"}, {"runs": [[0, 12.5]]})
        (manifest,) = (file for file in self.place.rglob("*") if file.name == "manifest")
        promise = manifest.read_bytes().partition(b"\n")[2]
        what = rng.random()
        if what < 0.1:
            of_another_kind(rng.choice((manifest, manifest.with_name("a.bin"))), rng.choice(KINDS))
        else:
            changed = (
                rng.choice(TEXTS).encode()
                if what < 0.3
                else _mutated(promise, (json_tree, json_tree, bytes_changed), rng)
            )
            right = hashlib.sha256(changed).hexdigest().encode() if rng.random() < 0.8 else b"0" * 64
            manifest.write_bytes(right + b"\n" + changed)
        try:
            found = open_store(self.place).find(key)
            if found is not None:
                found.info.get("runs")
        except UserError:
            pass
        except Exception as error:  # noqa: BLE001 - which is the violation that is looked for
            return f"find: {type(error).__name__}: {error}"[:300]
        return answer_of(("store", "verify", "--store", self.place), str(self.place))


def is_table(file: Path) -> bool:
    """True if a table can be read to be changed again."""
    try:
        return pq.ParquetFile(file).read().num_columns > 0
    except Exception:  # noqa: BLE001 - whatever is wrong with it
        return False


def is_json(file: Path) -> bool:
    """True if a file's JSON can be read to be changed again."""
    try:
        return isinstance(json.loads(file.read_bytes()), dict)
    except (ValueError, RecursionError):
        return False


@dataclass(frozen=True)
class Explorer:
    """Explores a folder of a whole campaign and of a damaged one.

    Attributes:
        roots: Folders of the whole campaign and of mutants.
    """

    whole: Path
    roots: Sequence[Path]

    def read(self, path: Path, rng: random.Random) -> str:
        """Ask for the list, some pages of the damaged directory, and those of its neighbor."""
        # `prepare` starts a process to execute runs in; explorers share templates; a client that is entered has one event loop.
        shared = patch.object(server, "Pages", lambda: PAGES)
        with patch.object(KeptExecutions, "prepare"), shared, explorer_of(*self.roots) as client:
            return self._read(client, path, rng)

    def _read(self, client: TestClient, path: Path, rng: random.Random) -> str:
        client.get("/", params={"token": explored.TOKEN})
        listed = {each.path: each for each in Directories(self.roots).all()}
        whole, codes = listed[self.whole], set()
        environment = next(iter(os.listdir(self.whole / "environments")))
        asked = [("/", {})]
        if path in listed:
            asked += rng.sample([*addresses_of(listed[path].id, whole.id, environment)], ASKED)
            if listed[path].state != "finished":
                asked.append(("/api/events", {"c": listed[path].id}))
        for address, query in [*asked, ("/campaign", {"c": whole.id})]:
            began_s = time.monotonic()
            reply = client.get(address, params=query)
            codes.add(reply.status_code)
            if reply.status_code >= 500:
                words = " ".join(re.sub("<[^>]*>", " ", reply.text).split())
                return f"{address}: {reply.status_code}: {words[-200:]}"
            if address == "/" and whole.id not in reply.text:
                return "the list lacks the whole campaign"
            if (lasted_s := time.monotonic() - began_s) > MOST_S:
                return f"{address}: {lasted_s:.0f} s"
        if reply.status_code != 200:
            return f"the page of the whole campaign: {reply.status_code}"
        return "refused" if max(codes) >= 400 else "accepted"


PAGES: Final = Pages()
HERE: Final = object()
"""Stands for the directory in a command."""
ASKED: Final = 3
"""Addresses of a mutant beside the list: a page costs more than a mutant, and another mutant asks for others."""
MOST_S: Final = 30.0
"""Wall time of a reply on a machine that others use."""

PROBES: Final = {
    "every.vast": """
version: 1
metadata: {name: every, title: A title}
constraints: [{near: "straight_distance < 9"}]
configuration:
  - name: rooms
    parameters: [{map_file: map.yaml}, {inflation_radius: 0.3}]
    variations:
      - PathVariationRandom: {path_length: [0.8, 1.0], path_length_tolerance: 0.5, num_paths: 1, min_distance: 0.2,
          start_pose: "@start_pose", goal_poses: "@goal_poses", num_goal_poses: 2, robot_diameter: 0.2, seed: 3}
      - ObstacleVariation: {obstacle_configs: [{amount: 1, max_distance: 0.3, xacro_arguments: "width:=0.1, length:=0.1"}],
          count: 1, robot_diameter: 0.1}
      - ParameterVariationList: {name: robot.max_speed, values: [0.1, 0.5]}
    design: {t_way: {strength: 2}}
    dimensions: {inflation_radius: system}
  - name: raster
    parameters: [{map_file: map.yaml}]
    variations:
      - PathVariationRasterized: {raster_size: 0.8, path_length: 1.0, robot_diameter: 0.2}
      - OneOfVariation: {variations: [{ParameterVariationDistributionUniform: {name: a, min: 0, max: 1, num_variations: 2}},
          {ParameterVariationDistributionGaussian: {name: a, mean: 0, std: 1, num_variations: 2, seed: 1, type: int}}]}
    constraints: {few: "abs(a) < 3 and clearance > -1"}
execution:
  runs: {min: 2, max: 5, stop: {error: 0.05}}
  seed: 7
  timeout: 30.0
  nav2_params: ../campaigns/nav2/rpp.yaml
  env: [{A: b}]
evaluation:
  oracles: [performance, {safety: {}}, {../campaigns/notebook/lost.ipynb: {}}]
""",
    "map.yaml": "image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.0, -1.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n",
    "scale.yaml": "{image: map.png, mode: scale, resolution: 5e-2, origin: [0, 0], negate: true, occupied_thresh: .8, free_thresh: .1}\n",
}


def laid_out(folder: Path) -> dict[str, Kind]:
    """Write seeds into a folder, the shipped campaigns and small probes, and return all kinds by name."""
    shutil.copytree(ROOT / "campaigns", folder / "campaigns", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "sim" / "scenario" / "language" / "library", folder / "library")
    probes = folder / "probes"
    probes.mkdir()
    for name, text in PROBES.items():
        (probes / name).write_text(text, encoding="utf-8")
    for suffix in ("variation", "fpm"):
        shutil.copy(ROOT / "tests" / "producers" / f"test_floorplan_example.{suffix}", probes)
    _draw_maps(probes)
    directory = _campaign_directory(probes / "every.vast", folder / "results")
    pictures = [file for file in sorted(probes.iterdir()) if file.suffix in (".pgm", ".bmp", ".png")]
    family = "configuration: [{name: a, start_check: none, parameters: [%s{start_pose: {x: 1, y: 1, yaw: 0}}, {goal_pose: {x: 2, y: 1, yaw: 0}}]}]\n"

    def textual(pattern: str, command: Command, *tree: Mutator) -> Kind:
        seeds = sorted(file for file in folder.rglob(pattern) if "results" not in file.parts)
        return FileKind(seeds, (bytes_changed, lines_changed, tokens_changed(seeds), *tree, *tree), command)

    def named_in(campaign: str) -> Command:
        """Validate a campaign file that names the mutant."""

        def command(file: Path, rng: random.Random) -> Sequence[object]:
            (file.parent / "of_mutant.vast").write_text(campaign.replace("MUTANT", file.name))
            return "validate", file.parent / "of_mutant.vast"

        return command

    of_map = named_in(family % "{map_file: MUTANT}, ")
    judged = named_in(family % f"{{map_file: {probes}/map.yaml}}, " + "evaluation: {oracles: [MUTANT]}\n")

    def pictured(file: Path, rng: random.Random) -> Sequence[object]:
        mode, header = rng.choice(("trinary", "scale", "raw")), file.with_name("of_mutant.yaml")
        header.write_text(f"{{image: {file.name}, mode: {mode}, resolution: 0.05, origin: [0, 0, 0]}}")
        return of_map(header, rng)

    def drawn(file: Path, rng: random.Random) -> Sequence[object]:
        to = "--out", file.parent / "drawn"
        if file.suffix == ".variation":
            return "floorplan", "variations", file, *to
        picture = ("render", "--resolution", "0.25", *to) if rng.random() < 0.05 else ("geometry",)
        return "floorplan", *picture, file

    def reading(*command: object) -> Reader:
        def read(path: Path, rng: random.Random) -> str:
            shutil.rmtree(folder / "exported", ignore_errors=True)
            asked = [path if each is HERE else each for each in command]
            return answer_of(asked, str(path), path.name, "of_mutant")

        return read

    commands = [
        *(reading("show", HERE), reading("show", "--coverage", HERE), reading("compare", HERE, HERE)),
        *(reading("export", HERE, folder / "exported", "--only", "rooms-1-*"), reading("plan", HERE, "--why")),
        *(reading("replay", HERE, "rooms-1-1-1", "1"), reading("plan", "--since", HERE, probes / "every.vast")),
    ]
    below = folder / "explored"
    room = write_map(folder / "room", walled_room(6.0, 4.0))
    whole, seed = (
        write_explored(below / part, room, day, {"room": [1, 0]}) for part, day in (("whole", 20), ("seed", 21))
    )
    mutants = below / "mutants"
    explorer = Explorer(whole, (below / "whole", mutants))
    recordings = [
        *(reading("show", HERE), reading("export", HERE, folder / "exported"), reading("compare", whole, HERE)),
        *(reading("replay", HERE, "room-1", "0", "--json"), reading("show", "--json", HERE)),
    ]
    return {
        "campaign file": textual("*.vast", lambda file, rng: ("validate", file), yaml_tree),
        "scenario file": textual("*.osc", lambda file, rng: ("scenario", rng.choice(("check", "parameters")), file)),
        "floor plan": textual("*.fpm", drawn),
        "floor plan variation": textual("*.variation", drawn),
        "map": textual("probes/*.yaml", of_map, yaml_tree),
        "map picture": FileKind(pictures, (bytes_changed, picture_changed), pictured),
        "Nav2 parameter file": textual("nav2/*.yaml", lambda file, rng: ("params", file), yaml_tree),
        "notebook": textual("*.ipynb", judged, json_tree),
        "directory": DirectoryKind(directory, folder / "damaged", commands),
        "recording": DirectoryKind(seed, folder / "recorded", recordings),
        "explorer directory": DirectoryKind(seed, mutants, [explorer.read]),
        "explorer events": EventsKind(mutants, explorer.read),
        "store manifest": ManifestKind(folder / "manifests"),
    }  # fmt: skip


def _draw_maps(folder: Path) -> None:
    """Draw a room in every format that a map may have."""
    cells = np.full((60, 60), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[20:40, 30] = 0
    gray = Image.fromarray(cells)
    for name, mode in {"map.pgm": "L", "map.bmp": "L", "map.png": "RGBA", "palette.png": "P", "bits.png": "1"}.items():
        gray.convert(mode).save(folder / name)
    Image.fromarray((cells[:20, :20] * 257.0).astype(np.uint16)).save(folder / "deep.png")
    rows = "\n".join(" ".join(map(str, row)) for row in cells[:20, :20].tolist())
    (folder / "plain.pgm").write_text(f"P2\n# words\n20 20\n255\n{rows}\n")


def _campaign_directory(file: Path, results: Path) -> Path:
    verdicts = [
        Verdict(oracle.name, k, "fail" if k == 1 else "pass", "1.2 m off" * (k == 1), {"way": Metric(1.5, "m")})
        for k in range(3)
        for oracle in read_campaign(file)[1]
    ]
    return write_results(file, results, ConfigurationResult(verdicts=verdicts), runs=3, tree=installed_tree()).directory
