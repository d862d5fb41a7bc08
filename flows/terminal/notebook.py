"""The progress of a campaign in a notebook: one output of the cell, updated in place."""

import sys
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

from markupsafe import Markup

from vastflow.flows.terminal.pace import Meter
from vastflow.tasks.engine.progress import Progress

INTERVAL_S: Final = 0.5

_SHOWN: Final = Markup(
    '<progress style="width:20em" max="{}" value="{}"></progress><pre style="margin:0;white-space:pre-wrap">{}</pre>'
)


class Output(Protocol):
    """An output of a notebook's cell: a handle of `IPython.display.display`."""

    def update(self, shown: Any) -> None:
        """Replace the shown object."""


class NotebookDisplay:
    """An observer of a campaign that shows its progress, as `html`, in the `output` of a notebook's cell."""

    def __init__(self, output: Output, html: Callable[[str], Any], clock: Callable[[], float] = time.monotonic) -> None:
        self._output = output
        self._html = html
        self._clock = clock
        self._meter = Meter(clock())
        self._shown_s = float("-inf")

    def update(self, progress: Progress) -> None:
        """Show `progress` at most twice a second, and always when all runs are done."""
        from vastflow.flows.terminal.display import plain_line  # with it comes rich, which draws random numbers

        now_s = self._clock()
        self._meter.note(progress, now_s)
        if now_s - self._shown_s >= INTERVAL_S or 0 < progress.runs_total == progress.runs_done:
            self._shown_s = now_s
            line = plain_line(progress, self._meter.pace(progress, now_s))
            words = "\n".join([*progress.notices, line])
            self._output.update(self._html(str(_SHOWN.format(progress.runs_total or 1, progress.runs_done, words))))


def notebook_display() -> NotebookDisplay | None:
    """Return the display of the current notebook cell, or None outside of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if ipython is None or getattr(shell, "kernel", None) is None:
        return None
    shown = ipython.display
    return NotebookDisplay(shown.display(shown.HTML(""), display_id=True), shown.HTML)
