from __future__ import annotations

import importlib.util
from contextlib import ExitStack

import pytest

from catoptra_server.planning.image_effect_drawing import choose_image_effects
from helpers.image_changers import open_changer_or_skip


def test_a_graphics_processor_draws_image_effects_itself() -> None:
    choice = choose_image_effects(is_software=False)
    assert choice.changer is None
    assert "graphics processor" in choice.reason


def test_the_kernel_draws_image_effects_of_software_opengl() -> None:
    with ExitStack() as stack:
        assert "on the processor" in open_changer_or_skip(stack).reason


def test_shaders_draw_image_effects_where_the_kernel_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")
    choice = choose_image_effects(is_software=True)
    assert choice.changer is None
    assert "CATOPTRA_KERNEL" in choice.reason
    choice.close()


def test_shaders_draw_image_effects_where_embree_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: None)
    choice = choose_image_effects(is_software=True)
    assert choice.changer is None
    assert "embreex" in choice.reason or "kernel" in choice.reason
