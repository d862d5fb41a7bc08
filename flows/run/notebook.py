"""Notebooks over results: filled with what they are about, and executed in a process of their own."""

import importlib.metadata
import importlib.util
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from vastflow.flows.results.current_report import source_digest
from vastflow.producers.campaign_file.visualization import Level, missing_library
from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_bytes, read_text
from vastflow.tasks.engine.child import Child
from vastflow.tasks.store.store import Lost, Store

LIMIT_S: Final = 600.0
"""Time for one cell."""
SHIPPED: Final = Path(__file__).parent / "notebooks"
"""The notebooks that come with vastflow, one for each level."""
_MOST_S: Final = 3600.0
"""Time for one notebook."""
_EXECUTION: Final = "vastflow.flows.run.notebook_execution"
_CONTENT: Final = "notebook.ipynb"
_READ: Final = ("ipykernel", "matplotlib", "nbclient", "numpy", "pandas", "pyarrow", "robovast", "scipy")
"""Libraries whose versions a notebook's outputs may follow from."""


@dataclass(frozen=True, slots=True)
class Book:
    """One notebook about one thing.

    Attributes:
        text: The notebook as JSON, with lines such as `RESULTS = ''` in its cells.
        values: Names to what such a line has instead while the notebook is executed.
        place: Path of the files to write, without suffix; its folder is the working folder.
        is_executed: False for one that was executed before, and is only shown.
    """

    text: str
    values: Mapping[str, Any]
    place: str
    is_executed: bool = True


def shipped(level: Level) -> str:
    """Return the text of vastflow's own notebook of a level."""
    return read_text(SHIPPED / f"{level}.ipynb")


def filled(text: str, values: Mapping[str, Any]) -> str:
    """Fill in lines such as `RUN = 0` of a notebook."""
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        source = "".join(cell["source"])
        for name, value in values.items():
            nothing = r"(?:''|\"\")" if isinstance(value, str) else "0"
            line = rf"(?m)^{name} = {nothing}(?=[ \t]*(?:#.*)?$)"
            source = re.sub(line, f"{name} = {value!r}".replace("\\", r"\\"), source)
        cell["source"] = source
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def execute_books(books: Sequence[Book]) -> list[str]:
    """Write `.ipynb` and `.html` of each; return what went wrong with each in a sentence, empty if nothing did."""
    if name := missing_library():
        return [f"{name} is missing. Call pip install 'vastflow[notebook]'"] * len(books)
    said = []
    with TemporaryDirectory(prefix="vastflow-") as aside, Child(f"{_EXECUTION}:execute", folder=aside) as child:
        for each in books:
            try:
                said.append(str(child.ask({**asdict(each), "limit_s": LIMIT_S}, _MOST_S)))
            except UserError as error:
                said.append(str(error))
    return said


def execute_kept(books: Sequence[Book], results: str, store: Store) -> list[str]:
    """Execute books as `execute_books` does, or take the outputs that the store has of the same text, results, and versions.

    Only executed notebooks are kept, without their pages: a browser executes what is in a page, and others may write to a store.

    Args:
        results: Digest of all that a notebook may read.
    """
    installed = [name for name in _READ if importlib.util.find_spec(name)]
    versions = {name: importlib.metadata.version(name) for name in installed}
    made_by = digest([versions, source_digest(), results])
    keys = []
    for each in books:
        about = {name: value for name, value in each.values.items() if name not in ("DATA_DIR", "RESULTS")}
        key = digest([made_by, each.text, about, Path(each.place).name])
        keys.append(f"notebook/{key[:2]}/{key}")
    known = []
    for key, each in zip(keys, books, strict=True):
        try:
            text = store.read(key, _CONTENT).decode()
        except (Lost, ValueError):
            known.append(each)
        else:
            known.append(replace(each, text=text, is_executed=False))
    wrong = execute_books(known)
    for key, each, sentence in zip(keys, known, wrong, strict=True):
        if each.is_executed and not sentence:
            store.put(key, {_CONTENT: read_bytes(Path(f"{each.place}.ipynb"))})
    return wrong
