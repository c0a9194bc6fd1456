from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from catoptra_server.render.raster import device as fog_uniform
from catoptra_server.world.camera_state import FogMedium


@pytest.mark.parametrize(
    ("fog", "expected"),
    [(None, (0.0, 0.0, 0.0, 0.0)), (FogMedium(0.3, (0.5, 0.6, 0.7)), (0.5, 0.6, 0.7, 0.3))],
)
def test_fog_of_a_program_is_its_airlight_and_its_density(
    monkeypatch: pytest.MonkeyPatch, fog: FogMedium | None, expected: tuple[float, ...]
) -> None:
    written: dict[str, Any] = {}
    monkeypatch.setattr(
        fog_uniform, "set_uniform", lambda _, name, value: written.update({name: value})
    )
    fog_uniform.set_fog(SimpleNamespace(), fog)  # type: ignore[arg-type]
    np.testing.assert_allclose(written["fog"], expected)
