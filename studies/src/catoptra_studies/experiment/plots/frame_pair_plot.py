"""Two omnidirectional frames beside each other, pixel by pixel."""

from __future__ import annotations

from pathlib import Path

from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_studies import plot_style

_WIDTH_PX, _TOP_PX = 720, 60


def draw_frame_pair(path: Path, panels: tuple[tuple[str, UInt8Array], ...]) -> None:
    """Write the central squares of two (title, frame), in which the mirror is."""
    with plot_style.open_page(path, _TOP_PX + _WIDTH_PX + 20) as page:
        for index, (title, rgb) in enumerate(panels):
            left = 20 + index * (_WIDTH_PX + 40)
            plot_style.add_text(page, left, _TOP_PX - 12, title, va="bottom", fontweight="bold")
            plot_style.show_image(page, _central_square(rgb), left, _TOP_PX, _WIDTH_PX)


def _central_square(rgb: UInt8Array) -> UInt8Array:
    """The largest square around the centre: the mirror's disc touches its sides."""
    rows, columns = rgb.shape[:2]
    size = min(rows, columns)
    top, left = (rows - size) // 2, (columns - size) // 2
    return rgb[top : top + size, left : left + size]
