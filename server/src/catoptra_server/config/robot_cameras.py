"""Cameras of a robot's section without a mirror: wide-angle lenses, and perspective cameras.

Both are items of `Cameras=` (UT2004) or `AddParts=` (UDK), and look along the item's x axis; y is
the right of the image. An item is a lens camera where the section of its class has a `Lens`, or a
`CalibrationFile` of another program. The keys of a lens are in LENS_PARAMETERS, here without
the prefix Lens. Cameras with a mirror: `mirror_camera`.
"""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np

from catoptra_protocol.camera_conf import LENS_PARAMETERS
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection, largest_angle_rad
from catoptra_protocol.optics.transforms import LENS_FROM_MIRROR
from catoptra_server.config.camera_sections import (
    MAX_SIDE_PX,
    read_effect_settings,
    read_min_frame_interval_s,
    read_mount,
    read_picture,
    read_render_settings,
    read_size,
    reject_impossible,
    reserve_view,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.plan.plans import perspective_view_size
from catoptra_server.render.renderer import PerPixel
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    PerspectiveCameraDescription,
)

# A camera that shows nothing at any point of such a grid shows nothing that anybody wants.
_GRID_SIDE = 33
# Anamorphic lenses squeeze by 2.
_MAX_ASPECT = 10.0
_CLASSES = ("robotcamera", "usarcamera", "camera")
# 172 degrees. A flat image plane ends at 180, where tan(fov / 2) is infinite.
_MAX_FOV_RAD = 3.0


def is_lens_camera(file: IniFile, item: SectionReader) -> bool:
    """Whether the section of an item's class has a lens."""
    section = file.get_section(item.get_str("ItemClass"))
    return section.has_key("Lens") or section.has_key("CalibrationFile")


def read_lens_camera(
    file: IniFile, robot: SectionReader, item: SectionReader
) -> OmniCameraDescription:
    """Camera of an item, with lens, resolution and effects of the class's section.

    Raises:
        ConfigError: For an unknown lens, an impossible parameter, a field of view beyond the lens's
            domain or first fold, or a view larger than the file's limit.
    """
    section = file.get_section(item.get_str("ItemClass"))
    with reject_impossible(section):
        if section.has_key("CalibrationFile"):
            camera = _read_calibrated_camera(file, section)
        else:
            camera = _read_camera(section)
        require_picture(section, camera)
    mount = read_mount(robot, item)
    description = OmniCameraDescription(
        name=item.get_wire_name("ItemName"),
        camera=camera,
        robot_from_mirror=mount.parent_from_item() @ LENS_FROM_MIRROR,
        texture_clients=(),
        render_settings=read_render_settings(
            section,
            surface=PerPixel(),
            face_size_px=section.get_int("TextureSize", 0, max_value=MAX_SIDE_PX),
        ),
        min_frame_interval_s=read_min_frame_interval_s(section),
        capture_fov_rad=2.0 * camera.rim_rad,
        effects=read_effect_settings(section, has_mirror=False),
        parent=mount.parent,
    )
    reserve_view(file, section, description)
    return description


def is_perspective_camera(item: SectionReader) -> bool:
    """Whether an item's class is a perspective camera of UT2004 or UDK."""
    return item.get_class_name("ItemClass") in _CLASSES


def read_perspective_camera(
    file: IniFile, robot: SectionReader, item: SectionReader
) -> PerspectiveCameraDescription:
    """Camera of an item, with field of view, resolution and effects of the class's section.

    Defaults and units (radians) as in UDK's DefaultUSAR.ini.

    Raises:
        ConfigError: for a value out of range, or a view larger than the file's limit.
    """
    section = file.get_section(item.get_str("ItemClass"))
    min_fov_rad = section.get_float("CameraMinFOV", 0.3491, min_value=0.01, max_value=_MAX_FOV_RAD)
    max_fov_rad = section.get_float(
        "CameraMaxFOV", 2.0944, min_value=min_fov_rad, max_value=_MAX_FOV_RAD
    )
    width_px, height_px = read_size(section, 320, 240)
    description = PerspectiveCameraDescription(
        name=item.get_wire_name("ItemName"),
        mount=read_mount(robot, item),
        width_px=width_px,
        height_px=height_px,
        fov_rad=section.get_float(
            "CameraFOV",
            # UDK's default, moved into the zoom range where the section narrows that alone.
            min(max(1.3963, min_fov_rad), max_fov_rad),
            min_value=min_fov_rad,
            max_value=max_fov_rad,
        ),
        min_fov_rad=min_fov_rad,
        max_fov_rad=max_fov_rad,
        effects=read_effect_settings(section, has_mirror=False),
    )
    camera = PerspectiveCamera(width_px, height_px, description.fov_rad)
    MemoryBudget(file.view_limit_bytes).reserve(
        perspective_view_size(
            camera, effect_bytes_per_px=description.effects.bytes_per_px
        ).num_bytes,
        where=section.find_location("ResolutionX"),
        key=f"{section.name}.ResolutionX",
        value=f"{width_px} x {height_px} px",
        remedy="fewer pixels",
    )
    return description


def _read_calibrated_camera(file: IniFile, section: SectionReader) -> OmniCamera:
    """Camera of a calibration file, in a narrower field of view if the section has one."""
    # Not at the start: most files name none.
    from catoptra_protocol.calibration.calibration_files import camera_from_file

    path = section.get_path("CalibrationFile", file.path.parent)
    name = section.get_str("CalibrationCamera", "")
    picture = read_picture(section, Picture.FLIPPED) if section.has_key("Picture") else None
    # A size of the images, for a file that states none.
    has_size = section.has_key("ResolutionX") and section.has_key("ResolutionY")
    size_px = read_size(section, 1, 1) if has_size else None
    camera = camera_from_file(path, camera=name, picture=picture, size_px=size_px)
    sides_px = camera.width_px, camera.height_px
    stated_px = read_size(section, *sides_px)
    for key, side_px, stated in zip(
        ("ResolutionX", "ResolutionY"), sides_px, stated_px, strict=True
    ):
        if stated != side_px:
            raise section.make_error(
                key, expected=f"{side_px}, as in the calibration file, or no such line"
            )
    field_deg = section.get_float("FieldOfView", 0.0, min_value=0.1, max_value=360.0)
    rim_rad = math.radians(0.5 * field_deg)
    if not field_deg:
        return camera
    if rim_rad > camera.rim_rad:
        reach = math.degrees(2.0 * camera.rim_rad)
        raise section.make_error(
            "FieldOfView",
            expected=f"at most {reach:.3f} deg: the calibration's image or first fold",
        )
    return dataclasses.replace(camera, rim_rad=rim_rad)


def _read_camera(section: SectionReader) -> OmniCamera:
    projection = _read_lens(section)
    width_px, height_px = read_size(section, 640, 640)
    picture = read_picture(section, Picture.FLIPPED)
    field_deg = section.get_float("FieldOfView", 0.0, min_value=0.1, max_value=360.0)
    rim_rad = math.radians(0.5 * field_deg)
    focal_length_px = section.get_float("FocalLength", 0.0, min_value=1e-6)
    key = "FieldOfView" if field_deg or focal_length_px else "FocalLength"
    try:
        if not focal_length_px:
            if not field_deg:
                raise DomainError(
                    "a lens has a FocalLength in px, a FieldOfView in degrees or both"
                )
            return camera_with_inscribed_rim(
                projection, width_px=width_px, height_px=height_px, rim_rad=rim_rad, picture=picture
            )
        centre_px = (
            section.get_float("CentreU", 0.5 * width_px),
            section.get_float("CentreV", 0.5 * height_px),
        )
        plane = read_plane(section, focal_length_px)
        if not field_deg:
            corner_px = max(
                hypot(u - centre_px[0], v - centre_px[1])
                for u in (0.0, width_px)
                for v in (0.0, height_px)
            )
            ratio = corner_px / focal_length_px / plane.stretch_limits[0]
            rim_rad = largest_angle_rad(projection, ratio)
        return OmniCamera(
            projection,
            width_px,
            height_px,
            centre_px,
            focal_length_px,
            rim_rad,
            0.0,
            picture,
            plane,
        )
    except DomainError as error:
        raise section.make_error(key, expected=f"a possible value: {error}") from error


def _read_lens(section: SectionReader) -> RadialProjection:
    """Lens by name, with parameters; one that has a default may be missing."""
    name = section.get_choice("Lens", list(LENSES))
    lens = LENSES[name]
    fields = {field.name: field for field in dataclasses.fields(lens)}  # type: ignore[arg-type]
    values: dict[str, float | tuple[float, ...]] = {}
    keys = ["Lens"]
    for wire_name, attribute in LENS_PARAMETERS[name]:
        key = wire_name.removeprefix("Lens")
        is_optional = fields[attribute].default is not dataclasses.MISSING
        if is_optional and not section.has_key(key):
            continue
        keys.append(key)
        is_table = "tuple" in str(fields[attribute].type)
        values[attribute] = section.get_floats(key) if is_table else section.get_float(key)
    try:
        return lens(**values)
    except DomainError as error:
        # Models name the parameter that is out of the domain; tables as a whole are the last key.
        named = (key for key in keys[1:] if re.search(rf"\b{key}\b", str(error), re.IGNORECASE))
        key = next(named, keys[-1])
        raise section.make_error(key, expected=f"a possible value: {error}") from error


def read_plane(section: SectionReader, focal_length_px: float) -> ImagePlane:
    """Stretch by a second focal length and a skew, or by OCamCalib's matrix; and decentring."""
    p1, p2 = section.get_float("P1", 0.0), section.get_float("P2", 0.0)
    if section.has_key("Stretch"):
        values = section.get_floats("Stretch")
        if len(values) != 4:
            raise section.make_error("Stretch", expected="a 2 x 2 matrix: four numbers")
        a, b, c, d = values
        return ImagePlane((a, b, c, d), p1, p2)
    skew = section.get_float("Skew", 0.0) / focal_length_px
    aspect = section.get_float("FocalLengthY", focal_length_px, min_value=1e-6) / focal_length_px
    if not 1.0 / _MAX_ASPECT <= aspect <= _MAX_ASPECT:
        raise section.make_error(
            "FocalLengthY",
            expected=f"px, as FocalLength={focal_length_px:g}: at most {_MAX_ASPECT:g} times as "
            "long or short",
        )
    return ImagePlane((1.0, skew, 0.0, aspect), p1, p2)


def require_picture(section: SectionReader, camera: OmniCamera) -> None:
    """Raise ConfigError for a camera whose picture is black all over: of a wrong unit, mostly."""
    side = np.linspace(0.0, 1.0, _GRID_SIDE)
    u, v = (np.floor(side * (length - 1)) + 0.5 for length in (camera.width_px, camera.height_px))
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    if ray_from_pixel(camera, pixels.reshape(-1, 2))[2].any():
        return
    centre_u, centre_v = camera.centre_px
    wrong = {
        "CentreU": not 0.0 <= centre_u <= camera.width_px,
        "CentreV": not 0.0 <= centre_v <= camera.height_px,
        "FieldOfView": section.has_key("FieldOfView"),
        "FocalLength": True,
    }
    raise section.make_error(
        next(key for key, is_wrong in wrong.items() if is_wrong),
        expected="a camera that shows something, with lengths in px and angles in degrees: of "
        f"{camera.width_px} x {camera.height_px} px, its field of "
        f"{math.degrees(2.0 * camera.rim_rad):.4g} deg is {2.0 * camera.rim_radius_px:.3g} px wide "
        f"around ({centre_u:g}, {centre_v:g})",
    )
