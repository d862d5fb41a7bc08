"""A plug-in named as `file.py:Class`, looked at without executing anything of it."""

import ast
from pathlib import Path

from vastflow.sim.model.files import is_file


def names_file(reference: str) -> bool:
    """Whether a plug-in is named by a file, not by a name that is known here."""
    return ".py:" in reference


def plug_in_complaint(reference: str, base: Path) -> str | None:
    """Return what is wrong with `file.py:Class`, relative to `base`; None if the file has such a class.

    A name that the file imports or assigns counts: what stands behind it only an import would tell.
    """
    name, _, class_name = reference.rpartition(":")
    file = base / name
    if not is_file(file):
        return f"got {reference!r}, and there is no such file"
    try:
        module = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError, RecursionError, OSError) as error:
        return f"{name} can't be read as Python: {' '.join(str(error).split())}"
    return None if class_name in _names(module) else f"no class {class_name!r} in {name}"


def _names(module: ast.Module) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(module):
        if isinstance(node, ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            found |= {alias.asname or alias.name.partition(".")[0] for alias in node.names}
    return found
