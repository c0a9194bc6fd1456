"""Cameras to plan and prepare views for: the camera model with the requested settings."""

from __future__ import annotations

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.render.render_settings import RenderSettings


@dataclass(frozen=True, slots=True)
class OmniCameraSpec:
    """An omnidirectional camera with the settings under which frames are rendered."""

    camera: OmniCamera
    render_settings: RenderSettings
    effect_settings: EffectSettings = NO_EFFECT_SETTINGS


@dataclass(frozen=True, slots=True)
class PerspectiveCameraSpec:
    """A perspective camera with the effects of its frames."""

    camera: PerspectiveCamera
    effect_settings: EffectSettings = NO_EFFECT_SETTINGS


# Compared by value: robots of one class share a plan and a prepared view.
CameraSpec = OmniCameraSpec | PerspectiveCameraSpec
