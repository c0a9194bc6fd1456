"""Images in linear light on the device: written by one pass, read by the next or read back."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_server.render.raster.passes import image_bytes
from catoptra_server.render.renderer import LinearImage


class LinearImageTarget:
    """A float32 image on the device: a texture to read, a framebuffer to draw into."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self.texture = context.texture((width, height), 4, dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.target = context.framebuffer([self.texture])

    @property
    def memory_bytes(self) -> int:
        """Size of the texture."""
        return image_bytes(self.texture)

    def read(self) -> LinearImage:
        """Read the image back as an (h, w, 3) array."""
        width, height = self.texture.size
        data = self.target.read(components=3, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width, 3)

    def close(self) -> None:
        """Free texture and framebuffer."""
        self.target.release()
        self.texture.release()
