"""The type of functions that create a renderer of either kind."""

from __future__ import annotations

from collections.abc import Callable

from catoptra_server.render.renderer import Renderer
from catoptra_server.world.world_description import World

RendererFactory = Callable[[World], Renderer]
