"""Execute notebooks in this process's children, and write them with their pages."""

import html
import json
from pathlib import Path
from typing import Any, Final

from vastflow.tasks.engine.process import safe_path

_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1b1f24; background: #fff }}
pre {{ font-size: 12px; line-height: 1.45; overflow-x: auto; margin: .4rem 0 }}
.input_area pre, .highlight pre {{ background: #f4f6f8; padding: .6rem .8rem; border-radius: 6px }}
.prompt, .anchor-link {{ display: none }}
img {{ max-width: 100% }}
table {{ border-collapse: collapse; font-size: 13px; margin: .6rem 0 }}
th, td {{ border-bottom: 1px solid #d8dee4; padding: .2rem .6rem; text-align: right }}
</style></head><body>
{body}
</body></html>
"""
"""No script of a notebook's outputs is executed, and nothing is asked of the network."""
_ARGUMENTS: Final = ["--InteractiveShellApp.ignore_cwd=True"]
"""A folder of results decides no more than its data: nothing is imported from it."""


def execute(book: dict[str, Any]) -> str:
    """Execute one notebook, write it and its page, and return what went wrong in a sentence."""
    import nbformat
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
    from nbconvert import HTMLExporter

    from vastflow.flows.run.notebook import filled

    own, wrong = json.loads(book["text"]), ""
    text = filled(book["text"], book["values"]) if book["is_executed"] else book["text"]
    notebook = nbformat.reads(text, as_version=4)  # type: ignore[no-untyped-call]
    if book["is_executed"]:
        there = {"metadata": {"path": str(Path(book["place"]).parent)}}
        client = NotebookClient(
            notebook, timeout=book["limit_s"], kernel_name="python3", resources=there, extra_arguments=_ARGUMENTS
        )
        try:
            with safe_path():
                client.execute()
        except CellExecutionError as error:
            wrong = f"{error.ename}: {' '.join(str(error.evalue).split())[:300]}"
        except CellTimeoutError:
            wrong = f"expected an end within {book['limit_s']:g} s, got none"
        except DeadKernelError:
            wrong = "its kernel ended"
        if wrong:
            begun = [
                k
                for k, cell in enumerate(notebook.cells, 1)
                if "iopub.execute_input" in cell.metadata.get("execution", {})
            ]
            wrong = f"cell {begun[-1]}: {wrong}" if begun else wrong
        for cell, as_written in zip(notebook.cells, own["cells"], strict=True):
            cell.metadata.pop("execution", None)  # times, which make equal outputs differ
            if book["values"].get("DATA_DIR"):  # a folder that will be gone
                cell.source = "".join(as_written["source"])
        text = nbformat.writes(notebook)  # type: ignore[no-untyped-call]
    place = Path(book["place"])
    Path(f"{place}.ipynb").write_text(text, encoding="utf-8")
    body, _ = HTMLExporter(template_name="basic").from_notebook_node(notebook)  # type: ignore[no-untyped-call]
    page = _PAGE.format(title=html.escape(place.name), body=body)
    Path(f"{place}.html").write_text(page, encoding="utf-8", errors="backslashreplace")
    return wrong
