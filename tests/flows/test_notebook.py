"""The progress of a campaign in a notebook's cell."""

import re
import sys
from types import SimpleNamespace

from vastflow.flows.terminal.notebook import NotebookDisplay, notebook_display
from vastflow.tasks.engine.progress import Progress


class Cell:
    """What a notebook shows of a cell: the last state of its output."""

    def __init__(self):
        self.shown = []

    def update(self, shown):
        self.shown.append(shown)


def test_progress_renews_one_output_of_the_cell_and_ends_with_all_runs_done():
    cell, times = Cell(), iter([0.0, 0.1, 0.2, 0.9, 1.0])
    display = NotebookDisplay(cell, lambda html: html, lambda: next(times))
    for done in (1, 2, 3, 4):
        display.update(Progress("running", runs_done=done, runs_total=4, passed=done, notices=("a <note>",)))
    assert [re.search(r'value="(\d)"', shown)[1] for shown in cell.shown] == ["1", "3", "4"]
    assert "4/4 runs" in cell.shown[-1] and "a &lt;note&gt;" in cell.shown[-1]


def test_only_a_notebooks_kernel_has_a_cell_to_show_progress_in(monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", None)
    assert notebook_display() is None
    cell = Cell()
    shown = SimpleNamespace(HTML=lambda html: html, display=lambda what, display_id: cell)
    for shell, found in ((None, False), (SimpleNamespace(), False), (SimpleNamespace(kernel="kernel"), True)):
        ipython = SimpleNamespace(get_ipython=lambda shell=shell: shell, display=shown)
        monkeypatch.setitem(sys.modules, "IPython", ipython)
        assert (notebook_display() is not None) is found
