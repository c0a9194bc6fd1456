"""The camera law as pairs of a CONF line: written by the server, read by the client.

UT2004's four fields of view come first, for old clients; they are the capture camera's own, across
the image's width. Then our extension, in the shortest decimals that read back as the same doubles
(the rim passes through degrees and may differ by its last bit). The one module that knows both
worlds: it works on pairs, so neither the wire nor the optics learns of the other.

To add a mirror: its line in `_MIRROR_PARAMETERS` and, if it has a focal length, in `_capture_fov_deg`.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import DomainError, RemoteProtocolError
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.mirrors import MIRRORS, CentralMirror, HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera

Pairs = tuple[tuple[str, str], ...]

# The parameters of each mirror: the name on the wire and the attribute.
_MIRROR_PARAMETERS: dict[str, tuple[tuple[str, str], ...]] = {
    "hyperbolic": (("MirrorK", "k"), ("MirrorC", "c_m")),
    "parabolic": (("MirrorHorizonRadius", "horizon_radius_m"),),
}

# The value of Projection in an ordinary camera's law; an omnidirectional one names its Mirror.
_PERSPECTIVE_PROJECTION = "perspective"

# Sides of a picture are 16-bit numbers in a RAW frame; maps made from the law have one entry a
# pixel, so a client must not believe more.
_MAX_IMAGE_SIDE_PX = 0xFFFF


def pairs_from_omni_camera(camera: OmniCamera, viewpoint_height_m: float) -> Pairs:
    """Return what follows {Type Camera} {Name N} in the CONF of an omnidirectional camera.

    viewpoint_height_m: of the effective viewpoint over the floor, robot upright.
    """
    fov = f"{_capture_fov_deg(camera):.4f}"
    names = ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov")
    return (
        *((name, fov) for name in names),
        ("Width", str(camera.width_px)),
        ("Height", str(camera.height_px)),
        *_pairs_from_mirror(camera.mirror),
        ("CentreU", _format_number(camera.centre_px[0])),
        ("CentreV", _format_number(camera.centre_px[1])),
        ("HorizonRadius", _format_number(camera.horizon_radius_px)),
        ("RimAngle", _format_number(math.degrees(camera.rim_rad))),
        ("UpAzimuth", _format_number(camera.image_up_azimuth_rad)),
        ("ViewpointHeight", _format_number(viewpoint_height_m)),
    )


def omni_camera_from_pairs(pairs: Pairs) -> tuple[OmniCamera, float]:
    """Return the camera and the height of its viewpoint in metres; further pairs are ignored.

    Raises RemoteProtocolError naming the field that is missing or wrong.
    """
    try:
        camera = OmniCamera(
            mirror=_mirror_from_pairs(pairs),
            width_px=_parse_side_px(pairs, "Width"),
            height_px=_parse_side_px(pairs, "Height"),
            centre_px=(_parse_number(pairs, "CentreU"), _parse_number(pairs, "CentreV")),
            horizon_radius_px=_parse_number(pairs, "HorizonRadius"),
            rim_rad=math.radians(_parse_number(pairs, "RimAngle")),
            image_up_azimuth_rad=_parse_number(pairs, "UpAzimuth"),
        )
    except DomainError as error:
        raise RemoteProtocolError(f"CONF of a camera that cannot be: {error}") from error
    return camera, _parse_number(pairs, "ViewpointHeight")


def pairs_from_perspective_camera(camera: PerspectiveCamera) -> Pairs:
    """Return the law of an ordinary camera; the stream's frames carry it."""
    return (
        ("Projection", _PERSPECTIVE_PROJECTION),
        ("Width", str(camera.width_px)),
        ("Height", str(camera.height_px)),
        ("HorizontalFov", _format_number(camera.horizontal_fov_rad)),
    )


def any_camera_from_pairs(pairs: Pairs) -> OmniCamera | PerspectiveCamera:
    """Return the camera of either kind. Raises RemoteProtocolError naming the field at fault."""
    if dict(pairs).get("Projection") != _PERSPECTIVE_PROJECTION:
        return omni_camera_from_pairs(pairs)[0]
    sides = _parse_side_px(pairs, "Width"), _parse_side_px(pairs, "Height")
    try:
        return PerspectiveCamera(*sides, _parse_number(pairs, "HorizontalFov"))
    except DomainError as error:
        raise RemoteProtocolError(f"a camera that cannot be: {error}") from error


def _pairs_from_mirror(mirror: CentralMirror) -> Pairs:
    name = next(name for name, kind in MIRRORS.items() if isinstance(mirror, kind))
    parameters = (
        (key, _format_number(getattr(mirror, field))) for key, field in _MIRROR_PARAMETERS[name]
    )
    return (("Mirror", name), *parameters)


def _mirror_from_pairs(pairs: Pairs) -> CentralMirror:
    name = _require_value(pairs, "Mirror").lower()
    if name not in MIRRORS:
        raise _field_error("Mirror", name, "one of " + ", ".join(MIRRORS))
    return MIRRORS[name](
        **{field: _parse_number(pairs, key) for key, field in _MIRROR_PARAMETERS[name]}
    )


def _capture_fov_deg(camera: OmniCamera) -> float:
    """Return the capture camera's angle across the image; 0 if it is orthographic."""
    if not isinstance(camera.mirror, HyperbolicMirror):
        return 0.0
    focal_length_px = camera.mirror.s * camera.horizon_radius_px
    # Not of the quotient: the focal length may vanish or overflow for extreme h and k.
    return math.degrees(2.0 * math.atan2(0.5 * camera.width_px, focal_length_px))


def _format_number(value: float) -> str:
    """Return the shortest decimal that reads back as this double."""
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


def _parse_side_px(pairs: Pairs, name: str) -> int:
    value = _parse_number(pairs, name)
    if not (value.is_integer() and 1 <= value <= _MAX_IMAGE_SIDE_PX):
        raise _field_error(
            name,
            _require_value(pairs, name),
            f"a whole number of pixels, 1 to {_MAX_IMAGE_SIDE_PX}",
        )
    return int(value)


def _field_error(name: str, value: str, expected: str) -> RemoteProtocolError:
    return RemoteProtocolError(f"CONF of a camera: {{{name} {value[:80]}}}: expected {expected}")
