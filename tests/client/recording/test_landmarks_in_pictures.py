"""Hand, half pixels, frames and stamps at once: recorded landmarks fall on the drawn ones.

By cv2 and NumPy alone, from recorded transforms, calibration and landmarks.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from catoptra_client.recording.recorder import Recorder, RecordingPlan
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.bags import matrix_of, read_bag
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.server_process import start_server


@pytest.fixture(scope="module", params=["mirror", "fish-eye"])
def topics(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, list[tuple[int, Any]]]:
    folder = tmp_path_factory.mktemp("drive")
    is_mirror = request.param == "mirror"
    robot = OMNI_ROBOT if is_mirror else ROBOTS / "p2at_fisheye.ini"
    with start_server(folder, robot=robot) as server, server.connect_stream() as client:
        class_name = "USARBot.OmniP2AT" if is_mirror else "USARBot.FisheyeP2AT"
        client.spawn(class_name, start_pose=client.get_start_poses()[0].name)
        client.drive(0.5, 1.5)
        plan = RecordingPlan(
            camera="" if is_mirror else "FrontCam",
            encoding=ImageEncoding.PNG,
            views=("front",) if is_mirror else (),
        )
        # A busy machine draws few pictures a second.
        for seconds in (3.0, 9.0, 27.0):
            path = folder / f"{seconds:g}.mcap"
            Recorder(path, plan, stream_port=server.stream_port).record(seconds)
            found = read_bag(path)
            if len(found["/catoptra/frame"]) > 25:
                break
    return found


def find_projection(topics: dict[str, Any], prefix: str) -> Callable[[Any], Any]:
    """Pixels of points in the optical frame, whole at pixel centres, by cv2 alone."""
    zero = np.zeros(3)
    info = topics[f"{prefix}/camera_info"][0][1]
    if info.k.any():
        return lambda seen: cv2.projectPoints(seen[None], zero, zero, info.k.reshape(3, 3), info.d)
    exports = json.loads(topics[f"{prefix}/calibration"][0][1].data)["exports"]
    if "text" in exports["kalibr_equi"]:
        lens = yaml.safe_load(exports["kalibr_equi"]["text"])["cam0"]
        fu, fv, cu, cv = lens["intrinsics"]
        k, d = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]]), lens["distortion_coeffs"]
        return lambda seen: cv2.fisheye.projectPoints(seen[None], zero, zero, k, np.array(d))
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    model = cv2.FileStorage(exports["opencv_omnidir"]["text"], flags)
    k, d = model.getNode("K").mat(), model.getNode("D").mat()
    xi = model.getNode("xi").real()
    return lambda seen: cv2.omnidir.projectPoints(seen[None], zero, zero, k, xi, d)


def measure_median_px(
    topics: dict[str, Any], view: str = "", *, frames_late: int = 0, is_turned: bool = False
) -> float:
    """Median distance of the centroids of drawn and of projected beacons; 9 where none is drawn."""
    (camera,) = (topic[: -len("/calibration")] for topic in topics if "/calibration" in topic)
    prefix, frame = (f"{camera}/{view}", f"{camera[1:]}_{view}") if view else (
        camera, f"{camera[1:]}_optical_frame")  # fmt: skip
    project = find_projection(topics, prefix)
    fixed = {t.child_frame_id: matrix_of(t.transform) for _, m in topics["/tf_static"]
        for t in m.transforms}  # fmt: skip
    base_from_camera = fixed[frame]
    bases = {}
    for stamp, message in topics["/tf"]:
        links = {t.child_frame_id: matrix_of(t.transform) for t in message.transforms}
        bases[stamp] = links["odom"] @ links["base_link"]
    beacons: dict[str, list[Any]] = {}
    for marker in topics["/landmarks"][0][1].markers:
        if marker.type == 3:
            beacons.setdefault(marker.ns, []).append(marker)
    images, errors_px = topics[f"{prefix}/image/compressed"], []
    for number in range(1, len(images)):
        bgr = cv2.imdecode(images[number][1].data, cv2.IMREAD_COLOR).astype(float)
        colour = np.ptp(bgr[:, ::-1] if is_turned else bgr, axis=2)
        base = bases[images[number - frames_late][0]]
        camera_from_map = np.linalg.inv(base @ base_from_camera)
        for low, high in beacons.values():
            angle = np.linspace(0.0, 2 * np.pi, 72)
            bottom_m = low.pose.position.z - low.scale.z / 2
            top_m = high.pose.position.z + high.scale.z / 2
            heights, angles = np.meshgrid(np.linspace(bottom_m, top_m, 9), angle)
            x = low.pose.position.x + low.scale.x / 2 * np.cos(angles)
            y = low.pose.position.y + low.scale.x / 2 * np.sin(angles)
            points = np.stack([x, y, heights, np.ones_like(x)], axis=-1).reshape(-1, 4)
            seen = (points @ camera_from_map.T)[:, :3]
            # The exported fish-eye model and the pinhole have no pixels behind them.
            if seen[:, 2].min() < 0.1 and (view or "front" in camera.lower()):
                continue
            uv, _ = project(seen)
            hull = cv2.convexHull(uv.reshape(-1, 1, 2).astype(np.float32))
            moments, (left, top, width, height) = cv2.moments(hull), cv2.boundingRect(hull)
            is_whole = min(left, top) > 4 and left + width + 4 < colour.shape[1]
            # Of what is small elsewhere, a goal or a beacon behind it is a part.
            is_large = moments["m00"] >= (15.0 if "omni" in camera.lower() else 100.0)
            if not (is_large and is_whole and top + height + 4 < colour.shape[0]):
                continue
            rows, columns = slice(top - 4, top + height + 4), slice(left - 4, left + width + 4)
            # Both colours weigh the same; pixels of the border by what they have of them.
            weight = np.clip(colour[rows, columns] - 40.0, 0.0, 80.0)
            v, u = np.mgrid[rows, columns]
            centre = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
            total = weight.sum()
            found = np.array([(weight * u).sum(), (weight * v).sum()]) / max(total, 1e-9)
            errors_px.append(float(np.hypot(*(found - centre))) if total else 9.0)
    assert len(errors_px) > 5
    return float(np.median(errors_px))


def test_landmarks_fall_on_the_drawn_ones(topics: dict[str, Any]) -> None:
    assert measure_median_px(topics) < 0.3


def test_landmarks_fall_on_those_of_a_pinhole_view(topics: dict[str, Any]) -> None:
    # Eight pixels of the view are one of the picture.
    if any("front" in topic for topic in topics):
        assert measure_median_px(topics, "front") < 1.0


def test_expected_pixels_are_projections_of_the_band_centres(topics: dict[str, Any]) -> None:
    (camera,) = (topic[: -len("/calibration")] for topic in topics if "/calibration" in topic)
    project, errors_px = find_projection(topics, camera), []
    (fixed,) = (t.transform for t in topics["/tf_static"][-1][1].transforms
        if t.child_frame_id == f"{camera[1:]}_optical_frame")  # fmt: skip
    poses = [(stamp, message.pose.pose) for stamp, message in topics["/ground_truth"]]
    stamps = [stamp for stamp, _ in poses]
    table = {one["name"]: one for one in json.loads(topics["/landmarks/json"][0][1].data)}

    def interpolate(stamp: int, part: str, names: str) -> Any:
        rows = np.array([[getattr(getattr(pose, part), one) for one in names] for _, pose in poses])
        values = [np.interp(stamp, stamps, column) for column in rows.T]
        return SimpleNamespace(**dict(zip(names, values, strict=True)))

    for stamp, message in topics["/landmarks/pixels"]:
        pose = SimpleNamespace(
            translation=interpolate(stamp, "position", "xyz"),
            rotation=interpolate(stamp, "orientation", "xyzw"),
        )
        camera_from_map = np.linalg.inv(matrix_of(pose) @ matrix_of(fixed))
        for found in json.loads(message.data)["landmarks"]:
            one = table[found["name"]]
            middle_m = 0.5 * (one["band_bottom_m"] + one["band_top_m"])
            seen = (camera_from_map @ (one["x_m"], -one["y_m"], middle_m, 1.0))[:3]
            if found["visible"] and (seen[2] > 0.1 or "front" not in camera.lower()):
                (expected,) = project(seen[None])[0].reshape(-1, 2)
                errors_px.append(np.hypot(*(found["pixel"] - expected - 0.5)))
    assert len(errors_px) > 5
    assert np.median(errors_px) < 0.1


@pytest.mark.parametrize(("frames_late", "is_turned"), [(1, False), (0, True)])
def test_landmarks_miss_with_a_wrong_stamp_or_hand(
    topics: dict[str, Any], frames_late: int, is_turned: bool
) -> None:
    assert measure_median_px(topics, frames_late=frames_late, is_turned=is_turned) > 0.45
