"""What the sections of all cameras share: mount, image, samples, accuracy, effects and memory.

Mounts are in SI units whatever the units of the file. The keys of effects are in EFFECT_TYPES of
`effects/`: `ShotNoise=auto` is a mode, `FullWell=18000` a parameter that several effects share.
An effect without a mode is neither simulated nor reported. The keys are the same for cameras with a
mirror and without; the latter reject effects of mirrors.

Unreal units (UU) are converted to metres and radians: 250 UU per metre, 65536 UU per turn. Source:
UnitsConverter.uc of USARSim.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from typing import Any

from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.numerics import reject_overflow
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader, Vector, read_columns
from catoptra_server.effects import (
    EFFECT_TYPES,
    NO_EFFECT_SETTINGS,
    DecisionBasis,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)
from catoptra_server.frames.plan.plans import omni_view_size, requested_samples
from catoptra_server.render.renderer import AccuracyTarget, MirrorSurface, RenderSettings
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.simulation.robot_description import Mount, OmniCameraDescription

_UU_PER_METRE = 250.0
_UU_PER_RADIAN = 65536.0 / (2.0 * math.pi)


def metres_from_uu(length_uu: float) -> float:
    """Length in metres of a length in Unreal units."""
    return _require_finite(length_uu) / _UU_PER_METRE


def radians_from_uu(angle_uu: float) -> float:
    """Angle in radians of an angle in Unreal rotation units."""
    return _require_finite(angle_uu) / _UU_PER_RADIAN


def _require_finite(value_uu: float) -> float:
    """Pass a finite value through; DomainError for NaN and infinity."""
    if not math.isfinite(value_uu):
        raise DomainError(f"{value_uu!r} Unreal units are no length and no angle")
    return value_uu


# The largest body that a file may describe.
_MAX_OFFSET_M = 100.0
MAX_SIDE_PX = 8192
"""8192^2 raw pixels are 201 MB for a frame; the largest texture of OpenGL devices is not far
above."""
_MODES = [mode.value for mode in EffectMode]
_BASES = [basis.value for basis in DecisionBasis]
_DEFAULT_BASIS = DecisionBasis.MEASURED.value


def read_mount(robot: SectionReader, item: SectionReader, key: str = "Position") -> Mount:
    """Mount of an item, relative to the Parent or, without one, to the chassis.

    Args:
        robot: the robot's section, whose bMountByUU switches to Unreal units.
        item: the item's struct.
        key: name of the position's key.

    Raises:
        ConfigError: A position far from the robot.
    """
    position, direction = (
        item.get_vector(key, (0.0, 0.0, 0.0)),
        item.get_vector("Direction", (0.0, 0.0, 0.0)),
    )
    # UT2004's own switch: 250 Unreal units to the metre, 65536 to the turn.
    if robot.get_bool("bMountByUU", False):
        x, y, z = (metres_from_uu(value) for value in position)
        roll, pitch, yaw = (radians_from_uu(value) for value in direction)
        position, direction = (x, y, z), (roll, pitch, yaw)
    require_on_robot(item, key, position)
    parent = item.get_wire_name("Parent", CHASSIS_MOUNT) or CHASSIS_MOUNT
    return Mount(position, direction, parent)


def require_on_robot(item: SectionReader, key: str, position_m: Vector) -> None:
    """Check that a position is near the robot.

    Raises:
        ConfigError: The position is more than _MAX_OFFSET_M away in some direction.
    """
    if max(map(abs, position_m)) > _MAX_OFFSET_M:
        raise item.make_error(key, expected=f"a position within {_MAX_OFFSET_M:g} m of its parent")


def read_size(section: SectionReader, width_px: int, height_px: int) -> tuple[int, int]:
    """Width and height of a camera's images in pixels, with their defaults."""
    width, height = (
        section.get_int(key, default, min_value=1, max_value=MAX_SIDE_PX)
        for key, default in (("ResolutionX", width_px), ("ResolutionY", height_px))
    )
    return width, height


def read_picture(section: SectionReader, default: Picture) -> Picture:
    """Hand of a camera's picture."""
    names = [picture.value for picture in Picture]
    return Picture(section.get_choice("Picture", names, default.value))


def reject_impossible(section: SectionReader) -> AbstractContextManager[None]:
    """Block that makes a camera: numbers that cannot be computed with are an error of the section.

    Raises:
        ConfigError: An overflow, a division by 0, or a system of equations without a solution.
    """
    return reject_overflow(
        lambda reason: ConfigError(
            section.where, key="section", value=section.name, expected=reason
        )
    )


def read_min_frame_interval_s(section: SectionReader) -> float:
    """Shortest simulation time between two exposures."""
    return section.get_float("FrameInterval", 0.0, min_value=0.0, max_value=60.0)


def read_render_settings(
    section: SectionReader,
    *,
    surface: MirrorSurface,
    face_size_px: int,
    central_error_px: float = 0.0,
) -> RenderSettings:
    """Settings of a camera's frames.

    Args:
        section: the capture camera's section.
        surface: the mirror's mesh, or the exact surface.
        face_size_px: texels along a cube face; 0 lets the plan choose sizes by density.
        central_error_px: error up to which frames of a mirror without a viewpoint may have one.
    """
    return RenderSettings(
        surface=surface,
        # Without a key the plan's default, which is no number of samples that a file could state.
        samples=section.get_int("Samples", 0, min_value=1, max_value=16),
        face_size_px=face_size_px,
        face_samples=section.get_int("FaceSamples", 0, min_value=1, max_value=8),
        central_error_px=central_error_px,
        accuracy_target=AccuracyTarget(
            max_error_px=section.get_float("MaxErrorPx", 0.0, min_value=0.0, max_value=1000.0),
            budget_ms=section.get_float("BudgetMs", 0.0, min_value=0.0, max_value=60_000.0),
        ),
    )


def reserve_view(file: IniFile, section: SectionReader, omni: OmniCameraDescription) -> None:
    """Raise ConfigError for a view that would take too much memory, before any is taken."""
    camera, settings = omni.camera, omni.render_settings
    size = omni_view_size(camera, settings, effect_bytes_per_px=omni.effects.bytes_per_px)
    samples = requested_samples(settings)
    faces = f", faces of {settings.face_size_px} px" if settings.face_size_px else ""
    MemoryBudget(file.view_limit_bytes).reserve(
        size.num_bytes,
        where=section.find_location("ResolutionX"),
        key=f"{section.name}.ResolutionX",
        value=f"{camera.width_px} x {camera.height_px} px, Samples={samples}{faces}",
        remedy="fewer pixels, Samples, or texels (TextureSize, FaceSamples)",
    )


def read_effect_settings(
    section: SectionReader, *, has_mirror: bool = True, has_viewpoint: bool = True
) -> EffectSettings:
    """Settings of the effects that a camera's section gives a mode, in optical order.

    Args:
        section: the section of the capture camera, or of a camera without a mirror.
        has_mirror: whether the camera has a mirror.
        has_viewpoint: whether the mirror has a single viewpoint.

    Raises:
        ConfigError: for an effect that such a camera cannot have, a parameter outside its range or
            an unknown mode.
    """
    named = [EFFECT_TYPES[name] for name in EFFECT_TYPES if section.has_key(name)]
    for kind in named:
        if kind.needs_mirror and not has_mirror:
            known = [one.name for one in EFFECT_TYPES.values() if not one.needs_mirror]
            expected = f"an effect of a lens, which has no mirror: {', '.join(known)}"
        elif has_mirror and kind.needs_viewpoint and not has_viewpoint:
            expected = (
                "no such effect of a mirror without a single viewpoint: its virtual image is "
                "astigmatic, which is not simulated"
            )
        else:
            continue
        raise section.make_error(kind.name, expected=expected)
    settings = [_read_effect_setting(section, kind) for kind in named]
    found = EffectSettings(
        tuple(setting for setting in settings if setting is not None),
        *_read_visibility(section),
        basis=DecisionBasis(section.get_choice("EffectDecision", _BASES, _DEFAULT_BASIS)),
        threshold_px=_read_threshold_px(section),
    )
    # Other keys may be parameters of effects without a mode. These are checked, too: a typing error
    # is found before the effect is switched on.
    if section.has_unread_keys:
        for kind in EFFECT_TYPES.values():
            if has_mirror or not kind.needs_mirror:
                _read_effect_setting(section, kind)
    return found


def _read_effect_setting(section: SectionReader, kind: EffectType) -> EffectSetting | None:
    """Setting of one effect; None without a mode."""
    values: dict[str, Any] = {
        p.field: section.get_float(p.key, p.default, min_value=p.min_value, max_value=p.max_value)
        for p in kind.parameters
    }
    curve = section.get_str(kind.curve_key, "") if kind.curve_key else ""
    if curve:
        rows = kind.curves.get(curve.lower())
        if rows is None:
            light, grey = read_columns(section, kind.curve_key, ("light", "grey"))
            rows = tuple(zip(light, grey, strict=True)) or ((0.0, 0.0),)
        values["curve"] = rows
    mode = section.get_choice(kind.name, _MODES, "")
    if not mode:
        return None
    effect = kind.factory(**values)
    fault = kind.find_fault(effect) if kind.find_fault else None
    if fault:
        raise section.make_error(fault.key, expected=fault.expected)
    return EffectSetting(effect, EffectMode(mode))


def _read_visibility(section: SectionReader) -> tuple[float, float]:
    """Largest change that nobody misses, and share of the pixels that may change visibly."""
    if section.has_key("EffectThreshold"):
        if section.has_key("MaxChange") or section.has_key("VisibleShare"):
            expected = "either this key, or MaxChange and VisibleShare in its place"
            raise section.make_error("EffectThreshold", expected=expected)
        # The key of earlier files: any share of the pixels may change by that much.
        return section.get_float("EffectThreshold", min_value=0.0, max_value=255.0), 1.0
    default = NO_EFFECT_SETTINGS
    return (
        section.get_float("MaxChange", default.max_change, min_value=0.0, max_value=255.0),
        section.get_float("VisibleShare", default.visible_share, min_value=0.0, max_value=1.0),
    )


def _read_threshold_px(section: SectionReader) -> float | None:
    if not section.has_key("EffectThresholdPx"):
        return None
    return section.get_float("EffectThresholdPx", min_value=0.0, max_value=1000.0)
