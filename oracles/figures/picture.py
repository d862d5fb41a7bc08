"""Pictures: a figure as the bytes of a PNG or an SVG file. The same figure gives the same bytes."""

import io

import matplotlib
from matplotlib.figure import Figure


def png(figure: Figure) -> bytes:
    """`figure` as a picture of its own resolution."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def svg(figure: Figure) -> bytes:
    """`figure` as a drawing; what is marked as rasterized in it, such as dense trajectories, is a picture inside.

    Text stays text: it can be searched, and files are a third of the size.
    """
    out = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "vastflow", "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()
