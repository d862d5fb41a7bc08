"""The part of a report that differs from call to call: date, work, and text of the campaign file.

The rest follows from results alone, and may be kept. Nothing here imports what draws or counts.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.parse import quote

from jinja2 import Environment, StrictUndefined
from markupsafe import escape

from vastflow.sim.model.files import read_json, read_text

_TEMPLATE: Final = Path(__file__).with_name("call.html.j2")


def finish_report(directory: Path) -> None:
    """Write into `report.html`, as `write_lasting` of `vastflow.oracles.page.report` left it, what is of this call.

    Raises:
        OSError, ValueError: a file that should be there is not, or is damaged.
    """
    metadata, page = read_json(directory / "metadata.json"), directory / "report.html"
    template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    work = template.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(metadata=metadata)
    when = f" · {escape(metadata['created'].replace('T', ' '))}"
    text = page.read_text(encoding="utf-8")
    # Marks are found once: whatever else the page shows is escaped.
    for mark, content in (("when", when), ("work", f"\n{work}\n")):
        text = text.replace(f"<!-- {mark} --><!-- /{mark} -->", f"<!-- {mark} -->{content}<!-- /{mark} -->")
    text = text.replace("<!-- file --><!-- /file -->", escape(read_text(directory / "campaign.vast")))
    page.write_text(text, encoding="utf-8", errors="backslashreplace")


def link_pages(directory: Path, pages: Sequence[str]) -> None:
    """Add links to notebooks, by their places in the directory, to a finished `report.html`; none without a report."""
    page = directory / "report.html"
    if not pages or not page.is_file():
        return
    items = "".join(f'<li><a href="{quote(each)}">{escape(each.partition("/")[2])}</a></li>' for each in pages)
    part = f'<details class="fold" id="notebooks" open><summary><h2>Notebooks</h2></summary><div><ul>{items}</ul></div></details>'
    text = page.read_text(encoding="utf-8").replace("<!-- /work -->", f"<!-- /work -->\n{part}", 1)
    page.write_text(text, encoding="utf-8", errors="backslashreplace")
