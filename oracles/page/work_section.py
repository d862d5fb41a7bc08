"""Facts of the call that wrote a report, which is all of it that does not follow from the campaign's content.

The template puts them between comments, so that two reports can be compared without them.
"""

from collections.abc import Mapping
from typing import Any, Final

from markupsafe import Markup

_LINE: Final = Markup("<dt>{}</dt><dd>{}</dd>\n")


def created(metadata: Mapping[str, Any]) -> str:
    """The time of the call, from `metadata.json`."""
    return str(metadata["created"]).replace("T", " ")


def _host_line(key: str, value: Any) -> tuple[str, str]:
    if key == "memory_bytes":
        return "host memory", f"{value / 1e9:.1f} GB"
    return f"host {key.replace('_', ' ')}", str(value)


def work_section(metadata: Mapping[str, Any]) -> Markup:
    """The section on the call: when, where, and for how long."""
    counts = metadata.get("counts", {})
    lines = [("written", created(metadata))]
    if {"executed", "reused"} <= counts.keys():
        lines.append(("runs", f"{counts['executed']:,} executed, {counts['reused']:,} from the store"))
    if {"cpu_s", "wall_s"} <= counts.keys():
        lines += [("CPU time", f"{counts['cpu_s']:,.0f} s"), ("time", f"{counts['wall_s']:,.0f} s")]
    lines += [_host_line(key, value) for key, value in metadata["host"].items()]
    facts = "".join(_LINE.format(name, value) for name, value in lines)
    summary = '<summary><h2>This call</h2><span class="soft">when, where, and for how long</span></summary>'
    return Markup(f'\n<details class="fold" id="work">{summary}\n<div><dl>\n{facts}</dl></div>\n</details>\n')
