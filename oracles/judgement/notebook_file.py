"""Notebook files: the code cells of a Jupyter notebook that a judgement follows from."""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ValidationError

from vastflow.sim.model.files import Unreadable, read_json
from vastflow.sim.plug_ins.neighbors import PlugInError

SKIPPED: Final = "skip-execution"
"""Tag of cells that are not executed, as in nbclient."""

PARAMETERS: Final = "parameters"
"""Tag of the cell with defaults of parameters, as in papermill."""


class _Metadata(BaseModel):
    tags: list[str] = []


class _Cell(BaseModel):
    cell_type: str
    source: str | list[str]
    metadata: _Metadata = _Metadata()


class _Notebook(BaseModel):
    """Required content of a notebook file."""

    nbformat: Literal[4]
    cells: list[_Cell]


@dataclass(frozen=True, slots=True)
class CodeCell:
    """A code cell; `number` counts all cells from 1."""

    number: int
    code: str
    has_parameters: bool


def read_cells(file: Path) -> tuple[CodeCell, ...]:
    """The code cells of a notebook that are executed.

    Raises:
        PlugInError: no notebook of format 4, or a cell that is not Python.
    """
    cells = tuple(_cells(file))
    for cell in cells:
        try:
            compile(cell.code, file.name, "exec")
        except SyntaxError as error:
            lines, number = cell.code.splitlines(), error.lineno or 0
            text = lines[number - 1].strip() if 0 < number <= len(lines) else error.msg
            where = f"{file.name}: cell {cell.number}" + (f", line {number}" if number else "")
            tagged = f"tag cells with IPython commands {SKIPPED!r}"
            raise PlugInError(f"{where}: expected Python, got {text!r}", tagged) from None
        except (ValueError, RecursionError, MemoryError) as error:  # a NUL, half a character; too deep for Python
            raise PlugInError(f"{file.name}: cell {cell.number}: {error}", "a cell of Python") from None
    return cells


def notebook_code(file: Path) -> str:
    """The executed cells as one Python text, from which all judgements follow.

    Raises:
        PlugInError: no notebook of format 4.
    """
    return "".join(f"{cell.code}\n" + "parameters = ...\n" * cell.has_parameters for cell in _cells(file))


def literals(cell: CodeCell, file: Path, only: str | None = None) -> Mapping[str, Any]:
    """Name to value of the literals that a cell assigns.

    Args:
        only: The one wanted name; other statements are free then.

    Raises:
        PlugInError: a statement that does not assign a literal to a name.
    """
    found: dict[str, Any] = {}
    for statement in ast.parse(cell.code).body:
        name, value = _assigned(statement)
        if only is not None and name != only:
            continue
        try:
            if name is None or value is None:
                raise ValueError
            found[name] = ast.literal_eval(value)
        except (ValueError, TypeError, RecursionError, MemoryError):  # TypeError: a list as a key
            where = f"{file.name}: cell {cell.number}, line {statement.lineno}"
            raise PlugInError(f"{where}: expected name = literal, got {ast.unparse(statement)!r}", "") from None
    return found


def _assigned(statement: ast.stmt) -> tuple[str | None, ast.expr | None]:
    if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
        target, value = statement.targets[0], statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        target, value = statement.target, statement.value
    else:
        return None, None
    return (target.id, value) if isinstance(target, ast.Name) else (None, None)


def _cells(file: Path) -> Iterator[CodeCell]:
    try:
        notebook = _Notebook.model_validate(read_json(file, "a notebook"))
    except Unreadable as error:
        raise PlugInError(error.what, error.right) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "content"
        got = str(first["input"])[:60]
        raise PlugInError(f"{file.name}: {where}: expected a notebook of format 4, got {got}", "") from None
    for number, cell in enumerate(notebook.cells, 1):
        tags = cell.metadata.tags
        if cell.cell_type == "code" and SKIPPED not in tags:
            yield CodeCell(number, "".join(cell.source), PARAMETERS in tags)
