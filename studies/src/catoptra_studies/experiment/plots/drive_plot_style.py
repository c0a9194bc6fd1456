"""How the experiment's pictures look, and the one door to matplotlib."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError

TRUTH = "#222222"
ODOMETRY = "#d1495b"
ESTIMATE = "#2e6fbb"
ACCEPTED = "#2a9d5c"
REJECTED = "#d98c21"
MUTED = "#8a8f98"
LANDMARK_COLOURS = {"cyan": "#00aadc", "magenta": "#e1238c", "yellow": "#e8c400"}

_SETTINGS = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "legend.frameon": False,
    "figure.facecolor": "white",
}
_DPI = 110


@contextmanager
def open_figure(path: Path, **arguments: Any) -> Iterator[Any]:
    """Yield a matplotlib figure with this style; it is written when the block ends."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError as error:
        raise CatoptraError(
            "pictures need matplotlib: pip install 'catoptra-client[experiment]'"
        ) from error
    with mpl.rc_context(_SETTINGS):
        # A Figure of its own: no window system, no global state.
        drawing = Figure(layout="constrained", **arguments)
        yield drawing
        drawing.savefig(path, dpi=_DPI)
