"""Notebook files: the code cells of a Jupyter notebook, as far as a judgement follows from them."""

import ast
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

SKIPPED: Final = "skip-execution"
"""Tag of cells that are for looking alone; nbclient leaves them out, too."""

PARAMETERS: Final = "parameters"
"""Tag of the cell with the parameters' defaults, as papermill has it."""


class NotebookError(ValueError):
    """A notebook that can't judge: `what` was found, and what would be `right`."""

    def __init__(self, what: str, right: str) -> None:
        super().__init__(f"{what}; {right}")
        self.what = what
        self.right = right

    def __reduce__(self) -> tuple[Any, ...]:
        return NotebookError, (self.what, self.right)


@dataclass(frozen=True, slots=True)
class Cell:
    """A code cell; `number` counts all cells from 1."""

    number: int
    code: str
    has_parameters: bool


def read_cells(file: Path) -> tuple[Cell, ...]:
    """The code cells of a notebook that are executed.

    Raises:
        NotebookError: no notebook of format 4, or a cell that is not Python.
    """
    cells = tuple(_cells(file))
    for cell in cells:
        try:
            compile(cell.code, file.name, "exec")
        except SyntaxError as error:
            text = cell.code.splitlines()[error.lineno - 1].strip() if error.lineno else ""
            where = f"{file.name}: cell {cell.number}, line {error.lineno}"
            right = f"Python alone; what is IPython's belongs into a cell tagged {SKIPPED!r}"
            raise NotebookError(f"{where}: found {text!r}", right) from None
    return cells


def notebook_code(file: Path) -> str:
    """All that is executed, as one Python text: what stands in no other cell, and no output, changes a judgement.

    Raises:
        NotebookError: no notebook of format 4.
    """
    return "".join(f"{cell.code}\n" + "parameters = ...\n" * cell.has_parameters for cell in _cells(file))


def literals(cell: Cell, file: Path, only: str | None = None) -> Mapping[str, Any]:
    """Name to value of what a cell assigns, in its order.

    Args:
        only: The one name that is looked for; other statements may be anything then.

    Raises:
        NotebookError: a statement that is no assignment of a literal to a name.
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
        except ValueError:
            where = f"{file.name}: cell {cell.number}, line {statement.lineno}"
            raise NotebookError(f"{where}: found {ast.unparse(statement)!r}", "name = literal") from None
    return found


def _assigned(statement: ast.stmt) -> tuple[str | None, ast.expr | None]:
    if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
        target, value = statement.targets[0], statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        target, value = statement.target, statement.value
    else:
        return None, None
    return (target.id, value) if isinstance(target, ast.Name) else (None, None)


def _cells(file: Path) -> Iterator[Cell]:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        cells = document["cells"] if document["nbformat"] == 4 else None
    except (ValueError, KeyError, TypeError) as error:
        raise NotebookError(
            f"{file.name}: it can't be read: {type(error).__name__}: {error}", "a notebook of format 4"
        ) from None
    if cells is None:
        raise NotebookError(f"{file.name}: found nbformat {document['nbformat']}", "a notebook of format 4")
    for number, cell in enumerate(cells, 1):
        tags = cell.get("metadata", {}).get("tags", ())
        if cell["cell_type"] == "code" and SKIPPED not in tags:
            yield Cell(number, "".join(cell["source"]), PARAMETERS in tags)
