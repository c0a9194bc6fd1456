"""Wrong numbers in every shipped camera file: an error with file, key, value and expectation.

Also those that have the right form in a wrong unit. A new camera file is tried as all others are.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.config.camera_file import carry_camera, read_camera_file
from helpers.configs import REPOSITORY

FILES = sorted((REPOSITORY / "configs/cameras").glob("*.ini"))
# A robot's file gives the image its size where the camera has no pixels of its own.
SIZE_KEYS = ("ResolutionX", "ResolutionY")


@pytest.fixture(params=FILES, ids=lambda path: path.stem)
def path(request: pytest.FixtureRequest) -> Path:
    found: Path = request.param
    return found


def read_numbers(path: Path) -> dict[str, list[float]]:
    """Numbers by key of the section of a camera file's lens or mirror."""
    camera = read_camera_file(path)
    section = path.read_text().split(f"[{camera.item_class}]")[1].split("\n[")[0]
    numbers = {}
    for key, value in re.findall(r"^(\w+)=([^;\n]*)", section, re.MULTILINE):
        if re.fullmatch(r"[-+.,eE\d ]+", value) and key not in SIZE_KEYS:
            numbers[key] = [float(number) for number in value.split(",")]
    return numbers


def read_changed(path: Path, folder: Path, key: str, value: str) -> OmniCamera:
    """Camera of the file with another value of a key."""
    changed = folder / "changed.ini"
    line = re.compile(rf"^{key}=[^;\n]*", re.MULTILINE)
    changed.write_text(line.sub(f"{key}={value} ", path.read_text(), count=1))
    return carry_camera(read_camera_file(changed), folder / "robot.ini", size_px=64).camera


def try_changed(path: Path, folder: Path, key: str, value: str) -> OmniCamera | str:
    """The same, or the message of the error."""
    try:
        return read_changed(path, folder, key, value)
    except ConfigError as error:
        return str(error)


def sees_something(camera: OmniCamera) -> bool:
    u, v = np.arange(0.5, camera.width_px, 4.0), np.arange(0.5, camera.height_px, 4.0)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return bool(ray_from_pixel(camera, pixels)[2].any())


def test_what_is_no_finite_number_is_rejected_at_its_key(path: Path, tmp_path: Path) -> None:
    numbers = read_numbers(path)
    assert numbers
    for key, values in numbers.items():
        for wrong in ("nan", "inf", "-inf", "1e400", "12mm", ""):
            # In a table the last number alone.
            value = ",".join([*map(repr, values[:-1]), wrong])
            with pytest.raises(ConfigError, match=rf"changed\.ini:\d+: .*{key}=.*: expected "):
                read_changed(path, tmp_path, key, value)


def test_number_in_a_wrong_unit_is_an_error_or_makes_a_camera_that_sees(
    path: Path, tmp_path: Path
) -> None:
    rejected = 0
    for key, values in read_numbers(path).items():
        # Metres and millimetres, degrees and radians, the other sign.
        for factor in (1000.0, 0.001, 180.0 / np.pi, np.pi / 180.0, -1.0):
            value = ",".join(repr(factor * number) for number in values)
            found = try_changed(path, tmp_path, key, value)
            if isinstance(found, str):
                rejected += 1
                assert re.search(r"changed\.ini:\d+: .*=.*: expected ", found)
            else:
                assert sees_something(found), (key, value)
    assert rejected > 0


def test_angle_beyond_the_model_is_rejected(path: Path, tmp_path: Path) -> None:
    """At the rim or the field of view, with the reach of the model or its first fold."""
    key, widest = ("FieldOfView", 360) if read_camera_file(path).is_lens else ("RimAngle", 179)
    if key not in read_numbers(path):
        pytest.skip("the picture's own corners are the end of its field of view")
    with pytest.raises(ConfigError) as caught:
        read_changed(path, tmp_path, key, str(widest + 1))
    assert f"{key}='{widest + 1}" in str(caught.value)
    found = try_changed(path, tmp_path, key, str(widest))
    if isinstance(found, str):
        # Long before the reach of a polynomial its picture can be too large for the memory.
        assert re.search(rf"{key}='{widest}.*(reach|first fold|possible value)|of memory", found)
    else:
        # The formula goes so far: each angle has a radius of its own.
        t = np.linspace(found.projection.t_min, min(found.rim_t, 1e6), 2000)
        assert (np.diff(found.radius_px_from_t(t)) > 0.0).all()


@pytest.mark.parametrize(
    ("name", "key", "value", "message"),
    [
        ("lafida", "FocalLength", "0.001", r"FieldOfView='185': .* px wide"),
        ("kaidan_360", "CentreU", "330000", r"CentreU='330000': .* px wide around \(330000"),
        ("theta_front", "CentreV", "-5000", r"CentreV='-5000': .* px wide"),
        ("tum_vi_kannala_brandt", "FieldOfView", "0.2", r"FieldOfView='0.2': .* field of 0.2 deg"),
        ("theta_front", "FocalLengthY", "1.1", r"FocalLengthY='1.1': .* at most 10 times"),
        ("kitti_360", "Xi", "-2", r"Xi='-2': .*xi >= 0"),
        ("tum_vi_double_sphere", "Xi", "-2", r"Xi='-2': .*xi > -1"),
        ("spherical", "Radius", "30", r"CentreDistance='0.2': .*outside the sphere"),
        ("kitti_360", "K2", "1e-320", r"section='Catoptra.Kitti360': .*computed with \(overflow"),
    ],
)
def test_camera_that_would_show_nothing_is_rejected(
    tmp_path: Path, name: str, key: str, value: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_changed(REPOSITORY / f"configs/cameras/{name}.ini", tmp_path, key, value)
