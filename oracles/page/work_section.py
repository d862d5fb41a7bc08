"""What a report says of the call that wrote it, which is all of it that does not follow from the campaign's content.

A report's HTML has two pairs of marks, and between them what `with_work` puts there: `<!-- when -->`, `<!-- /when -->` for the
time in a line of text, and `<!-- work -->`, `<!-- /work -->` for a section. So a report that was kept can be given to another call.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

from markupsafe import Markup

_MARKS: Final = "(<!-- {0} -->)((?s:.*?))(<!-- /{0} -->)"
_LINE: Final = Markup("<dt>{}</dt><dd>{}</dd>\n")


def with_work(html: str, metadata: Mapping[str, Any]) -> str:
    """The report with the facts of a call between its marks; one without marks stays as it is.

    Args:
        metadata: `metadata.json` of the call's campaign directory.
    """
    for name, text in (("when", _when(metadata)), ("work", _section(metadata))):
        parts = re.split(_MARKS.format(name), html)
        html = "".join(text if place % 4 == 2 else part for place, part in enumerate(parts))
    return html


def _when(metadata: Mapping[str, Any]) -> str:
    return str(Markup(" · {}").format(str(metadata["created"]).replace("T", " ")))


def _host_line(key: str, value: Any) -> tuple[str, str]:
    if key == "memory_bytes":
        return "host memory", f"{value / 1e9:.1f} GB"
    return f"host {key.replace('_', ' ')}", str(value)


def _section(metadata: Mapping[str, Any]) -> str:
    counts = metadata.get("counts", {})
    lines = [("written", str(metadata["created"]).replace("T", " "))]
    if {"executed", "reused"} <= counts.keys():
        lines.append(("runs", f"{counts['executed']:,} executed, {counts['reused']:,} from the store"))
    if {"cpu_s", "wall_s"} <= counts.keys():
        lines += [("CPU time", f"{counts['cpu_s']:,.0f} s"), ("time", f"{counts['wall_s']:,.0f} s")]
    lines += [_host_line(key, value) for key, value in metadata["host"].items()]
    facts = "".join(_LINE.format(name, value) for name, value in lines)
    summary = '<summary><h2>This call</h2><span class="soft">when, where, and for how long</span></summary>'
    return f'\n<details class="fold" id="work">{summary}\n<div><dl>\n{facts}</dl></div>\n</details>\n'
