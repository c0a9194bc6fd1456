"""Readers of calibration files as their own programs have them: parser, required keys, projection.

`read` has one reader for each format: the program itself where it is installed (OpenCV with its
FileStorage, pycolmap, PyYAML for Kalibr), else its parser transcribed with the keys and types that
it demands, and its formula. Each makes a function from points (n, 3) to pixels, first centre 0.
"""

# ruff: noqa: PT018  the demands of a parser on one line

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.polynomial.polynomial import polyval

from catoptra_protocol.optics.numerics import Floats

Project = Callable[[Floats], Floats]


def _k(numbers: Any, plane: Floats) -> Floats:
    fx, fy, cx, cy = numbers
    return np.stack((fx * plane[0] + cx, fy * plane[1] + cy), axis=-1)


def mei(numbers: Any, xi: float, d: Any = (0.0, 0.0, 0.0, 0.0), skew: float = 0.0) -> Project:
    def project(points: Floats) -> Floats:
        k1, k2, p1, p2 = d
        x, y = points[:, :2].T / (points[:, 2] + xi * np.linalg.norm(points, axis=-1))
        r2 = x * x + y * y
        gain = 1.0 + k1 * r2 + k2 * r2 * r2
        plane = np.stack((
            gain * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            gain * y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ))  # fmt: skip
        return _k(numbers, plane) + np.stack((skew * plane[1], 0.0 * plane[1]), axis=-1)

    return project


def _pinhole(numbers: Any, d: Any) -> Project:
    assert len(d) in (4, 5) and sum(d[4:]) == 0.0
    return mei(numbers, 0.0, d[:4])


def _eucm(numbers: Any, alpha: float, beta: float = 1.0) -> Project:
    def project(points: Floats) -> Floats:
        x, y, z = points.T
        d = np.sqrt(beta * (x * x + y * y) + z * z)
        return _k(numbers, np.stack((x, y)) / (alpha * d + (1.0 - alpha) * z))

    return project


def _ds(numbers: Any, xi: float, alpha: float) -> Project:
    def project(points: Floats) -> Floats:
        x, y, z = points.T
        shifted = xi * np.linalg.norm(points, axis=-1) + z
        d2 = np.sqrt(x * x + y * y + shifted**2)
        return _k(numbers, np.stack((x, y)) / (alpha * d2 + (1.0 - alpha) * shifted))

    return project


def kannala_brandt(numbers: Any, terms: Any) -> Project:
    assert len(terms) == 4
    return _by_angle(numbers, lambda a: a * polyval(a * a, (1.0, *terms)))


def _by_angle(numbers: Any, radius: Callable[[Floats], Floats]) -> Project:
    def project(points: Floats) -> Floats:
        rho = np.hypot(points[:, 0], points[:, 1])
        theta = np.arctan2(rho, points[:, 2])
        return _k(numbers, points[:, :2].T / np.maximum(rho, 1e-300) * radius(theta))

    return project


def _ocam(matrix: Any, centre: Any, forward: Any, inverse: Any, sign: float) -> Project:
    """World to image by the inverse polynomial of atan(sign z / rho); the other way must agree."""

    def project(points: Floats) -> Floats:
        rho = np.hypot(points[:, 0], points[:, 1])
        radius = polyval(np.arctan2(sign * points[:, 2], rho), inverse)
        height = sign * polyval(radius, forward)
        turned = np.arctan2(radius, height) - np.arctan2(rho, points[:, 2])
        assert np.abs(turned[radius > 1.0]).max() < 2e-3
        plane = points[:, :2].T / np.maximum(rho, 1e-300) * radius
        return (np.array(matrix).reshape(2, 2) @ plane).T + np.array(centre)

    return project


class _Storage:
    """cv2.FileStorage, whose missing nodes are errors as in programs that check them."""

    def __init__(self, path: Path) -> None:
        self._storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        assert self._storage.isOpened()

    def __getitem__(self, key: str) -> Any:
        return _value(self._storage.getNode(key), key)


def _value(node: Any, key: str) -> Any:
    assert not node.empty(), key
    if node.isInt():
        return int(node.real())
    if node.isReal():
        return node.real()
    if node.isString():
        return node.string()
    if node.isSeq():
        return [_value(node.at(index), key) for index in range(node.size())]
    matrix = node.mat() if "data" in node.keys() and "dt" in node.keys() else None
    if matrix is not None:
        return matrix.ravel().tolist()
    return {name: _value(node.getNode(name), name) for name in node.keys()}


def _yaml(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


def _check(value: Any, kind: type, length: int | None = None) -> Any:
    if length is not None:
        assert isinstance(value, list) and len(value) == length
        return [_check(each, kind) for each in value]
    assert type(value) is kind, value
    return value


def _four(node: Any, names: str = "fx fy cx cy", kind: type = float) -> list[float]:
    return [_check(node[name], kind) for name in names.split()]


def _matrix(node: Any, rows: int, cols: int) -> list[float]:
    assert (node["rows"], node["cols"]) == (rows, cols) and len(node["data"]) == rows * cols
    return [float(each) for each in node["data"]]


def _of_k(k: Any) -> tuple[float, float, float, float]:
    flat = np.ravel(k)
    return flat[0], flat[4], flat[2], flat[5]


def _opencv(path: Path, name: str) -> Project:
    s = _Storage(path)
    zero = np.zeros((1, 3))
    names = ("K", "D") if name != "opencv_pinhole" else ("camera_matrix", "distortion_coefficients")
    k, d = np.array(s[names[0]]).reshape(3, 3), np.array(s[names[1]])
    assert type(s["image_width"]) is int and type(s["image_height"]) is int
    if name == "opencv_omnidir":
        return lambda p: cv2.omnidir.projectPoints(p[None], zero, zero, k, s["xi"], d[None])[0][0]
    if name == "opencv_fisheye":
        return lambda p: cv2.fisheye.projectPoints(p[None], zero, zero, k, d)[0][0]
    return lambda p: cv2.projectPoints(p, zero, zero, k, d)[0][:, 0]


def _camodocal(path: Path, name: str) -> Project:
    s = _Storage(path)
    assert type(s["image_width"]) is int and type(s["image_height"]) is int and s["camera_name"]
    kinds = {"camodocal": "MEI", "camodocal_kb": "KANNALA_BRANDT",
             "camodocal_scaramuzza": "SCARAMUZZA", "camodocal_pinhole": "PINHOLE"}  # fmt: skip
    assert s["model_type"] == kinds[name]
    if name == "camodocal_scaramuzza":
        a, *nodes = (s[f"{one}_parameters"] for one in ("affine", "poly", "inv_poly"))
        poly, inverse = ([node[f"p{i}"] for i in range(n)] for node, n in zip(nodes, (5, 20)))  # noqa: B905
        matrix, centre = (a["ac"], a["ad"], a["ae"], 1.0), (a["cx"], a["cy"])
        return _ocam(matrix, centre, poly, inverse, 1.0)
    k = s["projection_parameters"]
    if name == "camodocal_kb":
        return kannala_brandt(_four(k, "mu mv u0 v0"), _four(k, "k2 k3 k4 k5"))
    d = _four(s["distortion_parameters"], "k1 k2 p1 p2")
    if name == "camodocal_pinhole":
        return _pinhole(_four(k), d)
    return mei(_four(k, "gamma1 gamma2 u0 v0"), s["mirror_parameters"]["xi"], d)


def _boofcv(path: Path, name: str) -> Project:
    # `load` and `loadPinhole` cast: a whole number is no double.
    v = _yaml(path)
    k, d = v["pinhole"], v["radial_tangential"]
    assert type(k["width"]) is int and type(k["height"]) is int
    numbers, skew = _four(k), _check(k["skew"], float)
    k1, k2, k3 = _check(d["radial"], float, 3)
    kinds = {"boofcv": "omnidirectional_universal", "boofcv_pinhole": "pinhole_radial_tangential"}
    assert v["model"] == kinds[name] and k3 == 0.0
    xi = _check(v["mirror_offset"], float) if name == "boofcv" else 0.0
    return mei(numbers, xi, (k1, k2, *_four(d, "t1 t2")), skew)


def _kalibr(path: Path, _: str) -> Project:
    v = _yaml(path)["cam0"]
    assert v["distortion_model"] in ("radtan", "equidistant", "none") and v["rostopic"]
    _check(v["resolution"], int, 2)
    lengths = {"omni": 5, "eucm": 6, "ds": 6, "pinhole": 4}
    *shape, fu, fv, pu, pv = _check(v["intrinsics"], float, lengths[v["camera_model"]])
    assert min(fu, fv, pu, pv) > 0.0
    numbers, d = (fu, fv, pu, pv), v["distortion_coeffs"]
    _check(d, float, 0 if v["distortion_model"] == "none" else 4)
    if v["camera_model"] == "omni":
        return mei(numbers, *shape, d=d)
    if v["camera_model"] == "pinhole":
        return (kannala_brandt if v["distortion_model"] == "equidistant" else _pinhole)(numbers, d)
    assert v["distortion_model"] == "none" and 0.0 <= shape[v["camera_model"] == "ds"] < 1.0
    return _ds(numbers, *shape) if v["camera_model"] == "ds" else _eucm(numbers, *shape)


_BASALT_FIELDS = {"calib_accel_bias": 9, "calib_gyro_bias": 12, "accel_noise_std": 3,
                  "gyro_noise_std": 3, "accel_bias_std": 3, "gyro_bias_std": 3}  # fmt: skip


def _basalt(path: Path, name: str) -> Project:
    v = json.loads(path.read_text())
    assert next(iter(v)) == "value0"  # cereal takes the first one
    v = v["value0"]
    for field, length in _BASALT_FIELDS.items():
        _check(v[field], float, length)
    _check(v["imu_update_rate"], float), _check(v["cam_time_offset_ns"], int)
    assert v["vignette"] == [] and len(v["T_imu_cam"]) == 1
    _four(v["T_imu_cam"][0], "px py pz qx qy qz qw")
    assert len(v["resolution"]) == 1
    _check(v["resolution"][0], int, 2)
    kind, k = v["intrinsics"][0]["camera_type"], v["intrinsics"][0]["intrinsics"]
    assert f"basalt_{kind}" == name
    if kind == "kb4":
        return kannala_brandt(_four(k), _four(k, "k1 k2 k3 k4"))
    if kind == "ds":
        return _ds(_four(k), k["xi"], k["alpha"])
    return _eucm(_four(k), k["alpha"], k["beta"] if kind == "eucm" else 1.0)


def _ocamcalib(path: Path, _: str) -> Project:
    # A comment, then a line of numbers, five times: fgets, then fscanf.
    lines = path.read_text().splitlines()
    assert all(line.startswith("#") for line in lines[:10:2])
    poly, inverse, (row, column), (c, d, e), size = (
        [float(word) for word in line.split()] for line in lines[1:10:2]
    )
    assert poly[0] == len(poly) - 1 and inverse[0] == len(inverse) - 1 and len(size) == 2
    project = _ocam((c, d, e, 1.0), (row, column), poly[1:], inverse[1:], 1.0)
    # Their frame: x down the rows, y along the columns, z away from the scene.
    return lambda p: project(p[:, [1, 0, 2]] * (1.0, 1.0, -1.0))[:, ::-1]


def _woodscape(path: Path, _: str) -> Project:
    v = json.loads(path.read_text())
    i, e = v["intrinsic"], v["extrinsic"]
    assert len(e["quaternion"]) == 4 and len(e["translation"]) == 3
    size = np.array((i["width"], i["height"]), dtype=int)
    centre = 0.5 * size + (i["cx_offset"], i["cy_offset"]) - 0.5
    k = (0.0, i["k1"], i["k2"], i["k3"], i["k4"])
    return _by_angle((1.0, i["aspect_ratio"], *centre), lambda a: polyval(a, k))


def _ros(path: Path, name: str) -> Project:
    v = _yaml(path)
    if "message" in name:
        assert len(v["k"]) == len(v["r"]) == 9 and len(v["p"]) == 12 and v["width"] and v["height"]
        return (_pinhole if "bob" in name else kannala_brandt)(_of_k(v["k"]), v["d"])
    assert type(v["image_width"]) is int and type(v["image_height"]) is int and v["camera_name"]
    _matrix(v["rectification_matrix"], 3, 3), _matrix(v["projection_matrix"], 3, 4)
    d = v["distortion_coefficients"]
    make = {"equidistant": kannala_brandt, "plumb_bob": _pinhole}[v["distortion_model"]]
    return make(_of_k(_matrix(v["camera_matrix"], 3, 3)), _matrix(d, d["rows"], d["cols"]))


def _colmap(path: Path, _: str) -> Project:
    import pycolmap

    for empty in ("images.txt", "points3D.txt"):
        (path.parent / empty).touch()
    path.rename(path.parent / "cameras.txt")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(path.parent))
    camera = reconstruction.cameras[1]
    return lambda p: np.asarray(camera.img_from_cam(p, False)) - 0.5


def _nerfstudio(path: Path, name: str) -> Project:
    # Of `_generate_dataparser_outputs`; frames of pictures, with a pose each, are the user's.
    meta = json.loads(path.read_text())
    assert meta["frames"] == []
    kind = {"OPENCV_FISHEYE": "fisheye", "OPENCV": "perspective"}[meta["camera_model"]]
    fx, fy, cx, cy = (float(meta[key]) for key in ("fl_x", "fl_y", "cx", "cy"))
    assert int(meta["h"]) > 0 and int(meta["w"]) > 0 and "fisheye_crop_radius" not in meta
    k1, k2, k3, k4, p1, p2 = (float(meta.get(key, 0.0)) for key in "k1 k2 k3 k4 p1 p2".split())
    numbers = (fx, fy, cx - 0.5, cy - 0.5)  # `get_image_coords` adds 0.5 to whole pixels
    if kind == "fisheye":
        return kannala_brandt(numbers, (k1, k2, k3, k4))
    assert k3 == k4 == 0.0
    return _pinhole(numbers, (k1, k2, p1, p2))


_ORB_INTS = "width height fps RGB nFeatures nLevels iniThFAST minThFAST".split()
_ORB_VIEWER = (
    "KeyFrameSize KeyFrameLineWidth GraphLineWidth PointSize CameraSize CameraLineWidth "
    "ViewpointX ViewpointY ViewpointZ ViewpointF"
).split()


def _orb_slam(path: Path, name: str) -> Project:
    s = _Storage(path)
    assert s["File.version"] == "1.0"
    for place, key in enumerate(_ORB_INTS):
        _check(s[f"{'Camera' if place < 4 else 'ORBextractor'}.{key}"], int)
    for key in ("ORBextractor.scaleFactor", *(f"Viewer.{each}" for each in _ORB_VIEWER)):
        assert isinstance(s[key], (int, float))
    numbers = [s[f"Camera1.{each}"] for each in ("fx", "fy", "cx", "cy")]
    if name == "orb_slam3":
        assert s["Camera.type"] == "KannalaBrandt8"
        return kannala_brandt(numbers, [s[f"Camera1.k{i}"] for i in (1, 2, 3, 4)])
    assert s["Camera.type"] == "PinHole"
    return _pinhole(numbers, [s[f"Camera1.{each}"] for each in ("k1", "k2", "p1", "p2", "k3")])


def _stella(path: Path, name: str) -> Project:
    v = _yaml(path)["Camera"]
    assert v["setup"] == "monocular" and v["color_order"] == "RGB" and v["name"]
    assert type(v["cols"]) is int and type(v["rows"]) is int and v["fps"] > 0.0
    if name == "stella_vslam":
        assert v["model"] == "fisheye"
        return kannala_brandt(_four(v), _four(v, "k1 k2 k3 k4"))
    assert v["model"] == "perspective"
    return _pinhole(_four(v), _four(v, "k1 k2 p1 p2 k3"))


_OKVIS = {
    "camera_parameters": "timestamp_tolerance image_delay",
    "imu_parameters": "a_max g_max sigma_g_c sigma_bg sigma_a_c sigma_ba sigma_gw_c sigma_aw_c g",
    "frontend_parameters": "detection_threshold absolute_threshold matching_threshold "
    "keyframe_overlap octaves:int max_num_keypoints:int num_matching_threads:int use_cnn:str "
    "parallelise_detection:str",
    "estimator_parameters": "num_keyframes:int num_loop_closure_frames:int num_imu_frames:int "
    "do_loop_closures:str do_final_ba:str enforce_realtime:str realtime_min_iterations:int "
    "realtime_max_iterations:int realtime_time_limit realtime_num_threads:int "
    "full_graph_iterations:int full_graph_num_threads:int",
    "output_parameters": "display_matches:str display_overhead:str",
}


def _okvis(path: Path, name: str) -> Project:
    s = _Storage(path)
    kinds = {"": float, "int": int, "str": str}
    for section, entries in _OKVIS.items():
        values = s[section]
        for entry in entries.split():
            key, _, kind = entry.partition(":")
            # A truth value is an integer since OpenCV 5.
            assert type(values[key]) is kinds[kind] or (kind, values[key]) in (
                ("str", 0),
                ("str", 1),
            )
    assert s["imu_parameters"]["use"] in ("true", 1)
    (camera,) = s["cameras"]
    for values, length in ((camera["T_SC"], 16), (s["imu_parameters"]["T_BS"], 16)):
        _check(values, float, length)
    _check(camera["image_dimension"], int, 2)
    assert camera["camera_type"] == "gray" and camera["slam_use"] == "okvis"
    numbers = (*_check(camera["focal_length"], float, 2), *camera["principal_point"])
    kind = {"okvis2": "equidistant", "okvis2_radtan": "radialtangential"}[name]
    assert camera["distortion_type"] == kind
    return (kannala_brandt if name == "okvis2" else _pinhole)(
        numbers, camera["distortion_coefficients"]
    )


def _kimera(path: Path, name: str) -> Project:
    s = _Storage(path)
    assert s["camera_id"] and _check(s["rate_hz"], int) > 0
    _matrix(s["T_BS"], 4, 4), _check(s["resolution"], int, 2)
    d = s["distortion_coefficients"]
    if name == "kimera_omni":
        assert s["camera_model"] == s["distortion_model"] == "omni" and s["intrinsics"] == []
        # It has no projection: rays of pixels by the polynomial, which is inverted here.
        matrix, centre = (1.0, *s["omni_affine"]), s["omni_distortion_center"]
        radius = np.linspace(0.0, 2000.0, 400_001)
        theta = np.arctan2(radius, polyval(radius, _check(d, float, 5)))
        rising = int(np.argmax(np.append(np.diff(theta) <= 0.0, True))) + 1
        plane = _by_angle(
            (1.0, 1.0, 0.0, 0.0), lambda a: np.interp(a, theta[:rising], radius[:rising])
        )
        return lambda p: plane(p) @ np.array(matrix).reshape(2, 2).T + np.array(centre)
    assert s["camera_model"] == "pinhole"
    kind = {"kimera": "equidistant", "kimera_radtan": "radtan"}[name]
    assert s["distortion_model"] == kind
    return (kannala_brandt if name == "kimera" else _pinhole)(s["intrinsics"], _check(d, float, 4))


def _maplab(path: Path, name: str) -> Project:
    v = _yaml(path)
    assert v["label"] and len(v["id"]) == 32
    (entry,) = v["cameras"]
    _matrix(entry["T_B_C"], 4, 4)
    c = entry["camera"]
    assert type(c["image_width"]) is int and type(c["image_height"]) is int and c["id"] != v["id"]
    assert c["line-delay-nanoseconds"] == 0 and c["label"]
    intrinsics, d = c["intrinsics"], c["distortion"]
    numbers = _matrix(intrinsics, len(intrinsics["data"]), 1)
    terms = _matrix(d["parameters"], len(d["parameters"]["data"]), 1)
    if name == "svo_omni":
        assert (c["type"], d["type"], len(numbers)) == ("omni", "none", 24)
        c_, d_, e_ = numbers[7:10]
        assert numbers[22:] == [0.0, 0.0]  # no mask
        return _ocam((1.0, e_, d_, c_), numbers[5:7], numbers[:5], numbers[10:22], -1.0)
    if name == "maplab_unified":
        assert (c["type"], d["type"]) == ("unified-projection", "radial-tangential")
        return mei(numbers[1:], numbers[0], terms)
    assert c["type"] == "pinhole"
    assert d["type"] == {"maplab": "equidistant", "maplab_radtan": "radial-tangential"}[name]
    return (kannala_brandt if name == "maplab" else _pinhole)(numbers, terms)


def _vikit(path: Path, name: str) -> Project:
    v = _yaml(path)["cam0"]
    assert type(v["cam_width"]) is int and type(v["cam_height"]) is int
    kinds = {"vikit": "PinholeEquidistant", "vikit_radtan": "PinholeRadialTangential"}
    assert v["cam_model"] == kinds[name]
    return (kannala_brandt if name == "vikit" else _pinhole)(
        _four(v, "cam_fx cam_fy cam_cx cam_cy"), _four(v, "cam_d0 cam_d1 cam_d2 cam_d3")
    )


def _multicol(path: Path, _: str) -> Project:
    s = _Storage(path)
    assert type(s["Camera.Iw"]) is int and type(s["Camera.Ih"]) is int
    poly = [s[f"Camera.a{i}"] for i in range(_check(s["Camera.nrpol"], int))]
    inverse = [s[f"Camera.pol{i}"] for i in range(_check(s["Camera.nrinvpol"], int))]
    c, d, e, u, v = (s[f"Camera.{each}"] for each in ("c", "d", "e", "u0", "v0"))
    return _ocam((c, d, e, 1.0), (u, v), poly, inverse, -1.0)


def _py_ocamcalib(path: Path, _: str) -> Project:
    v = json.loads(path.read_text())
    matrix = np.array(v["stretch_matrix"])
    assert matrix.shape == (2, 2) and matrix[1, 1] == 1.0 and v["taylor_coefficient"][0] > 0.0
    # Its world2cam_fast stretches x twice where e is not 0; its cam2world does not.
    plane = _by_angle((1.0, 1.0, 0.0, 0.0), lambda a: np.polyval(v["inverse_poly"], a))
    return lambda p: plane(p) @ matrix.T + np.array(v["distortion_center"])


def _py_omnicalib(path: Path, _: str) -> Project:
    v = _yaml(path)
    terms = v["poly_incident_angle_to_radius"]
    return _by_angle((1.0, 1.0, *v["principal_point"]), lambda a: polyval(a, terms))


def _gyroflow(path: Path, _: str) -> Project:
    # `load_from_data` and `get_camera_matrix_internal`; serde takes no other types.
    v = json.loads(path.read_text())
    assert _check(v["calibrator_version"], str)
    assert v.get("distortion_model") in (None, "opencv_fisheye")
    for dimension in (v["calib_dimension"], v["orig_dimension"]):
        assert min(_four(dimension, "w h", int)) > 0
    params = v["fisheye_params"]
    k = np.array([_check(row, float, 3) for row in params["camera_matrix"]])
    assert k.shape == (3, 3) and _check(params["RMS_error"], float) >= 0.0
    assert params.get("radial_distortion_limit") is None
    if not _check(v.get("asymmetrical", False), bool):
        k[:2, 2] = 0.5 * v["calib_dimension"]["w"], 0.5 * v["calib_dimension"]["h"]
    return kannala_brandt(_of_k(k), _check(params["distortion_coeffs"], float, 4))


def _adapter(path: Path, name: str) -> Project:
    v = _yaml(path)
    assert type(v["image"]["width"]) is int and type(v["image"]["height"]) is int
    p = v["parameter"]
    if name == "fca_ocam":
        c = p["coefficients"]
        return _ocam((p["c"], p["d"], p["e"], 1.0), (p["cx"], p["cy"]),
                     c["unprojection"], c["projection"], 1.0)  # fmt: skip
    if name == "fca_kb":
        return kannala_brandt(_four(p), _four(p, "k1 k2 k3 k4"))
    if name == "fca_ds":
        return _ds(_four(p), p["xi"], p["alpha"])
    return _eucm(_four(p), p["alpha"], p["beta"] if name == "fca_eucm" else 1.0)


_READERS: dict[str, Callable[[Path, str], Project]] = {
    "opencv": _opencv, "camodocal": _camodocal, "boofcv": _boofcv, "kalibr": _kalibr,
    "basalt": _basalt, "ocamcalib": _ocamcalib, "woodscape": _woodscape, "ros": _ros,
    "colmap": _colmap, "nerfstudio": _nerfstudio, "orb": _orb_slam, "stella": _stella,
    "okvis2": _okvis, "kimera": _kimera, "maplab": _maplab, "svo": _maplab, "vikit": _vikit,
    "multicol": _multicol, "py_ocamcalib": _py_ocamcalib, "py_omnicalib": _py_omnicalib,
    "gyroflow": _gyroflow, "fca": _adapter,
}  # fmt: skip


def read(path: Path, name: str) -> Project:
    """Pixels of points by the reader of a format's program; AssertionError and KeyError reject."""
    reader = _READERS.get(name) or _READERS[name.split("_")[0]]
    return reader(path, name)
