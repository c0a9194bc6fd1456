"""Image effects by the native kernel, for raster; tests are skipped where it cannot run."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from catoptra_server.planning.image_effect_drawing import choose_image_effects
from catoptra_server.render.image_effect_choice import ImageEffectChoice


def open_changer_or_skip(stack: ExitStack) -> ImageEffectChoice:
    """Image effects by two threads of the kernel, which end with the stack."""
    choice = choose_image_effects(is_software=True, threads=2)
    if choice.changer is None:
        pytest.skip(choice.reason)
    stack.callback(choice.close)
    return choice
