"""The camera model across the wire."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol import camera_conf
from catoptra_protocol.camera_conf import (
    omni_camera_from_pairs,
    pairs_from_omni_camera,
    pairs_from_perspective_camera,
)
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.optics.mirrors import MIRRORS, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    pixel_from_direction,
)
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.usarsim.grammar import Pairs, parse_message
from catoptra_protocol.usarsim.reports import Configuration, line_from_report, report_from_message
from helpers.mirror_checks import MIRROR_EXAMPLES

PAPER = HyperbolicMirror(11.546, 2.321)


def make_camera(mirror: Mirror = PAPER, rim_deg: float = 125.0) -> OmniCamera:
    """Camera of the paper, 360 x 360 px."""
    return camera_with_inscribed_rim(
        mirror, width_px=360, height_px=360, rim_rad=math.radians(rim_deg)
    )


def test_pairs_have_the_specified_names_and_order() -> None:
    names = [name for name, _ in pairs_from_omni_camera(make_camera(), 0.5)]
    assert " ".join(names) == (
        "CameraDefFov CameraMinFov CameraMaxFov CameraFov Width Height Mirror MirrorK MirrorC "
        "CentreU CentreV HorizonRadius RimAngle UpAzimuth Picture ViewpointHeight"
    )


def test_pairs_begin_with_the_fields_of_view_of_the_capture_camera() -> None:
    # By hand: s = sqrt(k (k - 2)) = 10.4995, h = 93.1316 px, fov = 2 atan(180 / (s h)).
    views = [value for _, value in pairs_from_omni_camera(make_camera(), 0.5)[:4]]
    assert views == ["20.8625"] * 4


def test_pairs_of_a_parabolic_mirror_have_its_radius() -> None:
    pairs = dict(pairs_from_omni_camera(make_camera(ParabolicMirror(0.03)), 0.5))
    assert (pairs["Mirror"], pairs["MirrorHorizonRadius"]) == ("parabolic", "0.03")
    assert pairs["CameraFov"] == "0.0000"


@pytest.mark.parametrize("mirror", [PAPER, ParabolicMirror(0.03)])
def test_camera_when_sent_as_a_line_is_the_same(mirror: Mirror) -> None:
    sent = make_camera(mirror)
    conf = Configuration("Camera", (("Name", "Omni"), *pairs_from_omni_camera(sent, 0.4321)))
    line = line_from_report(conf).decode().rstrip("\r\n")
    received = report_from_message(parse_message(line))
    assert isinstance(received, Configuration)
    assert omni_camera_from_pairs(received.pairs) == (sent, 0.4321)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(
    st.floats(2.1, 100.0),
    st.floats(0.01, 10.0),
    st.floats(20.0, 95.0),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 2.0),
)
def test_camera_when_received_projects_to_the_same_pixels(
    k: float, c_m: float, rim_deg: float, up_azimuth_rad: float, height_m: float
) -> None:
    sent = camera_with_inscribed_rim(
        HyperbolicMirror(k, c_m),
        width_px=640,
        height_px=480,
        rim_rad=math.radians(rim_deg) * 0.9,
        image_up_azimuth_rad=up_azimuth_rad,
    )
    received, received_height_m = omni_camera_from_pairs(pairs_from_omni_camera(sent, height_m))
    direction = np.array([[0.1, 0.2, 1.0], [-0.2, 0.1, 0.9], [0.0, 0.0, 1.0]])
    pixels = [pixel_from_direction(camera, direction)[0] for camera in (sent, received)]
    assert np.array_equal(pixels[0], pixels[1])
    assert received_height_m == height_m


def test_pairs_in_any_case_and_among_others_are_read() -> None:
    pairs = pairs_from_omni_camera(make_camera(), 0.5)
    upper_case = (("Serial", "1"), *((name.upper(), value.upper()) for name, value in pairs))
    assert omni_camera_from_pairs(upper_case) == (make_camera(), 0.5)


def replace_pair(name: str, value: str) -> Pairs:
    return tuple(
        (n, value if n == name else v) for n, v in pairs_from_omni_camera(make_camera(), 0.5)
    )


@pytest.mark.parametrize(
    "name", [name for name, _ in pairs_from_omni_camera(make_camera(), 0.5)[4:]]
)
def test_pairs_when_one_is_missing_raises_with_its_name(name: str) -> None:
    pairs = tuple(pair for pair in pairs_from_omni_camera(make_camera(), 0.5) if pair[0] != name)
    with pytest.raises(RemoteProtocolError, match=name):
        omni_camera_from_pairs(pairs)


BAD = [
    ("Mirror", "flat", "hyperbolic, parabolic"),
    ("MirrorK", "2", "k > 2"),
    ("MirrorC", "nan", "MirrorC"),
    ("Width", "0", "Width"),
    ("Width", "1e9", "Width"),
    ("Height", "360.5", "Height"),
    ("CentreU", "half", "CentreU"),
    ("HorizonRadius", "-1", "radius > 0"),
    ("RimAngle", "179", "rim"),
    ("Picture", "sideways", "mirrored or flipped"),
    ("ViewpointHeight", "inf", "ViewpointHeight"),
]


@pytest.mark.parametrize(("name", "value", "expected_message"), BAD)
def test_pairs_when_one_is_wrong_raises_with_the_expectation(
    name: str, value: str, expected_message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        omni_camera_from_pairs(replace_pair(name, value))


def test_pairs_of_the_same_camera_are_formatted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    formatted: list[float] = []

    def count(value: float) -> str:
        formatted.append(value)
        return repr(value)

    monkeypatch.setattr(camera_conf, "_format_number", count)
    # A rim of its own, so that no other test has formatted this camera before.
    for _ in range(100):
        pairs = pairs_from_omni_camera(make_camera(rim_deg=111.5), 0.5)
        pairs_from_perspective_camera(PerspectiveCamera(321, 123, 1.25))
    assert pairs is pairs_from_omni_camera(make_camera(rim_deg=111.5), 0.5)
    # Eight numbers of the mirror camera, one of the ordinary camera.
    assert len(formatted) == 8 + 1


@pytest.mark.parametrize("name", MIRRORS)
def test_every_mirror_can_be_sent(name: str) -> None:
    mirror: Mirror = MIRRORS[name](*MIRROR_EXAMPLES[name])
    rim_rad = getattr(mirror, "rim_rad", math.radians(110.0))
    sent = camera_with_inscribed_rim(mirror, width_px=64, height_px=48, rim_rad=rim_rad)
    received, _ = omni_camera_from_pairs(pairs_from_omni_camera(sent, 0.0))
    # The rim passes through degrees.
    assert replace(received, rim_rad=rim_rad) == sent
