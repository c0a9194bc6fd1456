"""Formats: every file through the reader of its own program, and published files of each."""

from __future__ import annotations

import json
import math
import re
import struct
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval

from catoptra_protocol.calibration.calibration_files import read_calibration
from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import FORMATS, CalibrationFormat
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import (
    EnhancedUnifiedLens,
    EquidistantLens,
    KannalaBrandtLens,
    OCamLens,
    StereographicLens,
    UnifiedLens,
)
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers import foreign_readers
from helpers.calibrated_cameras import (
    LAFIDA,
    PAPER,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    WOODSCAPE,
    flipped_points,
)


def _eye(lens: object, field_deg: float) -> OmniCamera:
    return camera_with_inscribed_rim(
        lens,  # type: ignore[arg-type]
        width_px=640,
        height_px=480,
        rim_rad=math.radians(0.5 * field_deg),
        picture=Picture.FLIPPED,
    )


CAMERAS = {
    "paper": PAPER,
    "theta": THETA_BACK,
    "tum_vi": TUM_VI,
    "tum_vi_kb": TUM_VI_KB,
    "narrow_kb": replace(TUM_VI_KB, rim_rad=math.radians(88.0)),
    "lafida": replace(LAFIDA, rim_rad=math.radians(85.0)),
    "woodscape": WOODSCAPE,
    "eucm": _eye(EnhancedUnifiedLens(0.6, 1.1), 170.0),
    "stereographic": _eye(StereographicLens(), 220.0),
    "equidistant": _eye(EquidistantLens(), 178.0),
    "flat": _eye(UnifiedLens(0.0, -0.02, 0.001), 80.0),
    "decentred": replace(
        _eye(UnifiedLens(0.0, -0.1), 60.0), plane=ImagePlane((1.0, 0.0, 0.0, 1.01), 1e-3, -5e-4)
    ),
}


@cache
def _seen_points(camera: OmniCamera) -> tuple[Floats, Floats]:
    """Points (n, 3) of a camera that several formats have, and their pixels."""
    points, pixels, valid = flipped_points(camera)
    valid &= points[:, 2] < 1.0 - 1e-12
    return points[valid][::10].copy(), pixels[valid][::10].copy()


# The inverse polynomial of OCam's readers is a fit.
_INVERSE_PX = 0.06


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.name)
def test_file_is_projected_alike_by_its_own_program(
    each: CalibrationFormat, tmp_path: Path
) -> None:
    if each.program == "COLMAP":
        pytest.importorskip("pycolmap", reason="COLMAP itself, of the extra `outside`")
    bound_px = _INVERSE_PX if each.model.lens is OCamLens else 1e-9
    num_read = 0
    for name, camera in CAMERAS.items():
        result = export_camera(camera, each, name="cam", picture=Picture.FLIPPED)
        if not isinstance(result, ExportedFile):
            continue
        folder = tmp_path / name
        folder.mkdir()
        (folder / each.file_name).write_text(result.text)
        project = foreign_readers.read(folder / each.file_name, each.name)
        # A pixel exactly at 90 degrees has no side in front.
        widest = min(camera.rim_rad, result.camera.rim_rad, each.max_angle_rad - 1e-6)
        points, expected = _seen_points(replace(result.camera, rim_rad=widest))
        assert np.abs(project(points) - expected).max() <= bound_px, name
        num_read += 1
    assert num_read >= (2 if each.model.lens in (UnifiedLens, KannalaBrandtLens) else 1)


# Numbers of published files, in the forms of their programs; sources beside each.
KB = (190.978477, 190.973307, 254.931706, 256.897442)
TERMS = (0.003482389402, 0.000715034845, -0.002053236141, 0.000202936736)
K = "190.978477, 0., 254.931706, 0., 190.973307, 256.897442, 0., 0., 1."
D = "0.003482389402, 0.000715034845, -0.002053236141, 0.000202936736"
K_XML, D_XML = K.replace(",", ""), D.replace(",", "")
MATRIX = "!!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [{}]\n"
SAMPLE = "nFrames: 3\nflags: 0\ncamera_matrix: {}distortion_coefficients: {}xi: 1.5\nrms: 0.2\n"
CHAIN = f"""  camera_model: pinhole
  distortion_coeffs: [{D}]
  distortion_model: equidistant
  intrinsics: [190.978477, 190.973307, 254.931706, 256.897442]
  resolution: [512, 512]
"""
SETTINGS = "\n".join(
    f"Camera.{key}: {value}" for key, value in zip(
        ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"), (*KB, *TERMS), strict=True
    )
)  # fmt: skip
MATRICES = (MATRIX.format(3, 3, K), MATRIX.format(4, 1, D))
KB_FILES = {
    "kalibr_equi": f"%YAML:1.0 # of OpenVINS\n\ncam0:\n  cam_overlaps: [1]\n{CHAIN}",
    "ros_equidistant": "image_width: 512\nimage_height: 512\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    f"  data: [{K}]\ndistortion_model: equidistant\ndistortion_coefficients:\n  data: [{D}]\n",
    "ros_message": "header: {}\nheight: 512\nwidth: 512\ndistortion_model: equidistant\n"
    f"D: [{D}]\nK: [{K}]\n",
    "colmap_opencv_fisheye": "# Camera list\n1 OPENCV_FISHEYE 512 512 190.978477 190.973307 "
    f"255.431706 257.397442 {D_XML}\n",
    "nerfstudio": '{"w": 512, "h": 512, "frames": [{"file_path": "a.png", "camera_model": '
    '"OPENCV_FISHEYE", "w": 512, "h": 512, "fl_x": 190.978477, "fl_y": 190.973307, "cx": '
    '255.431706, "cy": 257.397442, "k1": 0.003482389402, "k2": 0.000715034845, "k3": '
    '-0.002053236141, "k4": 0.000202936736}]}',
    "opencv_fisheye": "%YAML:1.0\n---\nK: {}D: {}".format(*MATRICES),
    "opencv_fisheye ": json.dumps(
        {"K": [[KB[0], 0, KB[2]], [0, KB[1], KB[3]], [0, 0, 1]], "D": [[k] for k in TERMS]}
    ),
    "camodocal_kb": "model_type: KANNALA_BRANDT\nimage_width: 512\nimage_height: 512\n"
    "distortion_parameters: {k2: 0.003482389402, k3: 0.000715034845, k4: -0.002053236141, "
    "k5: 0.000202936736}\nprojection_parameters: {mu: 190.978477, mv: 190.973307, "
    "u0: 254.931706, v0: 256.897442}\n",
    "orb_slam3": f"%YAML:1.0\nCamera.type: KannalaBrandt8\n{SETTINGS}\n",
    "stella_vslam": f'Camera.model: "fisheye"\n{SETTINGS}\nCamera.cols: 512\nCamera.rows: 512\n',
}


@pytest.mark.parametrize("name", KB_FILES)
def test_published_form_is_read_exactly(name: str, tmp_path: Path) -> None:
    path = tmp_path / "calibration"
    path.write_text(KB_FILES[name])
    found, camera = read_calibration(path, size_px=(512, 512))
    assert found == name.strip()
    points, expected, valid = flipped_points(camera)
    project = foreign_readers.kannala_brandt(KB, TERMS)
    assert np.abs(project(points) - expected)[valid].max() <= 1e-9


@pytest.mark.parametrize("form", ["yaml", "xml"])
def test_sample_of_omnidir_is_read_in_both_notations(form: str, tmp_path: Path) -> None:
    path = tmp_path / f"out_camera_params.{form}"
    text = "%YAML:1.0\n---\n" + SAMPLE.format(*MATRICES)
    if form == "xml":
        text = (
            '<?xml version="1.0"?>\n<opencv_storage><nFrames>3</nFrames>\n'
            f'<camera_matrix type_id="opencv-matrix"><rows>3</rows><data>{K_XML}</data>'
            '</camera_matrix><distortion_coefficients type_id="opencv-matrix">'
            f"<data>{D_XML}</data></distortion_coefficients>\n<xi>1.5</xi></opencv_storage>\n"
        )
    path.write_text(text)
    with pytest.raises(ConfigError, match="ResolutionX and ResolutionY, or --size"):
        read_calibration(path)
    found, camera = read_calibration(path, size_px=(512, 512))
    assert found == "opencv_omnidir"
    points, expected, valid = flipped_points(camera)
    project = foreign_readers.mei(KB, 1.5, TERMS)
    assert np.abs(project(points) - expected)[valid].max() <= 1e-9


# LaFiDa's lens (MultiCol-SLAM), a panoramic annular one (LF-VIO), Kimera's, SVO's, fca's.
LAFIDA_POLY = (
    -209.200757992065,
    0.0,
    0.00213741670953883,
    -4.2203617319086e-06,
    1.77146086919594e-08,
)
OCAM_FILES = {
    "multicol": (
        "Camera.Iw: 754\nCamera.Ih: 480\nCamera.nrpol: 5\nCamera.nrinvpol: 12\nCamera.fov: 180\n"
        + "".join(f"Camera.a{i}: {a!r}\n" for i, a in enumerate(LAFIDA_POLY))
        + "".join(f"Camera.pol{i}: 1.0\n" for i in range(12))
        + "Camera.c: 0.9996\nCamera.d: -0.0034\nCamera.e: 0.0038\nCamera.u0: 392.2\n"
        "Camera.v0: 243.5\n",
        (0.9996, -0.0034, 0.0038, 1.0),
        90.0,
    ),
    "camodocal_scaramuzza": (
        "model_type: scaramuzza\nimage_width: 754\nimage_height: 480\npoly_parameters:\n"
        + "".join(f"   p{i}: {a!r}\n" for i, a in enumerate(LAFIDA_POLY))
        + "inv_poly_parameters:\n"
        + "".join(f"   p{i}: 0.0\n" for i in range(20))
        + "affine_parameters:\n   ac: 0.9996\n   ad: -0.0034\n   ae: 0.0038\n   cx: 392.2\n"
        "   cy: 243.5\n",
        (0.9996, -0.0034, 0.0038, 1.0),
        None,
    ),
    "svo_omni": (
        "cameras:\n- camera:\n    distortion:\n      parameters: {cols: 1, rows: 0, data: []}\n"
        "      type: none\n    image_height: 480\n    image_width: 754\n    intrinsics:\n"
        f"      data: [{', '.join(map(repr, LAFIDA_POLY))}, 392.2, 243.5, 0.9996, -0.0034, 0.0038, "
        + "1.0, " * 12
        + "0.0, 0.5]\n    label: cam0\n    type: omni\n    mask: mask.png\n",
        (1.0, 0.0038, -0.0034, 0.9996),
        # A circle of half the half height.
        math.degrees(math.atan2(120.0, -polyval(120.0, LAFIDA_POLY))),
    ),
    "kimera_omni": (
        "%YAML:1.0\ncamera_model: omni\nintrinsics: []\ndistortion_model: omni\n"
        f"distortion_coefficients: {[-a for a in LAFIDA_POLY]}\nresolution: [754, 480]\n"
        "omni_affine: [-0.0034, 0.0038, 0.9996]\nomni_distortion_center: [392.2, 243.5]\n",
        (1.0, -0.0034, 0.0038, 0.9996),
        None,
    ),
    "fca_ocam": (
        "image: {width: 754, height: 480}\nparameter:\n  c: 0.9996\n  d: -0.0034\n  e: 0.0038\n"
        "  cx: 392.2\n  cy: 243.5\n  coefficients:\n    projection: [1.0]\n"
        f"    unprojection: {[-a for a in LAFIDA_POLY]}\n",
        (0.9996, -0.0034, 0.0038, 1.0),
        None,
    ),
    "py_ocamcalib": (
        f'{{"taylor_coefficient": {[-a for a in LAFIDA_POLY]}, "distortion_center": [392.2, 243.5],'
        '"stretch_matrix": [[0.9996, -0.0034], [0.0038, 1.0]], "inverse_poly": [1.0]}',
        (0.9996, -0.0034, 0.0038, 1.0),
        None,
    ),
}


# The same camera without a rig.
OCAM_FILES["svo_omni alone"] = (
    OCAM_FILES["svo_omni"][0].partition("camera:\n")[2],
    *OCAM_FILES["svo_omni"][1:],
)


@pytest.mark.parametrize("name", OCAM_FILES)
def test_rays_of_a_published_polynomial_are_its_own(name: str, tmp_path: Path) -> None:
    text, matrix, rim_deg = OCAM_FILES[name]
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((480, 754), 255, np.uint8))
    path = tmp_path / "calibration"
    path.write_text(text)
    found, camera = read_calibration(path, size_px=(754, 480))
    assert (found, camera.width_px, camera.height_px) == (name.split()[0], 754, 480)
    if rim_deg is not None:
        assert math.degrees(camera.rim_rad) == pytest.approx(rim_deg)
    pixels = np.random.default_rng(3).uniform((0.0, 0.0), (753.0, 479.0), (5000, 2))
    x, y = np.linalg.solve(np.array(matrix).reshape(2, 2), (pixels - (392.2, 243.5)).T)
    rays = np.stack((-y, x, -polyval(np.hypot(x, y), LAFIDA_POLY)), axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    direction, valid = camera.direction_from_pixel(pixels + 0.5)
    assert valid.sum() > 500
    assert np.abs(direction - rays)[valid].max() <= 1e-12


MASKED = OCAM_FILES["svo_omni"][0].replace("0.0, 0.5]", "0.0, 0.0]")


def write_mask(folder: Path, centre: tuple[float, float], size_px: tuple[int, int]) -> Bools:
    """Write a mask with a circle of 150 px about a centre, and return it."""
    rows, columns = np.indices(size_px[::-1])
    shown: Bools = np.hypot(columns - centre[0], rows - centre[1]) < 150.0
    cv2.imwrite(str(folder / "mask.png"), 255 * shown.astype(np.uint8))
    return shown


@pytest.mark.parametrize("centre", [(392.2, 243.5), (389.0, 246.0)])
def test_no_pixel_that_a_mask_hides_is_valid(centre: tuple[float, float], tmp_path: Path) -> None:
    shown = write_mask(tmp_path, centre, (754, 480))
    path = tmp_path / "calibration"
    path.write_text(MASKED)
    pixels = np.stack(np.indices((480, 754))[::-1], axis=-1) + 0.5
    _, valid = read_calibration(path)[1].direction_from_pixel(pixels)
    assert not valid[~shown].any()
    # What is left out lies between the circle and one about the axis within it.
    assert np.count_nonzero(shown & ~valid) / np.count_nonzero(shown) < 0.1


def test_mask_of_another_shape_size_or_kind_is_one_line(tmp_path: Path) -> None:
    path, mask = tmp_path / "calibration", tmp_path / "mask.png"

    def expect(message: str, text: str = MASKED) -> None:
        path.write_text(text)
        with pytest.raises(ConfigError, match=rf"\A[^\n]*{message}[^\n]*\Z"):
            read_calibration(path)

    expect("mask='mask.png': expected a picture beside the file")
    write_mask(tmp_path, (300.0, 200.0), (754, 480))
    expect("an image circle about the optical axis: ")
    write_mask(tmp_path, (392.2, 243.5), (640, 480))
    expect("mask='640 x 480 px': expected a PNG of 754 x 480 px")
    mask.write_bytes(mask.read_bytes()[:16] + struct.pack(">II", 2**30, 2**30))
    expect("mask='1073741824 x 1073741824 px'")
    mask.write_bytes(b"JFIF")
    expect("mask='no PNG'")
    expect("mask='/dev/zero'", MASKED.replace("mask.png", "/dev/zero"))


@pytest.mark.parametrize(
    ("text", "radius_px"),
    [
        # `CreateMirrorMask` of MultiCol-SLAM: v0 + 22.
        (f"{OCAM_FILES['multicol'][0]}Camera.mirrorMask: 1\n".replace("fov: 180", "fov: 360"),
         243.5 + 22.0),
        (KB_FILES["nerfstudio"].replace('"h": 512', '"h": 512, "fisheye_crop_radius": 200'), 200.0),
        # A circle of half the half height.
        (OCAM_FILES["svo_omni alone"][0].replace("mask:", "unknown:"), 120.0),
    ],
    ids=["multicol", "nerfstudio", "svo"],
)  # fmt: skip
def test_circle_of_a_file_ends_the_camera(text: str, radius_px: float, tmp_path: Path) -> None:
    path = tmp_path / "calibration"
    path.write_text(text)
    assert read_calibration(path)[1].rim_radius_px == pytest.approx(radius_px)


def test_pinholes_without_distortion_are_read_and_a_third_term_is_named(tmp_path: Path) -> None:
    path = tmp_path / "calibration"
    chain = f"cam0:\n{CHAIN}".replace(f"[{D}]", "[]").replace("equidistant", "none")
    settings = "%YAML:1.0\nCamera.type: Rectified\nCamera1: {fx: 9, fy: 9, cx: 256, cy: 256}\n"
    for name, text in (("kalibr_radtan", chain), ("orb_slam3_pinhole", settings)):
        path.write_text(text)
        found, camera = read_calibration(path, size_px=(512, 512))
        assert (found, camera.projection) == (name, UnifiedLens(0.0))
    path.write_text(settings.replace("fx", "k3: 1.16, fx"))
    with pytest.raises(ConfigError, match=r"k3='1.16': expected 0: .* format orb_slam3_pinhole"):
        read_calibration(path, size_px=(512, 512))


def test_camera_of_a_rig_is_found_by_its_name_and_others_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    path.write_text(f"cam0:\n{CHAIN}cam1:\n{CHAIN}".replace("[512, 512]", "[640, 512]", 1))
    assert [read_calibration(path, camera=f"cam{i}")[1].width_px for i in (0, 1)] == [640, 512]
    with pytest.raises(ConfigError, match=r"cam2='missing'.*kalibr_equi.*which has cam0, cam1"):
        read_calibration(path, camera="cam2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"cam0:\n{CHAIN}".replace("equidistant", "fov"),
            "distortion_model='fov': expected equidistant: the file is of the format kalibr_equi",
        ),
        (
            f"cam0:\n{CHAIN}".replace("equidistant", "fov").replace(D, "0.92"),
            "distortion_model='fov': expected radtan or none: the file is of the format kalibr",
        ),
        ("model_type: MEI\nimage_width: 4\n", "such as camodocal (needs"),
        ('{"camera_model": "OPENCV_FISHEYE", "fl_x": 9, "fl_y": 9, "cx": 5}', "cy='missing'"),
        ("hello", "such as cv2.omnidir, CamOdoCal, BoofCV, Kalibr"),
        (KB_FILES["orb_slam3"].replace("Camera.k4", "Camera.k5"), "format orb_slam3"),
    ],
)
def test_rejected_file_names_its_format_or_the_nearest_and_the_key(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "calibration"
    path.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(message)) as raised:
        read_calibration(path, size_px=(9, 9))
    assert "\n" not in str(raised.value)
