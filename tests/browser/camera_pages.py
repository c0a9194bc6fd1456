"""Pages that show a camera, a mirror or a lens of any mounting, and what they draw."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from browser.chromium import Browser
from browser.live_server import (
    CAMERA,
    LiveServer,
    start_live_server,
    write_cone_robot,
    write_decentred_robot,
    write_fisheye_robot,
    write_parabolic_robot,
    write_plain_robot,
    write_sphere_robot,
    write_tilted_robot,
)
from browser.stream_probe import connect_probe
from browser.tab import Tab, open_tab
from catoptra_client.unwarp import CylinderGeometry, PerspectiveGeometry, UnwarpMap, make_unwarp_map
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

Image = npt.NDArray[np.uint8]
_ROBOT = "Seer"


@dataclass(frozen=True, slots=True)
class CameraCase:
    """A camera of a robot."""

    write_robot: Callable[[Path], Path]
    class_name: str = "USARBot.OmniP2AT"
    camera: str = CAMERA


_FISHEYE = "USARBot.FisheyeP2AT"
CAMERA_CASES = {
    "hyperbolic": CameraCase(write_plain_robot),
    "parabolic": CameraCase(write_parabolic_robot),
    "ball": CameraCase(write_sphere_robot, "USARBot.SphereP2AT"),
    "cone": CameraCase(write_cone_robot, "USARBot.SphereP2AT"),
    "hanging fish-eye": CameraCase(write_fisheye_robot, _FISHEYE, "OmniCam"),
    "fish-eye ahead": CameraCase(write_fisheye_robot, _FISHEYE, "FrontCam"),
    "decentred fish-eye": CameraCase(write_decentred_robot, _FISHEYE, "OmniCam"),
    "tilted fish-eye": CameraCase(write_tilted_robot, _FISHEYE, "FrontCam"),
}
# A frame as PNG and a view of that same frame: the JPEG that the page draws does not count, and no
# newer frame comes between.
_READ_VIEW = """async (kind, view) => {
  const { context } = catoptra;
  const { robot, camera } = context.selected;
  const request = { robot, camera, encoding: "png", ...context.variantRequest };
  const { header, bytes } = await context.pictures.requestFrame(request);
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }), options);
  const { chooseCylinder } = await import("/static/camera_table.js");
  const { robotFromMirror } = await import("/static/transforms.js");
  const robot_from_mirror = robotFromMirror(header);
  const geometry = kind === "panorama"
    ? chooseCylinder(context.table, view.columns, robot_from_mirror)
    : { ...view, robot_from_mirror };
  const pixels = await context.unwarper.read(geometry, bitmap);
  const base64 = (data) => new Promise((resolve) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result.split(",")[1]);
    reader.readAsDataURL(new Blob([data]));
  });
  const [width, height] = [view.columns ?? view.width_px, geometry.rows ?? view.height_px];
  const picture = header.camera_model.Picture;
  const parts = { png: await base64(bytes), pixels: await base64(pixels) };
  return { ...parts, width, height, geometry, picture };
}"""


# Directions in which the page marks points of the world, in the axes of the robot.
_MARK_POINTS = """async (points) => {
  const { context } = catoptra;
  const { directionFromWorld } = await import("/static/views/directions.js");
  return points.map((point) => directionFromWorld(context, point));
}"""


# Pixels of the landmarks by the server, and where the page marks them.
_MARK_LANDMARKS = """async () => {
  const { context } = catoptra;
  const views = await import("/static/views/directions.js");
  const pixelOf = ({ direction }) => views.pixelFromDirection(context, direction);
  const pixels = new Map(context.landmarks.map(({ name, pixel }) => [name, pixel]));
  const marks = views.landmarkDirections(context);
  return marks.map((mark) => [pixels.get(mark.name), pixelOf(mark)]);
}"""


@dataclass(frozen=True, slots=True)
class CameraPage:
    """A page that shows a camera."""

    case: CameraCase
    live: LiveServer
    tab: Tab

    def read_view(self, kind: str, **view: object) -> tuple[Image, Image, dict[str, Any]]:
        """Frame and view (h, w, 3) RGB, and the reply of the page."""
        reply = self.tab.invoke(_READ_VIEW, kind, view, limit_s=30.0)
        frame = _decode(base64.b64decode(reply["png"]))
        pixels = np.frombuffer(base64.b64decode(reply["pixels"]), np.uint8)
        image = pixels.reshape(reply["height"], reply["width"], 4)[..., :3]
        return frame, image, reply

    def read_frame(self) -> Image:
        """Frame (h, w, 3) RGB of the stream, in the camera's own hand."""
        return _decode(self.live.probe.get_png(_ROBOT, self.case.camera)[1])

    def read_camera(self) -> tuple[OmniCamera, Floats]:
        """Model of the camera and its (3, 3) rotation on the robot, by a header of the stream."""
        header, _ = self.live.probe.get_png(_ROBOT, self.case.camera)
        assert header.camera_model is not None
        assert header.robot_from_mirror is not None
        camera, _ = omni_camera_from_pairs(tuple(header.camera_model.items()))
        return camera, np.reshape(header.robot_from_mirror.rotation, (3, 3))

    def make_map(self, geometry: CylinderGeometry | PerspectiveGeometry) -> UnwarpMap:
        """Map of the client."""
        camera, rotation = self.read_camera()
        return make_unwarp_map(camera, geometry, robot_from_mirror=rotation)

    def mark_landmarks(self) -> list[tuple[list[float], list[float]]]:
        """Pixel of each landmark by the server, and that of the page's mark."""
        self.tab.wait_for("catoptra.context.landmarks.some((l) => l.pixel)", "landmarks", 5.0)
        return [(pixel, marked) for pixel, marked in self.tab.invoke(_MARK_LANDMARKS)]

    def mark_points(self, points: Floats) -> Floats:
        """(n, 3) directions in which the page marks points of the world."""
        return np.array(self.tab.invoke(_MARK_POINTS, points.tolist()))


def _decode(png: bytes) -> Image:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


@contextmanager
def open_camera_page(
    browser: Browser, name: str, folder: Path, *, world: Path, x_m: float, y_m: float
) -> Iterator[CameraPage]:
    """Page of a camera of a robot at a place."""
    case = CAMERA_CASES[name]
    with (
        start_live_server(folder, case.write_robot(folder), world=world) as live,
        connect_probe(live.server.stream_port) as owner,
    ):
        owner.spawn(_ROBOT, x_m, y_m, case.class_name)
        with open_tab(browser, live.url, new_window=True) as tab:
            tab.wait_for("window.catoptra?.context.selected.robot", "robot", 15.0)
            tab.evaluate(f"catoptra.context.select('{_ROBOT}', '{case.camera}')")
            shown = f"catoptra.context.frame?.header.camera === '{case.camera}'"
            ready = "catoptra.context.table && catoptra.context.unwarper.isReady"
            tab.wait_for(f"{shown} && {ready}", "picture", 15.0)
            yield CameraPage(case, live, tab)
