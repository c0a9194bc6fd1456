"""Description of the server for the page: robots, cameras, sensors, start poses, landmarks."""

from __future__ import annotations

import dataclasses

from catoptra_server.frames.plan.camera import POLYGON_COUNTS
from catoptra_server.render.render_settings import has_mesh_viewpoint
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.simulation.robot_description import RobotDescription, SensorDescription
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.simulation.sensors.sonar import SonarDescription
from catoptra_server.transports.stream.landmark_replies import landmarks_reply
from catoptra_server.transports.stream.server_info import ServerInfo

Json = dict[str, object]


def describe_server(info: ServerInfo) -> Json:
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


def _describe_class(robot: RobotDescription) -> Json:
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


def _describe_cameras(robot: RobotDescription) -> list[Json]:
    cameras: list[Json] = []
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


def _describe_sensor(robot: RobotDescription, sensor: SensorDescription) -> Json | None:
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
