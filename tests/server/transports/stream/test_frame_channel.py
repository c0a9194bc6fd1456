"""Channels that requests select, and variants that cannot be."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest, ImageEncoding
from catoptra_server.effects.effect import EffectMode
from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel, Channel
from catoptra_server.frames.plan.camera import CameraVariant, ReferenceKind
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.serve.stream.frames import select_channel


def select(robot: str, camera: str, variant: FrameVariant | None = None) -> Channel:
    return select_channel(GetFrameRequest(1, robot, camera, ImageEncoding.RAW, variant))


def test_empty_names_select_the_image_port_and_others_a_camera() -> None:
    assert select("", "") == IMAGE_PORT
    assert select("R", "") == CameraChannel("R", "")
    assert select("", "omni") == CameraChannel("", "omni")


@pytest.mark.parametrize("variant", [None, FrameVariant(samples=2)], ids=["camera", "variant"])
def test_camera_in_any_letter_case_has_one_channel(variant: FrameVariant | None) -> None:
    spellings = ("PanoCam", "panocam", "PANOCAM", "pAnOcAm")
    assert len({select("R", spelling, variant) for spelling in spellings}) == 1


def test_variant_selects_a_channel_of_its_own() -> None:
    variant = FrameVariant(
        max_error_px=0.0,
        budget_ms=5.0,
        polygons=64,
        samples=2,
        renderer="trace",
        effects={"Fog": "never"},
        reference="exact",
        picture="flipped",
    )
    expected = CameraVariant(
        max_error_px=0.0,
        budget_ms=5.0,
        polygons=64,
        samples=2,
        renderer=RendererKind.TRACE,
        effects=(("Fog", EffectMode.NEVER),),
        reference=ReferenceKind.EXACT,
        picture=Picture.FLIPPED,
    )
    assert select("", "", variant) == CameraChannel("", "", expected)


@pytest.mark.parametrize(
    "variant",
    [
        FrameVariant(polygons=5),
        FrameVariant(renderer="gpu"),
        FrameVariant(effects={"Fog": "perhaps"}),
        FrameVariant(reference="better"),
        FrameVariant(budget_ms=-1.0),
    ],
)
def test_impossible_variant_is_refused(variant: FrameVariant) -> None:
    with pytest.raises(DomainError):
        select("", "", variant)
