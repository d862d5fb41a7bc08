"""The picture of a minimization: the scenario before, and beside it what is left."""

import io
from dataclasses import replace

from PIL import Image

from vastflow.flows.plan.preview import plan_view_of
from vastflow.oracles.figures.picture import png
from vastflow.oracles.figures.plan_view import plan_view_figure
from vastflow.producers.model.configuration import Configuration


def before_and_after(before: Configuration, after: Configuration) -> bytes:
    """A PNG of two plan views side by side."""
    pictures = []
    for title, configuration in (("before", before), ("minimized", after)):
        view = replace(plan_view_of(configuration), title=title)
        pictures.append(Image.open(io.BytesIO(png(plan_view_figure(view)))).convert("RGB"))
    width, height = sum(each.width for each in pictures), max(each.height for each in pictures)
    both = Image.new("RGB", (width, height), "white")
    x = 0
    for each in pictures:
        both.paste(each, (x, 0))
        x += each.width
    out = io.BytesIO()
    both.save(out, format="png")
    return out.getvalue()
