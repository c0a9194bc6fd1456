"""All that the page reads by GET: files, and descriptions of the server as JSON.

Addresses are looked up in tables: a request never names a file. Descriptions that take time are
made at the first request, in a thread, and kept: robots with cameras and sensors, a plan of the
world for robots of each size, and a table for each omnidirectional camera. However many clients
ask, one plan is drawn at a time, and each once.

**No formula of a camera in JavaScript.** A table has 4096 image radii by incidence angle, within
1e-4 px of the model for all shipped cameras, and a new mirror needs no line in the page. A
direction with incidence angle theta and azimuth phi, (x, y) = (cos phi, sin phi), has the pixel

    centre + r(theta) * [[a, b], [c, d]] @ [x, y] + q(theta) * [[e, f, g], [h, i, j]] @ [xx, xy, yy]

r and q are interpolated between table entries. The second term is the tangential distortion of a
decentred lens, of second order in the azimuth; other cameras have none. For a mirror without a
single viewpoint theta is the angle of things far away, and the ray begins on the mirror's surface.
"""

from __future__ import annotations

import asyncio
import base64
import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from catoptra_protocol.optics.elementary import arctan, tan
from catoptra_protocol.optics.image_plane import DistortedProjection
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_server.frames.frame import encode_image
from catoptra_server.frames.plan.camera import POLYGON_COUNTS
from catoptra_server.render.renderer import has_mesh_viewpoint
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.serve.stream.replies import ServerInfo, landmarks_reply
from catoptra_server.simulation.floor_plan import FREE, OBSTACLE, draw_floor_plan, measure_robot
from catoptra_server.simulation.robot_description import RobotDescription, SensorDescription
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.simulation.sensors.sonar import SonarDescription
from catoptra_server.world.scene_mesh import SceneMesh

_STATIC_FOLDER = Path(__file__).with_name("static")
_INDEX = "index.html"
# Browsers run no script of another type, since the type is not to be guessed (nosniff).
_CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".txt": "text/plain; charset=utf-8",
}
_JSON = "application/json; charset=utf-8"
_CAMERA_TABLE = "/api/camera_table.json"
_FLOOR_PLAN = "/api/floor_plan.json"
# Interpolated linearly, 4096 entries miss 3e-5 px at 640 px and a rim of 120 degrees.
_NUM_ENTRIES = 4096
_DIAGONAL = math.sqrt(0.5)
# Longer side of a plan. A picture of noise would have 3 MB.
_PLAN_PX = 1000
_JsonObject = dict[str, object]
# Path and, for a camera, class and name.
_Key = tuple[str, ...]


class WebPages:
    """Resources by address; those that take time are made at the first request, in a thread."""

    def __init__(
        self, files: Mapping[str, WebResource], server_info: ServerInfo, scene: SceneMesh
    ) -> None:
        """Begin without descriptions.

        Args:
            files: The files of the page, by path of the address.
            server_info: The server, with robots and cameras.
            scene: Triangles of the world.
        """
        self._files = files
        self._makers: dict[_Key, Callable[[], object]] = {
            ("/api/server.json",): lambda: describe_server(server_info),
        }
        plans: dict[tuple[float, float], Callable[[], object]] = {}
        for robot in server_info.robots:
            size = measure_robot(robot)
            make_plan = partial(floor_plan, scene, server_info, *size)
            self._makers[_FLOOR_PLAN, robot.class_name] = plans.setdefault(size, make_plan)
            for omni in robot.omni_cameras:
                key = (_CAMERA_TABLE, robot.class_name, omni.name)
                self._makers[key] = _table_maker(omni.camera)
        self._plan_turn = asyncio.Lock()
        self._resources: dict[Callable[[], object], asyncio.Task[WebResource]] = {}

    def close(self) -> None:
        """Wait for nothing more."""
        for task in self._resources.values():
            task.cancel()

    async def find(self, path: str, query: Mapping[str, str]) -> WebResource | None:
        """Resource at an address; None if there is none."""
        if path in self._files:
            return self._files[path]
        key: _Key = (path,)
        if path == _CAMERA_TABLE:
            key = path, query.get("class", ""), query.get("camera", "")
        elif path == _FLOOR_PLAN:
            key = path, query.get("class", "")
        if (make := self._makers.get(key)) is None:
            return None
        task = self._resources.get(make)
        if task is None or (task.done() and (task.cancelled() or task.exception())):
            turn = self._plan_turn if path == _FLOOR_PLAN else nullcontext()
            task = asyncio.create_task(_make_resource(make, turn))
            self._resources[make] = task
        # Shielded: other requests wait for the same one.
        return await asyncio.shield(task)


def _table_maker(camera: OmniCamera) -> Callable[[], object]:
    return lambda: camera_table(camera)


async def _make_resource(
    make: Callable[[], object], turn: AbstractAsyncContextManager[None]
) -> WebResource:
    async with turn:
        return await asyncio.to_thread(
            lambda: WebResource.from_body(_JSON, json.dumps(make(), allow_nan=False).encode())
        )


@dataclass(frozen=True, slots=True)
class WebResource:
    """What a GET request reads."""

    content_type: str
    body: bytes
    etag: str
    """Changes with the body: browsers ask again, and get a changed body only."""

    @classmethod
    def from_body(cls, content_type: str, body: bytes) -> WebResource:
        """Resource with the tag of the body."""
        return cls(content_type, body, f'"{hashlib.sha256(body).hexdigest()[:32]}"')


def read_page_files(folder: Path = _STATIC_FOLDER) -> dict[str, WebResource]:
    """Files by the path of their address: `/` for the page itself, others under `/static/`."""
    resources: dict[str, WebResource] = {}
    for file in sorted(folder.rglob("*")):
        content_type = _CONTENT_TYPES.get(file.suffix)
        if content_type is not None and file.is_file():
            resource = WebResource.from_body(content_type, file.read_bytes())
            resources[f"/static/{file.relative_to(folder).as_posix()}"] = resource
    index = resources.pop(f"/static/{_INDEX}", None)
    return resources if index is None else {"/": index, **resources}


def describe_server(info: ServerInfo) -> _JsonObject:
    """Description as a JSON object; lengths in metres, angles in radians."""
    landmarks = landmarks_reply(0, info.landmarks).landmarks
    return {
        "server": info.server,
        "world": info.world,
        "clock": info.clock,
        "classes": [_describe_class(robot) for robot in info.robots],
        "start_poses": [dataclasses.asdict(start) for start in info.start_poses],
        "landmarks": [dataclasses.asdict(landmark) for landmark in landmarks],
        "polygons": POLYGON_COUNTS,
        "renderers": [kind.value for kind in RendererKind],
    }


def _describe_class(robot: RobotDescription) -> _JsonObject:
    drive = robot.drive
    return {
        "class_name": robot.class_name,
        "size_m": drive.collision_size_m,
        "max_speed_rad_s": drive.max_speed_rad_s,
        "wheel_radius_m": drive.wheel_radius_m,
        "wheel_separation_m": drive.wheel_separation_m,
        "cameras": _describe_cameras(robot),
        "sensors": [
            description
            for sensor in robot.sensors
            if (description := _describe_sensor(robot, sensor)) is not None
        ],
    }


def _describe_cameras(robot: RobotDescription) -> list[_JsonObject]:
    cameras: list[_JsonObject] = []
    for omni in robot.omni_cameras:
        cameras.append(
            {
                "name": omni.name,
                "kind": "omni",
                "has_mesh": has_mesh_viewpoint(omni.camera),
                "width_px": omni.camera.width_px,
                "height_px": omni.camera.height_px,
                "effects": [setting.effect.name for setting in omni.effects.settings],
            }
        )
    for camera in robot.perspective_cameras:
        cameras.append(
            {
                "name": camera.name,
                "kind": "perspective",
                "width_px": camera.width_px,
                "height_px": camera.height_px,
                "effects": [],
            }
        )
    return cameras


def _describe_sensor(robot: RobotDescription, sensor: SensorDescription) -> _JsonObject | None:
    """Place and reach of a sensor that measures ranges, with all joints at 0; None for others."""
    match sensor:
        case RangeScannerDescription():
            kind, fov_rad, max_range_m = "RangeScanner", sensor.fov_rad, sensor.max_range_m
        case SonarDescription():
            kind, fov_rad, max_range_m = "Sonar", sensor.beam_rad, sensor.max_range_m
        case _:
            return None
    mount = sensor.mount
    pose = robot.robot_from_part(mount.parent, {}) @ mount.parent_from_item()
    return {
        "type": kind,
        "name": sensor.name,
        "x_m": float(pose.translation[0]),
        "y_m": float(pose.translation[1]),
        "yaw_rad": pose.to_rpy()[2],
        "fov_rad": fov_rad,
        "max_range_m": max_range_m,
    }


def camera_table(camera: OmniCamera) -> dict[str, object]:
    """Table of a camera as a JSON object; pixels and radians."""
    # A cone shows nothing nearer to the axis than the apex.
    lowest_t = camera.projection.t_min
    theta_rad = np.linspace(0.0, camera.rim_rad, _NUM_ENTRIES)
    t = np.maximum(tan(0.5 * theta_rad), lowest_t)
    # The matrices are read from the model itself, hand and stretch included, at one angle.
    middle_t = tan(0.25 * (2.0 * arctan(lowest_t) + camera.rim_rad))
    odd, even = _offsets(camera, middle_t)
    azimuth_matrix = odd[:2].T / float(camera.radius_px_from_t(np.array(middle_t)))
    return {
        "kind": "radial",
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "centre_px": camera.centre_px,
        "picture": camera.picture.value,
        "min_theta_rad": 2.0 * arctan(lowest_t),
        "max_theta_rad": camera.rim_rad,
        "azimuth_matrix": azimuth_matrix.ravel().tolist(),
        "radius_px": camera.radius_px_from_t(t).tolist(),
        **_decentring(camera, t, middle_t, even),
        **_surface(camera, t),
    }


def _offsets(camera: OmniCamera, t: float) -> tuple[Floats, Floats]:
    """Offsets (3, 2) from the centre along x, y and their diagonal: odd and even in the azimuth."""
    sine, cosine = 2.0 * t / (1.0 + t * t), (1.0 - t * t) / (1.0 + t * t)
    level = sine * np.array([(1.0, 0.0), (0.0, 1.0), (_DIAGONAL, _DIAGONAL)])
    directions = [np.column_stack((sign * level, np.full(3, cosine))) for sign in (1.0, -1.0)]
    pixels, _ = pixel_from_direction(camera, np.array(directions))
    ahead, behind = pixels - camera.centre_px
    return 0.5 * (ahead - behind), 0.5 * (ahead + behind)


def _decentring(camera: OmniCamera, t: Floats, middle_t: float, even: Floats) -> dict[str, object]:
    """The term of a decentred lens; nothing for others."""
    if not camera.plane.is_decentred:
        return {}
    projection = cast(DistortedProjection, camera.projection)

    def squared_px(t: Floats) -> Floats:
        return camera.scale_px * np.square(projection.undistorted_ratio_from_t(t))

    along_x, along_y, diagonal = even / float(squared_px(np.array(middle_t)))
    matrix = np.column_stack((along_x, 2.0 * diagonal - along_x - along_y, along_y))
    return {
        "decentring_matrix": matrix.ravel().tolist(),
        "decentring_px": squared_px(t).tolist(),
    }


def _surface(camera: OmniCamera, t: Floats) -> dict[str, object]:
    """Where the rays of a mirror without a single viewpoint begin; nothing for other cameras."""
    if camera.is_central:
        return {}
    r, z = camera.mirror.surface_point(np.minimum(t, camera.rim_t))
    return {"surface_r_m": r.tolist(), "surface_z_m": z.tolist()}


def floor_plan(
    scene: SceneMesh, info: ServerInfo, height_m: float, radius_m: float
) -> dict[str, object]:
    """Plan as a JSON object: a picture, columns along x, and its bounds, metres in the world frame.

    Args:
        scene: Triangles of the world.
        info: Server, whose landmarks and starts lie on the plan.
        height_m: Height of the robots.
        radius_m: Radius in which their base turns.
    """
    points = [start.location_m[:2] for start in info.start_poses]
    points += [(landmark.x_m, landmark.y_m) for landmark in info.landmarks]
    points_m = np.array(points or [(0.0, 0.0)])
    plan = draw_floor_plan(
        scene, height_m=height_m, points_m=points_m, size_px=_PLAN_PX, radius_m=radius_m
    )
    picture = encode_image(plan.colour(scene, radius_m), ImageEncoding.PNG)
    x, y = plan.origin_m
    height, width = plan.obstacles.shape
    return {
        "bounds": [x, y, x + width / plan.px_per_m, y + height / plan.px_per_m],
        "height_m": height_m,
        "radius_m": radius_m,
        "colours": {"free": FREE, "obstacle": OBSTACLE},
        "picture": base64.b64encode(picture).decode(),
    }
