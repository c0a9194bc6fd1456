"""The channel that a frame request selects: the image port, a camera, or a variant of one."""

from __future__ import annotations

from dataclasses import replace

from catoptra_protocol.labels.channels import parse_channels
from catoptra_protocol.stream.requests import FrameVariant, GetFrameRequest
from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel, Channel
from catoptra_server.frames.plan.camera import (
    CameraVariant,
    parse_effect_modes,
    parse_picture,
    parse_reference,
    parse_renderer,
)


def select_channel(request: GetFrameRequest) -> Channel:
    """Channel of a request.

    Raises:
        DomainError: The request asks for a variant that cannot be.
    """
    variant = None if request.variant is None else _make_variant(request.variant)
    if request.channels:
        names = tuple(channel.name for channel in parse_channels(request.channels))
        variant = replace(variant or CameraVariant(), channels=names)
    if not (request.robot or request.camera or variant):
        return IMAGE_PORT
    # Robots compare the names of cameras in any case. Otherwise each spelling would be a channel of
    # its own, with a frame and a share of the time: a client that changed the spelling with every
    # request left the others 0.7 of 78 frames per second.
    return CameraChannel(request.robot, request.camera.lower(), variant)


def _make_variant(variant: FrameVariant) -> CameraVariant:
    return CameraVariant(
        max_error_px=variant.max_error_px,
        budget_ms=variant.budget_ms,
        polygons=variant.polygons,
        samples=variant.samples,
        renderer=None if variant.renderer is None else parse_renderer(variant.renderer),
        effects=parse_effect_modes(variant.effects or {}),
        reference=None if variant.reference is None else parse_reference(variant.reference),
        picture=None if variant.picture is None else parse_picture(variant.picture),
    )
