"""What draws the image effects of a renderer, with the reason.

Raster has two ways: passes of shaders on its device, drawn everywhere and decided by bounds; or an
image changer, to which it reads back each exposure, and which draws by cells and measures changes.
"""

from __future__ import annotations

from collections.abc import Callable

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.image_changer import ImageChanger


def _free_nothing() -> None:
    """Free nothing: shader passes belong to their views."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageEffectChoice:
    """Drawing of image effects for all views of a renderer."""

    changer: ImageChanger | None
    """Changes images that are read back; None for passes of shaders."""
    reason: str
    close: Callable[[], None] = _free_nothing
    """Frees the changer, after the views."""

    def __str__(self) -> str:
        by = "shader passes" if self.changer is None else "the native kernel"
        return f"image effects by {by} ({self.reason})"


SHADER_PASSES = ImageEffectChoice(None, "requested")
"""Effects on the renderer's own device."""
