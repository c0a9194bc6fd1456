"""Camera models as pairs of a CONF line: written by the server, read by the client.

The four fields of view of UT2004 come first, for old clients: those of the capture camera, across
the image width. Then our extension (SPEC.md 5.5), in the shortest decimals that read back as the
same doubles (the rim passes through degrees and may differ in its last bit). The only module that
knows both sides: it works on pairs, so that neither the wire nor the optics imports the other.

To add a mirror: its line in `MIRROR_PARAMETERS` and, if it has a focal length, in
`_capture_fov_deg`.
"""

from __future__ import annotations

import math
from functools import lru_cache

from catoptra_protocol.errors import DomainError, RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.mirrors import MIRRORS, CentralMirror, HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera

Pairs = tuple[tuple[str, str], ...]

# Parameters of each mirror: the name on the wire and the attribute.
MIRROR_PARAMETERS: dict[str, tuple[tuple[str, str], ...]] = {
    "hyperbolic": (("MirrorK", "k"), ("MirrorC", "c_m")),
    "parabolic": (("MirrorHorizonRadius", "horizon_radius_m"),),
}

# Value of Projection in the model of an ordinary camera; an omnidirectional one has a Mirror.
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
    # The capture camera has no zoom: default, minimum, maximum and present value are the same.
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
    """Camera model of the pairs, and the height of its viewpoint in metres.

    Unknown pairs are ignored.

    Raises:
        RemoteProtocolError: A field is missing or wrong; names the field.
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
        raise RemoteProtocolError(f"CONF of an impossible camera: {error}") from error
    return camera, _parse_number(pairs, "ViewpointHeight")


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


def _pairs_from_mirror(mirror: CentralMirror) -> Pairs:
    # By isinstance: the mirror classes know no names of the wire.
    name = next(name for name, kind in MIRRORS.items() if isinstance(mirror, kind))
    parameters = (
        (key, _format_number(getattr(mirror, field))) for key, field in MIRROR_PARAMETERS[name]
    )
    return (("Mirror", name), *parameters)


def _mirror_from_pairs(pairs: Pairs) -> CentralMirror:
    name = _require_value(pairs, "Mirror").lower()
    if name not in MIRRORS:
        raise _field_error("Mirror", name, "one of " + ", ".join(MIRRORS))
    parameters = {field: _parse_number(pairs, key) for key, field in MIRROR_PARAMETERS[name]}
    return MIRRORS[name](**parameters)


def _capture_fov_deg(camera: OmniCamera) -> float:
    """Field of view of the capture camera across the image width; 0 if orthographic."""
    if not isinstance(camera.mirror, HyperbolicMirror):
        return 0.0
    focal_length_px = camera.mirror.s * camera.horizon_radius_px
    # atan2 and not atan of the quotient: the focal length may vanish or overflow for extreme h, k.
    return math.degrees(2.0 * math.atan2(0.5 * camera.width_px, focal_length_px))


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


def _parse_side_px(pairs: Pairs, name: str) -> int:
    value = _parse_number(pairs, name)
    # Clients build lookup tables with an entry per pixel, so a header must not choose their size.
    if not (value.is_integer() and 1 <= value <= MAX_IMAGE_SIDE_PX):
        expected = f"an integer number of pixels, 1 to {MAX_IMAGE_SIDE_PX}"
        raise _field_error(name, _require_value(pairs, name), expected)
    return int(value)


def _field_error(name: str, value: str, expected: str) -> RemoteProtocolError:
    return RemoteProtocolError(f"CONF of a camera: {{{name} {value[:80]}}}: expected {expected}")
