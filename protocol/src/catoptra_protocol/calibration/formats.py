"""Formats of calibration files: rows that name, order and scale the numbers of lens models.

To add a format: a row with its template, by the rules of `templates`, the names of
`calibrated_camera.camera_from_numbers`, and what its reader says of its domain; its file is then
read, exported, converted, listed in CALIBRATION.md and fuzzed. `Reader` says by what the tests read
it: the program itself, or a transcription of its parser with the fields that it requires.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from catoptra_protocol.calibration.calibrated_camera import (
    camera_from_numbers,
    numbers_from_camera,
    simplify_plane,
)
from catoptra_protocol.calibration.model_fits import (
    fit_double_sphere,
    fit_eucm,
    fit_kannala_brandt,
    fit_mei,
    fit_ocam,
    fit_ocam_of_any_degree,
    fit_pinhole,
    fit_ucm,
    fit_woodscape,
)
from catoptra_protocol.calibration.templates import Numbers, names_in, write_document
from catoptra_protocol.errors import DomainError
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    KannalaBrandtLens,
    OCamLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialProjection
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class LensModel:
    """A lens model as formats have it."""

    words: str
    lens: type[RadialProjection]
    fit: Callable[[OmniCamera], OmniCamera]
    """Camera in this model, as a reader of its file makes it."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFormat:
    """A format with one lens model; all describe the right-handed (flipped) picture."""

    name: str
    """Name by which a client asks for it."""
    program: str
    model: LensModel
    file_name: str
    notation: str
    """As of `templates.write_document`."""
    template: Mapping[str, Any]
    domain: str
    """Directions for which the format's own readers have a pixel."""
    reader: str
    """What reads the files in tests: `own` and the program, or the transcribed parser."""
    frame: str = "x right, y down, z forward"
    """Axes of the camera frame."""
    first_pixel: float = 0.0
    """Coordinate of the first pixel's centre."""

    @property
    def max_angle_rad(self) -> float:
        """Largest angle from the axis that the readers accept."""
        return 0.5 * math.pi if self.domain == FRONT else math.pi

    def simplify(self, camera: OmniCamera) -> OmniCamera:
        """The camera, of the format's model, without what the format has no place for."""
        return simplify_plane(camera, names_in(self.template))

    def read(self, numbers: Numbers, size_px: tuple[int, int]) -> OmniCamera:
        """Camera of a file's numbers, its picture flipped.

        Raises:
            DomainError: No camera has such numbers.
        """
        return camera_from_numbers(self.model.lens, numbers, size_px, first_pixel=self.first_pixel)

    def write(self, camera: OmniCamera, name: str) -> str:
        """Text of a file that describes a camera of the format's model.

        Raises:
            DomainError: The format has no place for a property of the camera.
        """
        numbers = numbers_from_camera(camera, names_in(self.template), self.first_pixel)
        no_mask = {"mask_from": 0.0, "circle_share": 0.0}
        values = numbers | {"name": name, "topic": f"/{name}/image_raw"} | no_mask
        return write_document(self.template, values, self.notation)


MEI = LensModel("Mei", UnifiedLens, fit_mei)
UCM = LensModel("UCM", EnhancedUnifiedLens, fit_ucm)
EUCM = LensModel("EUCM", EnhancedUnifiedLens, fit_eucm)
DOUBLE_SPHERE = LensModel("double sphere", DoubleSphereLens, fit_double_sphere)
KANNALA_BRANDT = LensModel("Kannala-Brandt", KannalaBrandtLens, fit_kannala_brandt)
OCAM = LensModel("OCam polynomial", OCamLens, fit_ocam_of_any_degree)
OCAM_4 = LensModel("OCam polynomial of degree 4", OCamLens, partial(fit_ocam, degree=4))
WOODSCAPE = LensModel("polynomial of the angle", WoodScapeLens, fit_woodscape)
PINHOLE = LensModel("pinhole with radial distortion", UnifiedLens, fit_pinhole)

FRONT, _ANY, _OMNI = "z > 0", "none", "z > -w |X|, w = xi or 1 / xi"
_EUCM, _DS = "z > -w d (RA-L 2016)", "z > -w2 |X| (3DV 2018)"

# Matrices and lists that most formats share.
_K, _SKEWED = "3x3[fx 0 cx 0 fy cy 0 0 1]", "3x3[fx skew cx 0 fy cy 0 0 1]"
_FOCAL, _CENTRE, _SIZE = "[fx fy cx cy]", "[cx cy]", "[width height]"
_KB, _RADTAN, _SHORT_RADTAN = "[k1 k2 k3 k4]", "[k1 k2 p1 p2 0?]", "[k1? k2? p1? p2?]"
_FX = {"fx": "$fx", "fy": "$fy", "cx": "$cx", "cy": "$cy"}
_K4 = {f"k{i}": f"$k{i}" for i in (1, 2, 3, 4)}
_K1_TO_P2 = {"k1": "$k1", "k2": "$k2", "p1": "$p1", "p2": "$p2"}
_SHORT_K1_TO_P2 = {name: f"{number}?" for name, number in _K1_TO_P2.items()} | {"k3": "$0?"}
_SIDES = {"image_width": "$width", "image_height": "$height"}

# What readers demand in addition: a sensor at the camera's own place, without noise.
_EYE = [float(i % 5 == 0) for i in range(16)]
_EYE_3 = [float(i % 4 == 0) for i in range(9)]
_EYE_MATRIX = {"rows": 4, "cols": 4, "data": _EYE}
_ORIGIN = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}


def _basalt(kind: str, model: LensModel, domain: str, **shape: str) -> CalibrationFormat:
    return CalibrationFormat(
        f"basalt_{kind}", "Basalt", model, f"basalt_{kind}.json", "json",
        {"value0": {
            "T_imu_cam": [_ORIGIN],
            "intrinsics": [{"camera_type": kind, "intrinsics": _FX | shape}],
            "resolution": [_SIZE],
            "calib_accel_bias": [0.0] * 9, "calib_gyro_bias": [0.0] * 12,
            "imu_update_rate": 200.0,
            "accel_noise_std": [0.016] * 3, "gyro_noise_std": [0.000282] * 3,
            "accel_bias_std": [0.001] * 3, "gyro_bias_std": [0.0001] * 3,
            "cam_time_offset_ns": 0, "vignette": [],
        }},
        domain, "VladyslavUsenko/basalt-headers: include/basalt/serialization/"
        "headers_serialization.h",
    )  # fmt: skip


def _camodocal(
    name: str, kind: str, model: LensModel, fields: Mapping[str, Any]
) -> CalibrationFormat:
    return CalibrationFormat(
        name, "CamOdoCal", model, f"{name}.yaml", "opencv",
        {"model_type": kind, "camera_name": "!$name", **_SIDES, **fields},
        FRONT if model is PINHOLE else _ANY,
        "own cv2.FileStorage; hengli/camodocal: src/camera_models/",
    )  # fmt: skip


def _boofcv(
    name: str, kind: str, model: LensModel, shape: Mapping[str, str], domain: str
) -> CalibrationFormat:
    return CalibrationFormat(
        name, "BoofCV", model, f"{name}.yaml", "yaml",
        {
            "pinhole": _FX | {"width": "$width", "height": "$height", "skew": "$skew?"}, **shape,
            "radial_tangential": {"radial": "[k1? k2? 0?]", "t1": "$p1?", "t2": "$p2?"},
            "model": kind, "version": 0,
        },
        domain, "lessthanoptimal/BoofCV: main/boofcv-io/src/main/java/boofcv/io/calibration/"
        "CalibrationIO.java",
    )  # fmt: skip


def _kalibr(
    kind: str, intrinsics: str, distortion: str, coefficients: str, model: LensModel, domain: str
) -> CalibrationFormat:
    names = {"pinhole equidistant": "kalibr_equi", "pinhole radtan": "kalibr_radtan"}
    name = names.get(f"{kind} {distortion.split('|')[0]}", f"kalibr_{kind}")
    return CalibrationFormat(
        name, "Kalibr", model, f"{name}.yaml", "yaml",
        {"cam0": {
            "camera_model": kind, "intrinsics": intrinsics, "distortion_model": distortion,
            "distortion_coeffs": coefficients, "resolution": _SIZE, "rostopic": "!$topic",
        }},
        domain, "own PyYAML; ethz-asl/kalibr: aslam_offline_calibration/kalibr/python/"
        "kalibr_common/ConfigReader.py",
    )  # fmt: skip


def _ros(
    name: str, kind: str, coefficients: str, model: LensModel, file_name: str
) -> CalibrationFormat:
    return CalibrationFormat(
        name, "ROS camera_info", model, file_name, "yaml",
        {
            **_SIDES,
            "camera_name": "!$name", "camera_matrix": _K, "distortion_model": kind,
            "distortion_coefficients": coefficients,
            "rectification_matrix": {"rows": 3, "cols": 3, "data": _EYE_3},
            "projection_matrix": "!3x4[fx 0 cx 0 0 fy cy 0 0 0 1 0]",
        },
        FRONT, "ros-perception/image_common: camera_calibration_parsers/src/parse_yml.cpp",
    )  # fmt: skip


def _ros_message(name: str, kind: str, coefficients: str, model: LensModel) -> CalibrationFormat:
    return CalibrationFormat(
        name, "ROS CameraInfo", model, f"{name}.yaml", "yaml",
        {
            "width": "$width", "height": "$height", "distortion_model": kind,
            "d|D": coefficients, "k|K": "[fx 0 cx 0 fy cy 0 0 1]",
            "r": _EYE_3, "p": "![fx 0 cx 0 0 fy cy 0 0 0 1 0]",
        },
        FRONT, "fields of sensor_msgs/CameraInfo",
    )  # fmt: skip


def _colmap(model: LensModel, kind: str, shape: str) -> CalibrationFormat:
    name = f"colmap_{kind.lower()}"
    return CalibrationFormat(
        name, "COLMAP", model, f"{name}.txt", "lines",
        {"cameras": [{"model": kind, "parameters": f"[width height fx fy cx cy {shape}]"}]},
        FRONT, "own pycolmap", first_pixel=0.5,
    )  # fmt: skip


def _nerfstudio(
    name: str, kind: str, model: LensModel, shape: Mapping[str, str], domain: str
) -> CalibrationFormat:
    return CalibrationFormat(
        name, "nerfstudio", model, f"{name}.json", "json",
        {
            "camera_model": kind, "fl_x": "$fx", "fl_y": "$fy", "cx": "$cx", "cy": "$cy",
            "w": "$width?", "h": "$height?", **shape, "fisheye_crop_radius": "$circle_px?",
            "frames": [],
        },
        domain, "nerfstudio-project/nerfstudio: nerfstudio/data/dataparsers/"
        "nerfstudio_dataparser.py", first_pixel=0.5,
    )  # fmt: skip


def _orb_slam(
    name: str, kind: str, model: LensModel, shape: Mapping[str, str], domain: str
) -> CalibrationFormat:
    return CalibrationFormat(
        name, "ORB-SLAM3", model, f"{name}.yaml", "opencv",
        {
            "File.version": "!1.0", "Camera.type": kind,
            **{f"Camera1.{key}|Camera.{key}": number for key, number in {**_FX, **shape}.items()},
            "Camera.width": "$width?", "Camera.height": "$height?",
            "Camera.fps": 30, "Camera.RGB": 1,
            "ORBextractor.nFeatures": 1000, "ORBextractor.scaleFactor": 1.2,
            "ORBextractor.nLevels": 8, "ORBextractor.iniThFAST": 20, "ORBextractor.minThFAST": 7,
            **{f"Viewer.{each}": 0.05 for each in ("KeyFrameSize", "CameraSize")},
            **{f"Viewer.{each}": 1.0 for each in ("KeyFrameLineWidth", "GraphLineWidth",
               "PointSize", "CameraLineWidth", "ViewpointX", "ViewpointY", "ViewpointZ")},
            "Viewer.ViewpointF": 500.0,
        },
        domain, "own cv2.FileStorage; UZ-SLAMLab/ORB_SLAM3: src/Settings.cc",
    )  # fmt: skip


def _stella(name: str, kind: str, model: LensModel, shape: Mapping[str, str]) -> CalibrationFormat:
    return CalibrationFormat(
        name, "stella_vslam", model, f"{name}.yaml", "yaml",
        {"Camera": {
            "name": "!$name", "setup": "!monocular", "model": kind, **_FX, **shape, "fps": 30.0,
            "cols": "$width", "rows": "$height", "color_order": "!RGB",
        }},
        FRONT, "stella-cv/stella_vslam: src/stella_vslam/camera/",
    )  # fmt: skip


def _okvis(name: str, kind: str, model: LensModel, coefficients: str) -> CalibrationFormat:
    return CalibrationFormat(
        name, "OKVIS2", model, f"{name}.yaml", "opencv",
        {
            "cameras": [{
                "T_SC": _EYE, "image_dimension": _SIZE, "distortion_coefficients": coefficients,
                "distortion_type": kind, "focal_length": "[fx fy]", "principal_point": _CENTRE,
                "camera_type": "!gray", "slam_use": "!okvis",
            }],
            "camera_parameters": {
                "timestamp_tolerance": 0.005, "image_delay": 0.0, "sync_cameras": [0],
                "online_calibration": {"do_extrinsics": False, "do_extrinsics_final_ba": False,
                                       "sigma_r": 0.001, "sigma_alpha": 0.05},
            },
            "imu_parameters": {
                "use": True, "a_max": 176.0, "g_max": 7.8, "sigma_g_c": 0.004, "sigma_a_c": 0.07,
                "sigma_bg": 0.01, "sigma_ba": 0.01, "sigma_gw_c": 0.00044, "sigma_aw_c": 0.00172,
                "g": 9.81, "a0": [0.0] * 3, "g0": [0.0] * 3, "T_BS": _EYE,
            },
            "frontend_parameters": {
                "detection_threshold": 40.0, "absolute_threshold": 4.0, "matching_threshold": 55.0,
                "octaves": 0, "max_num_keypoints": 800, "keyframe_overlap": 0.65, "use_cnn": False,
                "parallelise_detection": True, "num_matching_threads": 4,
            },
            "estimator_parameters": {
                "num_keyframes": 5, "num_loop_closure_frames": 5, "num_imu_frames": 3,
                "do_loop_closures": True, "do_final_ba": False, "enforce_realtime": True,
                "realtime_min_iterations": 3, "realtime_max_iterations": 10,
                "realtime_time_limit": 0.035, "realtime_num_threads": 4,
                "full_graph_iterations": 15, "full_graph_num_threads": 4,
            },
            "output_parameters": {"display_matches": True, "display_overhead": False},
        },
        FRONT, "own cv2.FileStorage; smartroboticslab/okvis2: okvis_common/src/"
        "ViParametersReader.cpp",
    )  # fmt: skip


def _kimera(
    name: str, kind: str, intrinsics: Any, distortion: str, model: LensModel,
    shape: Mapping[str, Any],
) -> CalibrationFormat:  # fmt: skip
    return CalibrationFormat(
        name, "Kimera-VIO", model, f"{name}.yaml", "opencv",
        {
            "camera_id": "!$name", "T_BS": _EYE_MATRIX, "rate_hz": 30, "resolution": _SIZE,
            "camera_model": kind, "intrinsics": intrinsics, "distortion_model": distortion, **shape,
        },
        FRONT, "own cv2.FileStorage; MIT-SPARK/Kimera-VIO: src/frontend/CameraParams.cpp",
    )  # fmt: skip


def _maplab(
    name: str, kind: str, intrinsics: str, distortion: str, coefficients: str, model: LensModel,
    domain: str,
) -> CalibrationFormat:  # fmt: skip
    identifier = "!0123456789abcdef0123456789abcde"
    return CalibrationFormat(
        name, "maplab, SVO", model, f"{name}.yaml", "yaml",
        {
            "label": "!$name", "id": identifier + "0", "sensor_type": "!NCAMERA", "topic": "!$name",
            "description": "!$name",
            "cameras": [{
                "camera": {
                    "label": "!$name", "id": identifier + "1", "sensor_type": "!CAMERA",
                    "topic": "!$topic", "description": "!$name", "line-delay-nanoseconds": 0,
                    **_SIDES, "type": kind, "intrinsics": intrinsics,
                    "distortion": {"type": distortion, "parameters": coefficients},
                    "mask": "@mask?",
                },
                "T_B_C": _EYE_MATRIX,
            }],
        },
        domain, "ethz-asl/aslam_cv2: aslam_cv_cameras/src/camera.cc, ncamera.cc; "
        "uzh-rpg/rpg_svo_pro_open: vikit/vikit_cameras/src/camera_yaml_serialization.cpp",
    )  # fmt: skip


def _vikit(name: str, kind: str, model: LensModel, terms: str) -> CalibrationFormat:
    return CalibrationFormat(
        name, "SVO, rpg_vikit", model, f"{name}.yaml", "yaml",
        {"cam0": {
            "cam_model": kind,
            **{f"cam_{key}": f"${key}" for key in ("width", "height", *_FX)},
            **{f"cam_d{place}": term for place, term in enumerate(terms.split())},
        }},
        FRONT, "uzh-rpg/rpg_svo_pro_open: vikit/vikit_cameras/src/camera_factory.cpp",
    )  # fmt: skip


def _adapter(
    kind: str, model: LensModel, domain: str, shape: Mapping[str, Any]
) -> CalibrationFormat:
    return CalibrationFormat(
        f"fca_{kind}", "fisheye-calib-adapter", model, f"fca_{kind}.yml", "yaml",
        {"image": {"width": "$width", "height": "$height"}, "parameter": shape},
        domain, "eowjd0512/fisheye-calib-adapter: parse() of src/model/",
    )  # fmt: skip


def _count(prefix: str, name: str, num_terms: int) -> dict[str, str]:
    """Numbered fields of a polynomial."""
    return {f"{prefix}{i}": f"${name}{i}" for i in range(num_terms)}


_WOODSCAPE = {
    "model": "radial_poly", "poly_order": 4, **_K4, "cx_offset": "$cx_offset",
    "cy_offset": "$cy_offset", "aspect_ratio": "$syy", "width": "$width", "height": "$height",
}  # fmt: skip

FORMATS: tuple[CalibrationFormat, ...] = (
    CalibrationFormat(
        "opencv_omnidir", "cv2.omnidir", MEI, "opencv_omnidir.yaml", "opencv",
        {
            "camera_name": "!$name", "image_width": "$width?", "image_height": "$height?",
            "K|camera_matrix": _SKEWED, "xi": "$xi",
            "D|distortion_coefficients": "1x4[k1 k2 p1 p2]",
        },
        _ANY, "own cv2.FileStorage and cv2.omnidir",
    ),
    _camodocal("camodocal", "MEI", MEI, {
        "mirror_parameters": {"xi": "$xi"}, "distortion_parameters": _K1_TO_P2,
        "projection_parameters": {"gamma1": "$fx", "gamma2": "$fy", "u0": "$cx", "v0": "$cy"},
    }),
    _camodocal("camodocal_kb", "KANNALA_BRANDT", KANNALA_BRANDT, {
        # Converters of Kalibr's files write a section that CamOdoCal itself does not read.
        **{f"projection_parameters/k{i + 1}|distortion_parameters/k{i + 1}": f"$k{i}"
           for i in (1, 2, 3, 4)},
        **{f"projection_parameters/{key}": f"${name}"
           for key, name in (("mu", "fx"), ("mv", "fy"), ("u0", "cx"), ("v0", "cy"))},
    }),
    _camodocal("camodocal_scaramuzza", "SCARAMUZZA", OCAM_4, {
        "poly_parameters": _count("p", "e", 5), "inv_poly_parameters": _count("p", "fwd", 20),
        "affine_parameters": {
            "ac": "$sxx", "ad": "$sxy", "ae": "$syx", "cx": "$cx", "cy": "$cy",
        },
    }),
    _camodocal("camodocal_pinhole", "PINHOLE", PINHOLE, {
        "distortion_parameters": _K1_TO_P2, "projection_parameters": _FX,
    }),
    _boofcv("boofcv", "omnidirectional_universal", MEI, {"mirror_offset": "$xi"}, _ANY),
    _boofcv("boofcv_pinhole", "pinhole_radial_tangential", PINHOLE, {}, FRONT),
    _kalibr("omni", "[xi fx fy cx cy]", "radtan|none", _SHORT_RADTAN, MEI, _OMNI),
    _kalibr("eucm", "[alpha beta fx fy cx cy]", "none", "[]", EUCM, _EUCM),
    _kalibr("ds", "[xi alpha fx fy cx cy]", "none", "[]", DOUBLE_SPHERE, _DS),
    _kalibr("pinhole", _FOCAL, "equidistant", _KB, KANNALA_BRANDT, FRONT),
    _kalibr("pinhole", _FOCAL, "radtan|none", _SHORT_RADTAN, PINHOLE, FRONT),
    _basalt("ucm", UCM, _EUCM, alpha="$alpha"),
    _basalt("eucm", EUCM, _EUCM, alpha="$alpha", beta="$beta"),
    _basalt("ds", DOUBLE_SPHERE, _DS, xi="$xi", alpha="$alpha"),
    _basalt("kb4", KANNALA_BRANDT, _ANY, **_K4),
    CalibrationFormat(
        "ocamcalib", "OCamCalib", OCAM, "ocamcalib.txt", "lines",
        {
            "polynomial": "[num_poly -poly*]", "inverse": "[num_inv inv*]", "centre": "[cy cx]",
            "affine": "[syy syx sxy]", "size": "[height width]",
        },
        _ANY, "ocam_functions.cpp", frame="x down, y right, z backward: a0 < 0",
    ),
    CalibrationFormat(
        "woodscape", "WoodScape", WOODSCAPE, "woodscape.json", "json",
        {
            "intrinsic": _WOODSCAPE, "name": "!$name",
            "extrinsic": {"quaternion": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0]},
        },
        _ANY, "valeoai/WoodScape: scripts/calibration/projection.py",
    ),
    _ros("ros_equidistant", "equidistant|fisheye", "1x4[k1 k2 k3 k4]", KANNALA_BRANDT,
         "camera_info.yaml"),
    _ros("ros_plumb_bob", "plumb_bob", "1x5" + _RADTAN, PINHOLE, "camera_info_plumb_bob.yaml"),
    _ros_message("ros_message", "equidistant|fisheye|kannala_brandt", _KB, KANNALA_BRANDT),
    _ros_message("ros_message_plumb_bob", "plumb_bob", _RADTAN, PINHOLE),
    CalibrationFormat(
        "opencv_fisheye", "cv2.fisheye", KANNALA_BRANDT, "opencv_fisheye.yaml", "opencv",
        {
            "image_width": "$width?", "image_height": "$height?",
            "K|camera_matrix|cameraMatrix|mtx": _SKEWED,
            "D|distortion_coefficients|distCoeffs|dist": "4x1[k1 k2 k3 k4]", "fisheye_model": 1,
        },
        FRONT, "own cv2.FileStorage and cv2.fisheye",
    ),
    CalibrationFormat(
        "opencv_pinhole", "cv2.calibrateCamera", PINHOLE, "opencv_pinhole.yaml", "opencv",
        {
            "image_width": "$width?", "image_height": "$height?",
            "camera_matrix|K|cameraMatrix|mtx": _K,
            "distortion_coefficients|D|distCoeffs|dist": "5x1[k1 k2 p1 p2 0]", "fisheye_model": 0,
        },
        FRONT, "own cv2.FileStorage and cv2.projectPoints",
    ),
    _colmap(KANNALA_BRANDT, "OPENCV_FISHEYE", "k1 k2 k3 k4"),
    _colmap(EUCM, "EUCM", "alpha beta"),
    _colmap(PINHOLE, "OPENCV", "k1 k2 p1 p2"),
    _nerfstudio("nerfstudio", "OPENCV_FISHEYE", KANNALA_BRANDT,
                {name: f"{number}?" for name, number in _K4.items()}, _ANY),
    _nerfstudio("nerfstudio_pinhole", "OPENCV", PINHOLE,
                _SHORT_K1_TO_P2 | {"k4": "$0?"}, FRONT),
    _orb_slam("orb_slam3", "KannalaBrandt8", KANNALA_BRANDT, _K4, _ANY),
    _orb_slam("orb_slam3_pinhole", "PinHole|Rectified", PINHOLE, _SHORT_K1_TO_P2, FRONT),
    _stella("stella_vslam", "fisheye", KANNALA_BRANDT, _K4),
    _stella("stella_vslam_perspective", "perspective", PINHOLE, _K1_TO_P2 | {"k3": "$0"}),
    _okvis("okvis2", "equidistant", KANNALA_BRANDT, _KB),
    _okvis("okvis2_radtan", "radialtangential|plumb_bob", PINHOLE, "[k1 k2 p1 p2]"),
    _kimera("kimera", "pinhole", _FOCAL, "equidistant", KANNALA_BRANDT,
            {"distortion_coefficients": _KB}),
    _kimera("kimera_radtan", "pinhole", _FOCAL, "radtan|radial-tangential|plumb_bob", PINHOLE,
            {"distortion_coefficients": "[k1 k2 p1 p2]"}),
    _kimera("kimera_omni", "omni", [], "omni", OCAM_4, {
        "distortion_coefficients": "[a0 a1 a2 a3 a4]", "omni_affine": "[sxy syx syy]",
        "omni_distortion_center": _CENTRE,
    }),
    _maplab("maplab", "pinhole", "4x1" + _FOCAL, "equidistant", "4x1" + _KB, KANNALA_BRANDT, FRONT),
    _maplab("maplab_radtan", "pinhole", "4x1" + _FOCAL, "radial-tangential|radtan",
            "4x1[k1 k2 p1 p2]", PINHOLE, FRONT),
    _maplab("maplab_unified", "unified-projection", "5x1[xi fx fy cx cy]", "radial-tangential",
            "4x1[k1 k2 p1 p2]", MEI, _OMNI),
    _maplab("svo_omni", "omni", "24x1[-a0 -a1 -a2 -a3 -a4 cx cy syy syx sxy "
            + " ".join(f"inv{i}" for i in range(12)) + " mask_from circle_share]",
            "none", "0x1[]", OCAM_4, _ANY),
    _vikit("vikit", "PinholeEquidistant", KANNALA_BRANDT, "$k1 $k2 $k3 $k4"),
    _vikit("vikit_radtan", "PinholeRadialTangential", PINHOLE, "$k1? $k2? $p1? $p2?"),
    CalibrationFormat(
        "multicol", "MultiCol-SLAM", OCAM_4, "multicol.yaml", "opencv",
        {
            "Camera.Iw": "$width", "Camera.Ih": "$height", "Camera.nrpol": 5,
            "Camera.nrinvpol": 12, **_count("Camera.a", "n", 5), **_count("Camera.pol", "inv", 12),
            "Camera.c": "$sxx", "Camera.d": "$sxy", "Camera.e": "$syx", "Camera.u0": "$cx",
            "Camera.v0": "$cy", "Camera.fov": "$fov_deg?",
            "Camera.mirrorMask": "$mirror_mask?",
        },
        _ANY, "own cv2.FileStorage; urbste/MultiCol-SLAM: src/cSystem.cpp, cam_model_omni.cpp",
    ),
    CalibrationFormat(
        "py_ocamcalib", "py-OCamCalib", OCAM, "py_ocamcalib.json", "json",
        {
            "camera_name": "!$name", "taylor_coefficient": "[poly*]", "distortion_center": _CENTRE,
            "stretch_matrix": "2x2[sxx sxy syx 1]", "inverse_poly": "[of_theta*]",
        },
        _ANY, "jakarto3d/py-OCamCalib: src/pyocamcalib/modelling/camera.py",
    ),
    CalibrationFormat(
        "py_omnicalib", "py-omnicalib", WOODSCAPE, "py_omnicalib.yml", "yaml",
        {"poly_incident_angle_to_radius": "[0 k1 k2 k3 k4]", "principal_point": _CENTRE},
        _ANY, "tasptz/py-omnicalib: omnicalib/projection.py",
    ),
    CalibrationFormat(
        "gyroflow", "gyroflow", KANNALA_BRANDT, "gyroflow.json", "json",
        {
            "name": "!$name", "calib_dimension": {"w": "$width", "h": "$height"},
            "orig_dimension": {"w": "!$width", "h": "!$height"},
            "distortion_model": "opencv_fisheye|null?", "calibrator_version": "!1.6.3",
            # Else it takes the image's middle for the centre that was calibrated.
            "asymmetrical": True,
            "fisheye_params": {
                "RMS_error": 0.0, "camera_matrix": _K, "distortion_coeffs": _KB,
                "radial_distortion_limit": "$tan_limit?",
            },
        },
        FRONT, "gyroflow/gyroflow: src/core/lens_profile.rs",
    ),
    _adapter("kb", KANNALA_BRANDT, FRONT, _FX | _K4),
    _adapter("ucm", UCM, _EUCM, _FX | {"alpha": "$alpha"}),
    _adapter("eucm", EUCM, _EUCM, _FX | {"alpha": "$alpha", "beta": "$beta"}),
    _adapter("ds", DOUBLE_SPHERE, _DS, _FX | {"alpha": "$alpha", "xi": "$xi"}),
    _adapter("ocam", OCAM, FRONT, {
        "c": "$sxx", "d": "$sxy", "e": "$syx", "cx": "$cx", "cy": "$cy",
        "coefficients": {"projection": "[fwd*]", "unprojection": "[poly*]"},
    }),
)  # fmt: skip
"""All formats, in the order of the report; of two that a file fits equally the first."""


def find_format(name: str) -> CalibrationFormat:
    """Format of a name.

    Raises:
        DomainError: There is none; with all names, and the nearest.
    """
    for each in FORMATS:
        if each.name == name:
            return each
    names = list_names(name, (each.name for each in FORMATS))
    raise DomainError(f"{name!r} is no calibration format: {names}")
