"""True changes of effects: what each makes of the finished picture, in encoded grey levels.

The truth of an effect is the largest change of any pixel and channel, and the share of pixels that
change visibly: of the light that the earlier effects leave, with and without it, behind all later
image effects that are drawn, without noise.
They are the references of `effect.apply` in float64, and sharp frames of the engine for scene
effects; motion during an exposure is the mean of many sharp frames. Nothing here knows criteria,
bounds, thresholds, or what a renderer measures.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects import (
    VISIBLE_LEVELS,
    WORLD_EFFECTS,
    CaptureContext,
    Effect,
    EffectChange,
    ImageEffect,
    is_image_effect,
    is_scene_effect,
)
from catoptra_server.effects.kernels.light_sources import find_light_sources
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows
from catoptra_server.render.renderer import LinearImage
from catoptra_server.render.trace.ray_table import Float32s
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import AT_REST, Light

# Sharp frames of an exposure.
_NUM_SHARP_FRAMES = 64

# Of numbers that have nothing to do with another effect, and of rounding.
_RANDOM = frozenset({"ShotNoise", "ReadNoise", "Quantisation"})

# Fields of a state that a frame of a known pose and motion does not depend on any further.
_KNOWN_BY_POSE = frozenset({"world_from_mirror", "twist", "ego_body"})

_RenderLinear = Callable[[CameraState], LinearImage]
"""Function that renders a sharp frame, (h, w, 3) linear light."""
_MeasureRanges = Callable[[CameraState], Float32s]
"""Function that measures the (h, w) ranges of all pixels."""


@dataclass(frozen=True, slots=True)
class _Opening:
    """Times of an exposure."""

    exposure_s: float = 0.0
    readout_s: float = 0.0


@dataclass(slots=True)
class EffectTruth:
    """True changes in the frames of one camera; frames of one pose are rendered once."""

    camera: OmniCamera
    render_linear: _RenderLinear
    measure_ranges: _MeasureRanges
    lights: tuple[Light, ...] = ()
    """Lights of the world, which may be in view."""
    _pose: bytes = b""
    _known: dict[Hashable, object] = field(default_factory=dict)

    def measure(
        self, camera_state: CameraState, effects: Sequence[Effect], drawn: frozenset[str]
    ) -> dict[str, EffectChange]:
        """Change by each effect.

        Args:
            camera_state: State of the exposure, before any effect.
            effects: Effects in optical order.
            drawn: Names of the effects that act on the light of later ones.
        """
        pose = camera_state.world_from_mirror
        key = pose.rotation.tobytes() + pose.translation.tobytes()
        if key != self._pose:
            self._pose = key
            self._known.clear()
        image_effects = tuple(one for one in effects if is_image_effect(one))
        truths, state, opening = self._change_scene(camera_state, effects, drawn)
        is_moving = camera_state.twist != AT_REST
        light_key = ("image", _state_key(state), opening if is_moving else None, drawn)
        if light_key not in self._known:
            light = self._expose(state, opening)
            self._known[light_key] = self._change_image(state, light, image_effects, drawn)
        image_truths = self._known[light_key]
        assert isinstance(image_truths, dict)
        return truths | image_truths

    def _change_scene(
        self, state: CameraState, effects: Sequence[Effect], drawn: frozenset[str]
    ) -> tuple[dict[str, EffectChange], CameraState, _Opening]:
        """Changes by scene effects, and the state and times with all drawn ones."""
        truths, opening = {}, _Opening()
        for effect in effects:
            state = _show_world(state, effect, is_shown=False)
        later = _drawn_images(effects, drawn)
        context = self._make_context(state, later)
        for effect in effects:
            if not is_scene_effect(effect):
                continue
            changed, changed_opening = state, opening
            if effect.name in WORLD_EFFECTS:
                changed = _show_world(state, effect, is_shown=True)
            elif isinstance(effect, SelfView):
                if state.ego_body is not None:
                    changed = replace(state, objects=(*state.objects, state.ego_body))
            elif isinstance(effect, Shadows):
                changed = replace(state, has_shadows=True)
            elif isinstance(effect, RollingShutter):
                changed_opening = replace(opening, readout_s=effect.readout_s)
            elif isinstance(effect, MotionBlur):
                changed_opening = replace(opening, exposure_s=effect.exposure_s)
            else:
                # What a renderer draws for each sample, such as fog, needs no displacement.
                changed = effect.apply_to_scene(state, 0.0)
            before, after = self._expose(state, opening), self._expose(changed, changed_opening)
            finished = (self._finish(one, later, context) for one in (before, after))
            truths[effect.name] = _UNCHANGED if after is before else _find_change(*finished)
            if effect.name in drawn:
                state, opening = changed, changed_opening
        return truths, state, opening

    def _expose(self, state: CameraState, opening: _Opening) -> Floats:
        """Linear light of an exposure: the same array for the same light."""
        is_moving = state.twist != AT_REST or any(one.twist != AT_REST for one in state.objects)
        if not is_moving:
            opening = _Opening()
        key = ("light", _state_key(state), opening, state.twist if is_moving else None)
        if key not in self._known:
            self._known[key] = self._render(state, opening)
        light = self._known[key]
        assert isinstance(light, np.ndarray)
        return light

    def _render(self, state: CameraState, opening: _Opening) -> Floats:
        if opening == _Opening():
            return self.render_linear(state).astype(np.float64)
        rows = self.camera.height_px
        centres_s = opening.readout_s * ((np.arange(rows) + 0.5) / rows - 0.5)
        total_s = opening.exposure_s + opening.readout_s
        edges_s = (np.arange(_NUM_SHARP_FRAMES + 1) / _NUM_SHARP_FRAMES - 0.5) * total_s
        light = np.zeros((rows, self.camera.width_px, 3))
        for begin_s, end_s in pairwise(edges_s.tolist()):
            weights = _row_weights(centres_s, opening.exposure_s, begin_s, end_s)
            if weights.any():
                frame = self.render_linear(_advance(state, 0.5 * (begin_s + end_s)))
                light += weights[:, None, None] * frame
        return light

    def _change_image(
        self,
        state: CameraState,
        light: Floats,
        effects: Sequence[ImageEffect],
        drawn: frozenset[str],
    ) -> dict[str, EffectChange]:
        """Changes by image effects, each of the light behind the drawn ones before."""
        later = _drawn_images(effects, drawn)
        context = self._make_context(state, effects)
        picture = self._finish(light, later, context)
        truths = {}
        for effect in effects:
            if isinstance(effect, Defocus) and DefocusByDepth.name in drawn:
                continue  # by depth instead
            acts = effect in later
            later = later[acts:]
            changed, without = effect.apply(light, self.camera, context), light
            if isinstance(effect, DefocusByDepth):
                # Compared with the disc of infinity, which stands without this effect.
                plain = next((one for one in effects if isinstance(one, Defocus)), None)
                without = light if plain is None else plain.apply(light, self.camera, context)
            # One of both is the picture, most often.
            truths[effect.name] = _find_change(
                picture if without is light and not acts else self._finish(without, later, context),
                picture if acts else self._finish(changed, later, context),
            )
            if acts:
                light = changed
        return truths

    def _make_context(self, state: CameraState, effects: Sequence[ImageEffect]) -> CaptureContext:
        if not any(effect.needs_range for effect in effects):
            return CaptureContext(state.noise_seed)
        range_m = self.measure_ranges(state)
        sources = find_light_sources(self.lights, self.camera, state, range_m)
        return CaptureContext(state.noise_seed, range_m, sources)

    def _finish(
        self, light: Floats, effects: Sequence[ImageEffect], context: CaptureContext
    ) -> Floats:
        """Encoded picture of light behind effects."""
        for effect in effects:
            light = effect.apply(light, self.camera, context)
        return _encode(light)


def _show_world(state: CameraState, effect: Effect, *, is_shown: bool) -> CameraState:
    """State with or without light that a world's file asks for, if the effect is such light."""
    fields: dict[str, Any] = {}
    if effect.name in WORLD_EFFECTS:
        fields[WORLD_EFFECTS[effect.name]] = is_shown
    return replace(state, **fields)


def _drawn_images(effects: Sequence[Effect], drawn: frozenset[str]) -> tuple[ImageEffect, ...]:
    """Drawn image effects that no other includes, without noise."""
    included = {Defocus.name} if DefocusByDepth.name in drawn else set()
    wanted = drawn - _RANDOM - included
    return tuple(one for one in effects if is_image_effect(one) and one.name in wanted)


def _advance(state: CameraState, time_s: float) -> CameraState:
    """Camera state at another time, camera and objects moved by their twists."""
    objects = (
        replace(one, world_from_object=one.twist.integrate_pose(one.world_from_object, time_s))
        for one in state.objects
    )
    pose = state.twist.integrate_pose(state.world_from_mirror, time_s)
    return replace(state, world_from_mirror=pose, objects=tuple(objects))


def _encode(light: Floats) -> Floats:
    """Encoded grey levels of linear light, 0 to 255, not rounded. Source: IEC 61966-2-1."""
    clipped = np.clip(light, 0.0, 1.0)
    encoded = clipped ** (1.0 / 2.4)
    encoded *= 269.025
    encoded -= 14.025
    dark = clipped <= 0.0031308
    encoded[dark] = 3294.6 * clipped[dark]
    return encoded


_UNCHANGED = EffectChange(0.0)


def _find_change(before: Floats, after: Floats) -> EffectChange:
    """Change between two pictures: of each pixel the channel that differs most."""
    changes = np.abs(after - before).max(axis=-1)
    return EffectChange(float(changes.max()), float((changes > VISIBLE_LEVELS).mean()))


def _row_weights(centres_s: Floats, exposure_s: float, begin_s: float, end_s: float) -> Floats:
    """(rows,) fraction of each row's exposure within an interval."""
    if exposure_s == 0.0:
        return ((centres_s >= begin_s) & (centres_s < end_s)).astype(np.float64)
    half_s = 0.5 * exposure_s
    overlap_s = np.minimum(end_s, centres_s + half_s) - np.maximum(begin_s, centres_s - half_s)
    weights: Floats = np.maximum(overlap_s, 0.0) / exposure_s
    return weights


def _state_key(state: CameraState) -> Hashable:
    """What a sharp frame of a known pose depends on."""
    return tuple(
        tuple(id(one.mesh) for one in state.objects) if name == "objects" else getattr(state, name)
        for name in CameraState.__dataclass_fields__
        if name not in _KNOWN_BY_POSE
    )
