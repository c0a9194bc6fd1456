from __future__ import annotations

from catoptra_server.render.image_changer import NumpyImageChanger
from catoptra_server.render.image_effect_choice import SHADER_PASSES, ImageEffectChoice


def test_choice_names_what_draws_and_why() -> None:
    native = ImageEffectChoice(NumpyImageChanger(), "OpenGL on the processor")
    assert str(native) == "image effects by the native kernel (OpenGL on the processor)"
    assert str(SHADER_PASSES) == "image effects by shader passes (requested)"


def test_closing_shader_passes_leaves_them_to_their_views() -> None:
    SHADER_PASSES.close()
    assert SHADER_PASSES.changer is None
