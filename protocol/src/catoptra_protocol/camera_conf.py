"""Camera models as pairs of a CONF line: written by the server, read by the client.

The four fields of view of UT2004 come first, for old clients: those of the capture camera, across
the image width. Then our extension (SPEC.md 5.5), in the shortest decimals that read back as the
same doubles (the rim passes through degrees and may differ in its last bit). The only module that
knows both sides: it works on pairs, so that neither the wire nor the optics imports the other.

To add a mirror or a lens: its line in `MIRROR_PARAMETERS` or `LENS_PARAMETERS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

from catoptra_protocol.errors import DomainError, RemoteProtocolError
from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.elementary import arctan
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import MIRRORS, Mirror
from catoptra_protocol.optics.numerics import reject_overflow
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass

Pairs = tuple[tuple[str, str], ...]
_Parameters = tuple[tuple[str, str], ...]

# Parameters of each projection: the name on the wire and the attribute, a number or a tuple of
# numbers.
MIRROR_PARAMETERS: dict[str, _Parameters] = {
    "hyperbolic": (("MirrorK", "k"), ("MirrorC", "c_m")),
    "parabolic": (("MirrorHorizonRadius", "horizon_radius_m"),),
    "spherical": (
        ("MirrorRadius", "radius_m"),
        ("MirrorCentreDistance", "centre_distance_m"),
        ("MirrorRim", "rim_rad"),
    ),
    "conical": (
        ("MirrorHalfAngle", "half_angle_rad"),
        ("MirrorApexDistance", "apex_distance_m"),
        ("MirrorRim", "rim_rad"),
    ),
    "equiangular": (
        ("MirrorGain", "gain"),
        ("MirrorVertexDistance", "vertex_distance_m"),
        ("MirrorRim", "rim_rad"),
    ),
    "profile": (
        ("MirrorRadii", "radii_m"),
        ("MirrorSags", "sags_m"),
        ("MirrorVertexDistance", "vertex_distance_m"),
        ("MirrorRim", "rim_rad"),
    ),
    "radial_table": (
        ("MirrorAngles", "angles_deg"),
        ("MirrorImageRadii", "image_radii"),
        ("MirrorVertexDistance", "vertex_distance_m"),
        ("MirrorRim", "rim_rad"),
    ),
}
LENS_PARAMETERS: dict[str, _Parameters] = {
    "equidistant": (),
    "equisolid": (),
    "stereographic": (),
    "orthographic": (),
    "kannala_brandt": (("LensK1", "k1"), ("LensK2", "k2"), ("LensK3", "k3"), ("LensK4", "k4")),
    "unified": (("LensXi", "xi"), ("LensK1", "k1"), ("LensK2", "k2")),
    "enhanced_unified": (("LensAlpha", "alpha"), ("LensBeta", "beta")),
    "double_sphere": (("LensXi", "xi"), ("LensAlpha", "alpha")),
    "ocam": (("LensPolynomial", "polynomial"),),
    "woodscape": (("LensK1", "k1"), ("LensK2", "k2"), ("LensK3", "k3"), ("LensK4", "k4")),
    "f_theta": (("LensK1", "k1"), ("LensK2", "k2"), ("LensK3", "k3"), ("LensK4", "k4")),
    "radial_table": (("LensAngles", "angles_deg"), ("LensRadii", "radii")),
}

# Numbers of a pair with several values, such as a table's: a camera's pairs are a datagram.
_MAX_VALUES = 4096


@dataclass(frozen=True, slots=True)
class _Kind:
    """Projections of one kind on the wire."""

    key: str
    """Name of the pair that names the projection."""
    types: LazyTable[type[Mirror]] | LazyTable[type[RadialProjection]]
    parameters: Mapping[str, _Parameters]


_KINDS = (
    _Kind("Mirror", MIRRORS, MIRROR_PARAMETERS),
    _Kind("Lens", LENSES, LENS_PARAMETERS),
)

# Name of the scale: mirrors with the 90-degree circle as unit state h of Eq. 2.
_HORIZON_UNIT = ("hyperbolic", "parabolic")

# Value of Projection in the model of an ordinary camera; an omnidirectional one has a Mirror or a
# Lens.
_PERSPECTIVE_PROJECTION = "perspective"

# Cameras whose pairs stay formatted: every frame header carries the pairs, formatting takes 7
# microseconds, a lookup 0.5. More cameras than a server has robots; each zoom step is one entry.
_NUM_CACHED_CAMERAS = 512


@lru_cache(maxsize=_NUM_CACHED_CAMERAS)
def pairs_from_omni_camera(camera: OmniCamera, viewpoint_height_m: float) -> Pairs:
    """Pairs after {Type Camera} {Name N} in the CONF of an omnidirectional camera.

    Cached by value: a frozen camera is formatted once, not for every frame.

    Args:
        camera: Camera model.
        viewpoint_height_m: Height of the effective viewpoint above the floor, robot upright.
    """
    fov = f"{_capture_fov_deg(camera):.4f}"
    pairs = _pairs_from_projection(camera.projection)
    # The capture camera has no zoom: default, minimum, maximum and present value are the same.
    names = ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov")
    return (
        *((name, fov) for name in names),
        ("Width", str(camera.width_px)),
        ("Height", str(camera.height_px)),
        *pairs,
        ("CentreU", _format_number(camera.centre_px[0])),
        ("CentreV", _format_number(camera.centre_px[1])),
        (_scale_key(pairs), _format_number(camera.scale_px)),
        ("RimAngle", _format_number(math.degrees(camera.rim_rad))),
        ("UpAzimuth", _format_number(camera.image_up_azimuth_rad)),
        ("Picture", camera.picture.value),
        *_pairs_from_plane(camera.plane),
        *((("Central", "approximated"),) if camera.is_approximated else ()),
        ("ViewpointHeight", _format_number(viewpoint_height_m)),
    )


def omni_camera_from_pairs(pairs: Pairs) -> tuple[OmniCamera, float]:
    """Camera model of the pairs, and the height of its viewpoint in metres.

    Unknown pairs are ignored.

    Raises:
        RemoteProtocolError: A field is missing or wrong; names the field.
    """
    with reject_overflow(RemoteProtocolError):
        return _make_omni_camera(pairs), _parse_number(pairs, "ViewpointHeight")


def _make_omni_camera(pairs: Pairs) -> OmniCamera:
    projection = _projection_from_pairs(pairs)
    scale_key = _scale_key(_pairs_from_projection(projection))
    try:
        return OmniCamera(
            projection=projection,
            width_px=_parse_side_px(pairs, "Width"),
            height_px=_parse_side_px(pairs, "Height"),
            centre_px=(_parse_number(pairs, "CentreU"), _parse_number(pairs, "CentreV")),
            scale_px=_parse_number(pairs, scale_key),
            rim_rad=math.radians(_parse_number(pairs, "RimAngle")),
            image_up_azimuth_rad=_parse_number(pairs, "UpAzimuth"),
            picture=_parse_picture(pairs),
            plane=_plane_from_pairs(pairs),
            is_approximated=_parse_central(pairs),
        )
    except DomainError as error:
        raise RemoteProtocolError(f"CONF of an impossible camera: {error}") from error


@lru_cache(maxsize=_NUM_CACHED_CAMERAS)
def pairs_from_perspective_camera(camera: PerspectiveCamera) -> Pairs:
    """Pairs of an ordinary camera in frame headers of the stream; cached by value."""
    return (
        ("Projection", _PERSPECTIVE_PROJECTION),
        ("Width", str(camera.width_px)),
        ("Height", str(camera.height_px)),
        ("HorizontalFov", _format_number(camera.horizontal_fov_rad)),
    )


def any_camera_from_pairs(pairs: Pairs) -> OmniCamera | PerspectiveCamera:
    """Camera model of the pairs of a frame header, of either kind.

    Raises:
        RemoteProtocolError: A field is missing or wrong; names the field.
    """
    # By Projection and not by Mirror, so that a header without either names the missing Mirror.
    if dict(pairs).get("Projection") != _PERSPECTIVE_PROJECTION:
        return omni_camera_from_pairs(pairs)[0]
    sides = _parse_side_px(pairs, "Width"), _parse_side_px(pairs, "Height")
    try:
        return PerspectiveCamera(*sides, _parse_number(pairs, "HorizontalFov"))
    except DomainError as error:
        raise RemoteProtocolError(f"an impossible camera: {error}") from error


def _pairs_from_projection(projection: RadialProjection) -> Pairs:
    for kind in _KINDS:
        # By exact type: the projection classes know no names of the wire.
        name = kind.types.find_name(type(projection))
        if name is not None:
            parameters = (
                (key, _format_numbers(getattr(projection, attribute)))
                for key, attribute in kind.parameters[name]
            )
            return ((kind.key, name), *parameters)
    raise AssertionError(f"no line of MIRRORS or LENSES for {projection!r}")


def _projection_from_pairs(pairs: Pairs) -> RadialProjection:
    names = {key.lower() for key, _ in pairs}
    # By Mirror where neither is there: the error names the commoner one.
    kind = next((kind for kind in _KINDS if kind.key.lower() in names), _KINDS[0])
    name = _require_value(pairs, kind.key).lower()
    if name not in kind.types:
        raise _field_error(kind.key, name, "one of " + ", ".join(kind.types))
    parameters = {attribute: _parse_numbers(pairs, key) for key, attribute in kind.parameters[name]}
    try:
        return kind.types[name](**parameters)
    except (DomainError, TypeError) as error:
        raise RemoteProtocolError(f"CONF of an impossible {kind.key.lower()}: {error}") from error


def _scale_key(projection: Pairs) -> str:
    return "HorizonRadius" if projection[0][1] in _HORIZON_UNIT else "FocalLength"


def _pairs_from_plane(plane: ImagePlane) -> Pairs:
    if plane.is_radial:
        return ()
    numbers = (*plane.stretch, plane.p1, plane.p2)
    return (("ImagePlane", _format_numbers(numbers)),)


def _plane_from_pairs(pairs: Pairs) -> ImagePlane:
    if not any(key.lower() == "imageplane" for key, _ in pairs):
        return ImagePlane()
    values = _parse_numbers(pairs, "ImagePlane")
    if not isinstance(values, tuple) or len(values) != 6:
        raise _field_error("ImagePlane", str(values), "a 2 x 2 matrix, p1 and p2: six numbers")
    a, b, c, d, p1, p2 = values
    return ImagePlane((a, b, c, d), p1, p2)


def _parse_picture(pairs: Pairs) -> Picture:
    value = _require_value(pairs, "Picture")
    try:
        return Picture(value.lower())
    except ValueError:
        expected = " or ".join(picture.value for picture in Picture)
        raise _field_error("Picture", value, expected) from None


def _parse_central(pairs: Pairs) -> bool:
    values = [value for key, value in pairs if key.lower() == "central"]
    if values and values[0].lower() != "approximated":
        raise _field_error("Central", values[0], "approximated, or no such field")
    return bool(values)


def _capture_fov_deg(camera: OmniCamera) -> float:
    """Field of view of the capture camera across the image width; 0 if telecentric or a lens's."""
    if not camera.has_mirror:
        return 0.0
    # atan2 and not atan of the quotient: the focal length may vanish or overflow for extreme h, k.
    tangent = 0.5 * camera.width_px * camera.inverse_focal_length
    return math.degrees(2.0 * arctan(tangent))


def _format_numbers(value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_format_number, value))
    return _format_number(value)


def _format_number(value: float) -> str:
    """Shortest decimal that reads back as this double."""
    return repr(float(value))


def _require_value(pairs: Pairs, name: str) -> str:
    for key, value in pairs:
        if key.lower() == name.lower():
            return value
    raise RemoteProtocolError(
        f"CONF of a camera without {{{name}}}: is it an omnidirectional camera of Catoptra?"
    )


def _parse_number(pairs: Pairs, name: str) -> float:
    text = _require_value(pairs, name)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _field_error(name, text, "a finite number")
    return value


def _parse_numbers(pairs: Pairs, name: str) -> float | tuple[float, ...]:
    """A number, or several with commas between."""
    text = _require_value(pairs, name)
    if "," not in text:
        return _parse_number(pairs, name)
    if text.count(",") >= _MAX_VALUES:
        raise _field_error(name, text, f"at most {_MAX_VALUES} numbers")
    return tuple(_parse_number(((name, part),), name) for part in text.split(","))


def _parse_side_px(pairs: Pairs, name: str) -> int:
    value = _parse_number(pairs, name)
    # Clients build lookup tables with an entry per pixel, so a header must not choose their size.
    if not (value.is_integer() and 1 <= value <= MAX_IMAGE_SIDE_PX):
        expected = f"an integer number of pixels, 1 to {MAX_IMAGE_SIDE_PX}"
        raise _field_error(name, _require_value(pairs, name), expected)
    return int(value)


def _field_error(name: str, value: str, expected: str) -> RemoteProtocolError:
    return RemoteProtocolError(f"CONF of a camera: {{{name} {value[:80]}}}: expected {expected}")
