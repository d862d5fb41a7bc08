"""Files that others write, read within limits: texts, YAML, JSON, and XML; and folders that appear whole."""

import io
import itertools
import json
import os
import shutil
import stat
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeAlias
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import yaml
from yaml.constructor import SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode

from vastflow.sim.model.faults import Got, Invalid, Problem

TextPlace: TypeAlias = tuple[int, int]
"""Line and column, from 1."""
START: Final[TextPlace] = (1, 1)

MOST_BYTES: Final = 64 * 2**20
MOST_TEXT_BYTES: Final = 16 * 2**20
"""Maximum size of a text that is parsed as a whole; other files may be larger."""
MOST_LEVELS: Final = 100
"""Parsers recurse; libyaml's ends the process."""
MOST_YAML_NODES: Final = 500_000
"""Including what aliases stand for: aliases of aliases grow exponentially."""
MOST_JSON_VALUES: Final = 5_000_000

NOT_YAML: Final = "look for a missing colon, quote or bracket, for tabs, and for uneven indentation"

_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class Unreadable(Invalid):
    """A file that can't be used, and the place in it where known."""

    def __init__(self, problem: Problem, expected: str, place: TextPlace = START) -> None:
        super().__init__(problem, expected)
        self.args = (problem, expected, place)  # so that it can be pickled
        self.place = place


class Missing(Unreadable, FileNotFoundError):
    """The file does not exist."""


def open_file(path: str | Path, kind: str = "a file") -> io.BufferedReader:
    """Open a regular file that should be `kind`, without waiting; whatever others write is opened by this alone.

    Raises:
        Missing: there is none.
        Unreadable: no permission, or not a regular file (a pipe or a device may never end).
    """
    descriptor = None
    try:
        _check_regular(os.stat(path), kind)  # opening some devices has effects
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        _check_regular(os.fstat(descriptor), kind)  # the path may be a pipe by now
        file = os.fdopen(descriptor, "rb")
        descriptor = None
        return file
    except FileNotFoundError:
        raise Missing("no such file", f"expected {kind}") from None
    except Unreadable:
        raise
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise Unreadable(f"it can't be read: {getattr(error, 'strerror', None) or error}", f"expected {kind}") from None
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _check_regular(status: os.stat_result, kind: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        found = next((name for is_kind, name in _KINDS if is_kind(status.st_mode)), "no regular file")
        raise Unreadable(f"it is {found}", f"expected {kind}")


def read_bytes(path: str | Path, kind: str = "a file", most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file that should be `kind`; raises as `open_file`, or if too large."""
    with open_file(path, kind) as file:
        _check_limit(os.fstat(file.fileno()).st_size, most_bytes)
        try:
            content = file.read(most_bytes + 1) or b""  # None of a kernel's file that has nothing yet
        except OSError as error:
            raise Unreadable(f"it can't be read: {error.strerror}", f"expected {kind}") from None
    _check_limit(len(content), most_bytes)
    return content


def copy_file(source: str | Path, target: Path, kind: str = "a file") -> None:
    """Copy a regular file's content into a folder that may be new; raises as `open_file` does."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with open_file(source, kind) as file, open(target, "wb") as copied:
        shutil.copyfileobj(file, copied)


def is_file(path: str | Path) -> bool:
    """True if the path is a regular file; False for a name that no file can have."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def files_below(folder: Path) -> list[Path]:
    """Return the regular files below a folder in order, without those that a link leads out of it to."""
    home = os.path.realpath(folder)
    return [file for file in sorted(folder.rglob("*")) if is_file(file) and is_inside(file, home)]


def is_inside(path: str | os.PathLike[str], folder: str | Path) -> bool:
    """True if a path leads to a place in a folder, which is given without links."""
    return Path(os.path.realpath(path)).is_relative_to(folder)


def _check_limit(found: int, most: int) -> None:
    if found > most:
        raise Unreadable(Got(f"{found:,} bytes"), f"at most {most:,}")


def read_text(path: str | Path, kind: str = "a text file", most_bytes: int = MOST_TEXT_BYTES) -> str:
    """Return the text of a regular file in UTF-8, without a byte order mark; raises as `read_bytes` does."""
    content = read_bytes(path, kind, most_bytes)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8-sig", "replace")
        raise Unreadable(
            f"byte {content[error.start]:#04x} is not UTF-8", "expected a text in UTF-8", _place_behind(before)
        ) from None


def yaml_node(text: str) -> Node | None:
    """Compose the first document of a YAML text with aliases resolved; None where it is empty.

    Raises:
        Unreadable: not YAML, an alias inside of what it stands for, or beyond a limit.
    """
    try:
        _check_size(text)
        loader = yaml.CSafeLoader(text)
        try:
            node = loader.get_node() if loader.check_node() else None
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        place = _place_at(error.problem_mark or error.context_mark)
        if error.problem == "exceeded maximum nesting depth":  # PyYAML since 6.0.4, which scans ahead of the events
            raise Unreadable(f"it is more than {MOST_LEVELS} levels deep", "use fewer levels", place) from None
        rest = "".join(text.split("\n")[place[0] - 1 : place[0]])[place[1] - 1 :]
        if rest.startswith("\t") or "tab character" in str(error.problem):
            raise Unreadable(Got("a tab"), "spaces, as YAML allows no tabs for indentation", place) from None
        what = ", ".join(filter(None, (error.context, error.problem)))
        raise Unreadable(f"not YAML: {what}", NOT_YAML, place) from None
    except yaml.YAMLError as error:  # ReaderError: a character that YAML has not
        before = text.encode(errors="replace")[: getattr(error, "position", 0)].decode(errors="replace")
        raise Unreadable(f"not YAML: {getattr(error, 'reason', error)}", NOT_YAML, _place_behind(before)) from None
    if node is not None:
        _check_aliases(node, {}, set(), 0)
    return node


def _check_size(text: str) -> None:
    """Check the first document's events, which neither recurse nor take memory."""
    depth = nodes = 0
    has_ended = False
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if has_ended:  # only the next event tells that nothing of the document is left, such as what is indented less
            return
        has_ended = isinstance(event, yaml.DocumentEndEvent)
        if isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.NodeEvent):
            nodes += 1
            depth += isinstance(event, yaml.CollectionStartEvent)
        if depth > MOST_LEVELS:
            raise Unreadable(f"it is more than {MOST_LEVELS} levels deep", "use fewer levels", place_of(event))
        if nodes > MOST_YAML_NODES:
            raise Unreadable(f"it has more than {MOST_YAML_NODES:,} values", "use fewer values", place_of(event))


def _check_aliases(node: Node, sizes: dict[int, tuple[int, int]], opened: set[int], depth: int) -> tuple[int, int]:
    """Count nodes and levels below `node` with its aliases resolved; each node is visited once."""
    if isinstance(node, ScalarNode):
        return 1, 0
    if id(node) in opened:
        raise Unreadable(Got("an alias inside of what it stands for"), "an alias of something else", place_of(node))
    if id(node) not in sizes:
        opened.add(id(node))
        nodes, levels = 1, 0
        children = itertools.chain(*node.value) if isinstance(node, MappingNode) else node.value
        for child in children:
            more, below = _check_aliases(child, sizes, opened, depth + 1)
            nodes, levels = nodes + more, max(levels, below)
        opened.remove(id(node))
        sizes[id(node)] = nodes, levels + 1
    nodes, levels = sizes[id(node)]
    if nodes > MOST_YAML_NODES or depth + levels > MOST_LEVELS:
        what = f"aliases grow to more than {MOST_YAML_NODES:,} values or {MOST_LEVELS} levels"
        raise Unreadable(what, "use fewer aliases", place_of(node))
    return nodes, levels


def place_of(node: Node | yaml.Event) -> TextPlace:
    """Start of a node or an event."""
    return _place_at(node.start_mark)


def _place_at(mark: Any) -> TextPlace:
    return (mark.line + 1, mark.column + 1) if mark else START


def yaml_value(text: str) -> Any:
    """Return the first document of a YAML 1.1 text as plain values; None where it is empty.

    Raises:
        Unreadable: see `yaml_node`; or a value that is not what its tag says.
    """
    node = yaml_node(text)
    try:
        return None if node is None else SafeConstructor().construct_document(node)
    except yaml.MarkedYAMLError as error:
        place = _place_at(error.problem_mark or error.context_mark)
        raise Unreadable(f"not YAML: {error.problem}", "use plain values", place) from None
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        # PyYAML takes a value for a date, say, by its form, and leaves a month of 13 to `datetime`.
        raise Unreadable(f"not YAML: {error}", "use plain values", place_of(node) if node else START) from None


def json_value(content: str | bytes) -> Any:
    """Return the value of a JSON text; raises `Unreadable` if it is not JSON or beyond a limit."""
    try:
        text = content.decode("utf-8-sig") if isinstance(content, bytes) else content
        if sum(map(text.count, "[{,")) > MOST_JSON_VALUES:
            raise Unreadable(f"it has more than {MOST_JSON_VALUES:,} values", "use fewer values")
        value = json.loads(text)
    except Unreadable:
        raise
    except json.JSONDecodeError as error:
        raise Unreadable(f"it is not JSON: {error.msg}", "expected a JSON text", (error.lineno, error.colno)) from None
    except RecursionError:
        raise Unreadable(f"it is more than {MOST_LEVELS} levels deep", "use fewer levels") from None
    except ValueError as error:  # also a number of thousands of digits
        right = "expected a text in UTF-8" if isinstance(error, UnicodeDecodeError) else "expected a JSON text"
        raise Unreadable(f"it is not JSON: {error}", right) from None
    _check_levels(value)
    return value


def _check_levels(value: Any) -> None:
    level = [value]
    for _ in range(MOST_LEVELS):
        nested = [each for each in level if isinstance(each, dict | list)]
        level = [part for each in nested for part in (each.values() if isinstance(each, dict) else each)]
        if not level:
            return
    raise Unreadable(f"it is more than {MOST_LEVELS} levels deep", "use fewer levels")


def read_json(path: str | Path, kind: str = "a JSON file") -> Any:
    """Return the value of a JSON file; raises as `read_bytes` and `json_value` do, naming the file."""
    try:
        return json_value(read_bytes(path, kind))
    except Unreadable as error:
        line, column = error.place
        at = "" if error.place == START else f":{line}:{column}"
        raise type(error)(f"{Path(path).name}{at}: {error}", "", error.place) from None


def xml_root(content: bytes) -> Element:
    """Return the root of an XML document, without comments; raises `Unreadable`, for a document type, which can have entities, too."""
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.buffer_text = True

    def refuse(*_: object) -> None:
        raise Unreadable(Got("<!DOCTYPE"), "XML without a document type")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda tag, attributes: builder.start(tag, attributes)
    parser.EndElementHandler = lambda tag: builder.end(tag)
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise Unreadable(Got(expat.errors.messages[error.code]), "XML", (error.lineno, error.offset + 1)) from None
    root: Element = builder.close()
    return root


def _place_behind(before: str) -> TextPlace:
    lines = before.split("\n")
    return len(lines), len(lines[-1]) + 1


def replace_file(file: Path, content: bytes) -> None:
    """Write a file in one step, by a new one of random name beside it; follow no link.

    Raises:
        OSError: it can't be written.
    """
    prepared = file.with_name(f".{uuid.uuid4().hex}")
    try:
        # Not by `mkstemp`, whose files only their owner can read.
        new = os.open(prepared, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o666)
        with os.fdopen(new, "wb") as opened:
            opened.write(content)
        prepared.replace(file)
    except BaseException:
        with suppress(OSError):
            prepared.unlink()
        raise


def keep_folder(folder: Path, contents: Mapping[str, bytes], beside: Mapping[str, bytes] | None = None) -> bool:
    """Write a folder of these files, unless it is there, whole; return whether it was written.

    Args:
        contents: Place in the folder to content.
        beside: More files that are written, and not compared with what is there.

    Raises:
        OSError: it can't be written.
    """
    beside = beside or {}
    if _is_whole(folder, contents, beside):
        return False
    prepared = folder.with_name(f".{uuid.uuid4().hex}")
    try:
        for place, content in {**contents, **beside}.items():
            file = prepared / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        for _ in range(3):
            with suppress(OSError):  # another process was first, or something damaged lies there
                prepared.rename(folder)
                return True
            if _is_whole(folder, contents, beside):
                return False
            damaged = folder.with_name(f".{uuid.uuid4().hex}")
            with suppress(OSError):
                folder.rename(damaged)
            shutil.rmtree(damaged, ignore_errors=True)
        prepared.rename(folder)
        return True
    finally:
        shutil.rmtree(prepared, ignore_errors=True)


def _is_whole(folder: Path, contents: Mapping[str, bytes], beside: Mapping[str, bytes]) -> bool:
    try:
        there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
        own = {place for place in there if place not in beside and "__pycache__" not in place}
        return own == contents.keys() and all((folder / place).read_bytes() == contents[place] for place in contents)
    except OSError:
        return False
