"""Pictures: a figure as the bytes of a PNG or an SVG file. The same figure gives the same bytes."""

import io
from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib
from matplotlib.figure import Figure


@contextmanager
def plain_style() -> Iterator[None]:
    """Matplotlib as it comes: no `matplotlibrc` of a user changes a picture that is kept for everybody."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


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
