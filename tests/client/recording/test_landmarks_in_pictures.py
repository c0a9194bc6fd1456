"""Hand, half pixels, frames and stamps at once: recorded landmarks fall on the drawn ones.

By cv2 and NumPy alone, from recorded transforms, calibration and landmarks.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from catoptra_client.recording.recorder import Recorder, RecordingPlan
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.bags import matrix_of, read_bag
from helpers.configs import OMNI_ROBOT
from helpers.server_process import start_server


@pytest.fixture(scope="module")
def topics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    folder = tmp_path_factory.mktemp("drive")
    with start_server(folder, robot=OMNI_ROBOT) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", start_pose=client.get_start_poses()[0].name)
        client.drive(0.5, 1.5)
        plan = RecordingPlan(encoding=ImageEncoding.PNG)
        Recorder(folder / "a.mcap", plan, stream_port=server.stream_port).record(3.0)
    return read_bag(Path(folder, "a.mcap"))


def measure_median_px(topics: dict[str, Any], *, frames_late: int, is_turned: bool) -> float:
    """Median distance of the centroids of drawn and of projected beacons; 9 where none is drawn."""
    (prefix,) = (topic[: -len("/calibration")] for topic in topics if "/calibration" in topic)
    exports = json.loads(topics[f"{prefix}/calibration"][0][1].data)["exports"]
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    model = cv2.FileStorage(exports["opencv_omnidir"]["text"], flags)
    k, d, xi = model.getNode("K").mat(), model.getNode("D").mat(), model.getNode("xi").real()
    fixed = {t.child_frame_id: matrix_of(t.transform) for _, m in topics["/tf_static"]
        for t in m.transforms}  # fmt: skip
    base_from_camera = fixed[f"{prefix[1:]}_optical_frame"]
    bases = {}
    for stamp, message in topics["/tf"]:
        links = {t.child_frame_id: matrix_of(t.transform) for t in message.transforms}
        bases[stamp] = links["odom"] @ links["base_link"]
    beacons: dict[str, list[Any]] = {}
    for marker in topics["/landmarks"][0][1].markers:
        if marker.type == 3:
            beacons.setdefault(marker.ns, []).append(marker)
    images, errors_px = topics[f"{prefix}/image/compressed"], []
    for number in range(1, len(images), 4):
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
            uv, _ = cv2.omnidir.projectPoints(seen[None], np.zeros(3), np.zeros(3), k, xi, d)
            hull = cv2.convexHull(uv.reshape(-1, 1, 2).astype(np.float32))
            moments, (left, top, width, height) = cv2.moments(hull), cv2.boundingRect(hull)
            if moments["m00"] < 15.0:
                continue
            rows, columns = slice(top - 4, top + height + 4), slice(left - 4, left + width + 4)
            weight = np.where(colour[rows, columns] > 90.0, colour[rows, columns], 0.0)
            v, u = np.mgrid[rows, columns]
            centre = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
            total = weight.sum()
            found = np.array([(weight * u).sum(), (weight * v).sum()]) / max(total, 1e-9)
            errors_px.append(float(np.hypot(*(found - centre))) if total else 9.0)
    assert len(errors_px) > 10
    return float(np.median(errors_px))


def test_landmarks_fall_on_the_drawn_ones(topics: dict[str, Any]) -> None:
    assert measure_median_px(topics, frames_late=0, is_turned=False) < 0.3


@pytest.mark.parametrize(("frames_late", "is_turned"), [(1, False), (0, True)])
def test_landmarks_miss_with_a_wrong_stamp_or_hand(
    topics: dict[str, Any], frames_late: int, is_turned: bool
) -> None:
    assert measure_median_px(topics, frames_late=frames_late, is_turned=is_turned) > 0.45
