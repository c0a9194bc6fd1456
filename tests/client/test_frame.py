"""Image files: decoded, or rejected before memory is allocated. Frames as text and in notebooks."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Frame, image_bytes_from_rgb, rgb_from_image_bytes
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.usarsim.image_port import ImageType

PICTURE = np.zeros((4, 6, 3), np.uint8)
PICTURE[..., 0] = 250


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_file_when_decoded_has_red_first(suffix: str) -> None:
    _, data = cv2.imencode(suffix, np.ascontiguousarray(PICTURE[..., ::-1]))
    # A flat picture: quality 95 still rounds in YCbCr.
    assert np.abs(rgb_from_image_bytes(data.tobytes()).astype(int) - PICTURE).max() <= 4


BAD_FILES = [
    (b"", "JPEG"),
    (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff\xff\xff\xff\0\0\0\1", "PNG frame of 4294967295 x 1"),
    (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1", "PNG frame of 24 bytes"),
]


@pytest.mark.parametrize(("data", "said"), BAD_FILES)
def test_file_when_no_image_or_too_large_is_rejected(data: bytes, said: str) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        rgb_from_image_bytes(data)


def test_frame_as_text_is_a_summary() -> None:
    frame = Frame(
        PICTURE,
        17,
        0.0,
        ImageType.RAW,
        robot_name="A",
        camera_name="Rear",
        time_s=3.6812,
        stage_ms={"faces": 2.04, "mirror": 1.0},
        plan="raster, per pixel, 2^2 samples: no graphics processor",
        error_bound_px=0.35359,
    )
    assert repr(frame) == (
        "<Frame 17: 6 x 4 px, camera 'Rear', robot 'A', at 3.68 s, bound 0.35 px, "
        "raster, per pixel, 2^2 samples, rendered in 3.0 ms>"
    )


def test_frame_of_the_image_port_as_text_is_size_and_number() -> None:
    assert str(Frame(PICTURE, 3, 0.0, ImageType.RAW)) == "<Frame 3: 6 x 4 px>"


def test_frame_in_a_notebook_is_its_picture_above_its_summary() -> None:
    frame = Frame(PICTURE, 3, 0.0, ImageType.RAW, robot_name="<b>", camera_name="&")
    png = frame._repr_png_()
    assert png is not None
    np.testing.assert_array_equal(rgb_from_image_bytes(png), PICTURE)
    page = frame._repr_html_()
    assert base64.b64encode(png).decode() in page
    assert "camera &#x27;&amp;&#x27;, robot &#x27;&lt;b&gt;&#x27;" in page


def test_frame_without_pixels_shows_that() -> None:
    frame = Frame(np.zeros((0, 0, 3), np.uint8), 0, 0.0, ImageType.RAW)
    assert frame._repr_png_() is None
    assert frame._repr_html_() == "<p>&lt;Frame 0: no pixels&gt;</p>"
    with pytest.raises(CatoptraError, match="spawn a robot with a camera first"):
        image_bytes_from_rgb(frame.rgb, ".png")
