"""Mutate a file by its bytes, its tokens, or its tree, or replace it by an attack."""

import copy
import json
import random
import re
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import yaml

Mutator: TypeAlias = Callable[[bytes, random.Random], bytes]

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
    *("&a", "*a", "<<: *a", "!!python/object:os.system", "!!binary", "!!set", "!!timestamp", "!x", "? ", ": ", "- ", "---\n", "...\n", "|\n", ">-\n"),
    *("{", "}", "[", "]", ",", ":", "'", '"', "#", "%YAML 1.1\n", "\t", "\r", "\0", "\x85", "\u2028", "\ufeff", "\x7f", "\\", "@", "`", "=", "null", "~"),
)  # fmt: skip


def bytes_changed(content: bytes, rng: random.Random) -> bytes:
    """Some bytes are others, left out, doubled, or the end is missing."""
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        k = rng.randrange(len(found) + 1)
        n = min(rng.choice((1, 1, 2, 8, 100, 3000)), len(found) - k)
        what = rng.randrange(6)
        if what == 0 and k < len(found):
            found[k] ^= 1 << rng.randrange(8)
        elif what == 1:
            found[k : k + n] = b""
        elif what == 2:
            found[k:k] = found[k : k + n] * rng.choice((1, 1, 2, 50))
        elif what == 3:
            odd = b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", b"\x1b[31m", b"\r\n", rng.randbytes(9)
            found[k:k] = rng.choice(odd)
        elif what == 4:
            found[k : k + n] = rng.randbytes(n)
        elif rng.random() < 0.3:
            del found[k:]
    return bytes(found[:2_000_000])


def tokens_changed(words: tuple[str, ...]) -> Mutator:
    """Some words are others, of the file or of its language, left out, doubled, swapped, or repeated very often."""

    def mutate(content: bytes, rng: random.Random) -> bytes:
        tokens = TOKEN.findall(content.decode("utf-8", "replace"))
        for _ in range(rng.choice((1, 1, 2, 4))):
            if not tokens:
                break
            k = rng.randrange(len(tokens))
            numbers = [i for i, token in enumerate(tokens) if token[0].isdigit()]
            what = rng.randrange(9)
            if what <= 2 and numbers:
                tokens[rng.choice(numbers)] = rng.choice(NUMBERS)
            elif what == 3:
                tokens[k] = rng.choice((*words, *PIECES, rng.choice(tokens)))
            elif what == 4:
                tokens.insert(k, rng.choice((*words, *PIECES, rng.choice(tokens))))
            elif what == 5:
                del tokens[k : k + rng.choice((1, 1, 5, 60))]
            elif what == 6:
                end = min(len(tokens), k + rng.randrange(1, 60))
                tokens[end:end] = tokens[k:end]
            elif what == 7:
                j = rng.randrange(len(tokens))
                tokens[k], tokens[j] = tokens[j], tokens[k]
            elif rng.random() < 0.2:
                tokens[k] = rng.choice((*words, *PIECES, tokens[k])) * rng.choice((50, 2000, 100_000))
        return "".join(tokens)[:1_500_000].encode("utf-8", "replace")

    return mutate


def lines_changed(content: bytes, rng: random.Random) -> bytes:
    """Blocks of lines are moved, doubled, left out, or indented otherwise."""
    lines = content.split(b"\n")
    for _ in range(rng.choice((1, 1, 3))):
        k = rng.randrange(len(lines))
        block = lines[k : k + rng.choice((1, 2, 5, 20))]
        what = rng.randrange(4)
        if what == 0:
            lines[k : k + len(block)] = []
        elif what == 1:
            at = rng.randrange(len(lines) + 1)
            lines[at:at] = block * rng.choice((1, 1, 3, 400))
        elif what == 2:
            blanks = b" " * rng.choice((1, 2, 4, 300))
            lines[k : k + len(block)] = [blanks + line for line in block]
        else:
            lines[k : k + len(block)] = [line[rng.choice((1, 2, 4)) :] for line in block]
        lines = lines or [b""]
    return b"\n".join(lines)[:2_000_000]


def tree_changed(read: Callable[[bytes], Any], write: Callable[[Any], bytes]) -> Mutator:
    """Values of a tree of mappings and lists are others, left out, doubled, renamed, or nested deeper."""

    def mutate(content: bytes, rng: random.Random) -> bytes:
        try:
            tree = {"": read(content)}
        except Exception:  # noqa: BLE001 - a seed of which there is no tree
            return bytes_changed(content, rng)
        for _ in range(rng.choice((1, 1, 2, 4))):
            places = list(_places(tree))
            holder, key = rng.choice(places)
            what = rng.randrange(8)
            if what <= 2:
                holder[key] = copy.deepcopy(rng.choice(ODD))
            elif what == 3:
                other, name = rng.choice(places)
                holder[key] = copy.deepcopy(other[name])
            elif what == 4 and holder is not tree:
                del holder[key]
            elif what == 5 and isinstance(holder, list):
                holder[key:key] = [copy.deepcopy(holder[key])] * rng.choice((1, 1, 3, 300))
            elif what == 5 and holder is not tree:
                holder[rng.choice((*map(str, ODD[:8]), "zz", key + "x"))] = holder.pop(key)
            elif what == 6:
                for _ in range(rng.choice((1, 3, 60, 150))):
                    holder[key] = [holder[key]] if rng.random() < 0.5 else {"a": holder[key]}
            elif isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
                holder[key] = rng.choice((-1, 0, 2, 1e6, 1e-6)) * holder[key]
        try:
            return write(tree[""])[:2_000_000]
        except Exception:  # noqa: BLE001 - what no YAML or JSON can say
            return bytes_changed(content, rng)

    return mutate


def _places(tree: Any) -> Any:
    for key in list(tree) if isinstance(tree, Mapping) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


def attack(content: bytes, rng: random.Random) -> bytes:
    """Something built to be deep, large or without end."""
    n = rng.choice((150, 3000, 100_000))
    nines = ", ".join(["*a%d"] * 9)
    return rng.choice(
        (
            lambda: b"",
            lambda: content + b"\n" + rng.choice((b"[", b"{a: ", b"- ", b"(", b"{", b'{"a":', b"? ")) * n,
            lambda: rng.choice((b"[", b"{a: ", b"- ", b"(", b"not ", b"-", b'[{"a":', b"!", b"&a ")) * n,
            lambda: b"a: " + rng.choice((b"[", b"(", b"'", b"x")) * n,
            lambda: b"\n".join(b"%*sa:" % (k % 1500, b"") for k in range(min(n, 1500))),
            lambda: b"\n".join(b"%*sserial:" % (4 * k, b"") for k in range(min(n, 600))),
            lambda: ("a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{nines % ((k - 1,) * 9)}]\n" for k in range(1, 30))).encode(),
            lambda: ("a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}\n" for k in range(1, 40))).encode(),
            lambda: b"a: &a [*a]\n" + content,
            lambda: b"\n" * n + content,
            lambda: content.replace(b" ", b"\xc2\xa0"),
            lambda: content.decode("latin-1").encode("utf-16"),
            lambda: content * min(n // max(len(content), 1) + 1, 400),
            lambda: b"#" * n + b"\n" + content,
            lambda: b'"' + b"a" * n + b'": ' + b"1" * n,
            lambda: rng.randbytes(min(n, 3000)),
            lambda: content.replace(b"1", b"1" * n, 1),
            lambda: content.replace(b".", b"." + b"a." * min(n, 3000), 1),
            lambda: content.replace(b":", b":" + b" 1 +" * min(n, 3000), 1),
        )
    )()  # fmt: skip


def picture_changed(content: bytes, rng: random.Random) -> bytes:
    """A picture's header says something else, or the rest is damaged."""
    what = rng.randrange(5)
    if what == 0 and content[:2] in (b"P5", b"P2", b"P6"):
        sizes = b"0 -1 1 20 5000 20000 1000000 99999999999 255 65535 70000 a".split()
        return content[:2] + b" " + b" ".join(rng.choice(sizes) for _ in range(3)) + b"\n" + content[12:]
    if what == 1 and content[:4] == b"\x89PNG":
        at = 16 + 4 * rng.randrange(2)
        size = struct.pack(">I", rng.choice((0, 1, 5000, 20_000, 1_000_000, 2**31 - 1, 2**32 - 1)))
        return content[:at] + size + content[at + 4 :]
    if what == 2 and content[:2] == b"BM":
        at = rng.choice((2, 10, 14, 18, 22, 26, 28, 30, 34, 46))
        size = struct.pack("<i", rng.choice((0, -1, 1, 8, 20_000, 2**31 - 1, -(2**31))))
        return content[:at] + size + content[at + 4 :]
    return bytes_changed(content, rng)


yaml_tree: Final = tree_changed(
    yaml.safe_load, lambda tree: yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode("utf-8", "replace")
)
json_tree: Final = tree_changed(json.loads, lambda tree: json.dumps(tree).encode())


def mutated(content: bytes, mutators: tuple[Mutator, ...], rng: random.Random) -> bytes:
    """A mutant of a file by one of `mutators`, or rarely an attack."""
    mutate = attack if rng.random() < 0.06 else rng.choice(mutators)
    try:
        return mutate(content, rng)
    except (RecursionError, MemoryError, ArithmeticError):  # too deep to be written, or too large to be multiplied
        return bytes_changed(content, rng)
