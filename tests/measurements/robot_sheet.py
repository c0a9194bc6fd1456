"""Sheet of robots in boxes and in parts: from outside, and in their own mirror; what both cost.

Run: .venv/bin/python tests/measurements/robot_sheet.py docs/robots.png [--times]

Each column is a class: in the upper row with Body=plain, in the lower one as its file has it; the
last column is the own view of the live robot. The same bytes on every processor. With --times:
processor milliseconds of the live robot's frame, medians of frames drawn in turns, alone and with
others of its class, in the field.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects.sensor.response import Response
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.simulation.robot_bodies import build_ego_mesh, build_outer_meshes
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    World,
)

SIZE_PX = 320
# Flippers raised at the front and a little at the back.
ANGLES_RAD = {"frflipper": -0.7, "flflipper": -0.7, "rrflipper": 0.4, "rlflipper": 0.4}
SUN = np.array((-0.5, 0.55, 0.75)) / np.linalg.norm((-0.5, 0.55, 0.75))
FLOOR = Item(
    "floor", Rectangle((40.0, 40.0)), Pose.identity(), Material((0.36, 0.33, 0.29)),
)  # fmt: skip
STUDIO = World(
    "studio",
    (FLOOR,),
    lights=(
        HemisphereLight((0.42, 0.44, 0.48), (0.22, 0.21, 0.19)),
        DirectionalLight((float(SUN[0]), float(SUN[1]), float(SUN[2])), (0.72, 0.69, 0.62)),
    ),
    background=(0.55, 0.62, 0.70),
)


def place_robot(robot: RobotDescription, world_from_robot: Pose) -> tuple[DynamicObject, ...]:
    """Return a robot as others see it."""
    return tuple(
        DynamicObject(mesh, world_from_robot @ robot.robot_from_part(link, ANGLES_RAD))
        for link, mesh in build_outer_meshes(robot).items()
    )


def draw_outside(renderer: TraceRenderer, robot: RobotDescription, distance_m: float) -> np.ndarray:
    """Return a picture from the front and above."""
    azimuth, elevation = 0.62, 0.38
    objects = place_robot(robot, Pose.from_rpy((0.0, 0.0, -robot.drive.ride_height_m)))
    away = np.array((math.cos(azimuth), math.sin(azimuth), -math.tan(elevation)))
    middle = np.array((0.0, 0.0, -0.28 if robot.omni_cameras else -0.14))
    pose = Pose.from_rpy(middle + distance_m * away, (0.0, -elevation, azimuth + math.pi))
    view = renderer.prepare_perspective(PerspectiveCamera(SIZE_PX, SIZE_PX, 0.5), 4)
    state = CameraState(pose, objects, has_shadows=True)
    return np.asarray(view.render(state, (Response(0.4, 4.0),)).rgb)


def own_state(robot: RobotDescription, world_from_robot: Pose) -> CameraState:
    """Return the state of the robot's camera, which sees its own body."""
    omni, mesh = robot.omni_camera, build_ego_mesh(robot)
    assert omni is not None
    assert mesh is not None
    body = DynamicObject(mesh, world_from_robot)
    return CameraState(
        world_from_robot @ omni.robot_from_mirror, (body,), ego_body=body, has_shadows=True
    )


def draw_own(renderer: TraceRenderer, robot: RobotDescription) -> np.ndarray:
    """Return the middle of the robot's own picture, with another one ahead."""
    world_from_robot = Pose.from_rpy((0.0, 0.0, -robot.drive.ride_height_m))
    state, omni = own_state(robot, world_from_robot), robot.omni_camera
    assert omni is not None
    other = place_robot(robot, world_from_robot @ Pose.from_rpy((0.55, -0.55, 0.0), (0, 0, 2.2)))
    size = 3 * SIZE_PX
    scale = size / omni.camera.width_px
    camera = replace(
        omni.camera, width_px=size, height_px=size, centre_px=(0.5 * size, 0.5 * size),
        scale_px=scale * omni.camera.scale_px,
    )  # fmt: skip
    plan = plan_from_settings(
        RenderSettings(PerPixel(), 3), camera, kind=RendererKind.TRACE, reason="sheet"
    )
    state = replace(state, objects=(*other, *state.objects))
    rgb = renderer.prepare(camera, plan).render(state, (Response(0.4, 4.0),)).rgb
    return np.asarray(rgb[SIZE_PX:-SIZE_PX, SIZE_PX:-SIZE_PX])


def write_sheet(path: Path) -> None:
    """Write the sheet."""
    renderer = TraceRenderer(build_scene(STUDIO), STUDIO, threads=1)
    live = read_robot(find_configuration("robots", "p2at_omni_live"))[0]
    classes = [(live, 1.75)]
    for name, distance_m in (("p2dx", 1.15), ("kenaf", 1.5)):
        classes.append((read_robot(find_configuration("robots", name))[0], distance_m))
    rows = []
    for is_plain in (True, False):
        bodies = [
            (replace(robot, body="plain") if is_plain else robot, distance_m)
            for robot, distance_m in classes
        ]
        pictures = [draw_outside(renderer, *one) for one in bodies]
        rows.append(np.concatenate((*pictures, draw_own(renderer, bodies[0][0])), axis=1))
    # 256 colours: the sheet is flat but for round parts.
    image = Image.fromarray(np.concatenate(rows)).quantize(256, dither=Image.Dither.NONE)
    image.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size} bytes")


SCENES: tuple[tuple[str, float, tuple[float, ...]], ...] = (
    ("alone", 0.0, ()),
    ("another 2.5 m away", 2.5, (0.5,)),
    ("another 1.2 m away", 1.2, (0.5,)),
    ("three others 1.2 m away", 1.2, (0.0, 2.1, 4.2)),
)


def offset(distance_m: float, turn_rad: float) -> Pose:
    """Return a pose around a robot."""
    return Pose.from_rpy((distance_m * math.cos(turn_rad), distance_m * math.sin(turn_rad), 0.0))


def print_times(num_rounds: int = 41) -> None:
    """Print processor times of frames with plain bodies and bodies of parts."""
    field = find_configuration("worlds", "four_legged_2006")
    config = read_startup_config([find_configuration("robots", "p2at_omni_live")], field)
    robot = config.robots[0]
    renderer = TraceRenderer(config.scene, config.world, threads=1)
    omni = robot.omni_cameras[0]
    plan = plan_from_settings(
        RenderSettings(PerPixel(), 2), omni.camera, kind=RendererKind.TRACE, reason="times"
    )
    view = renderer.prepare(omni.camera, plan)
    place = Pose.from_rpy((0.5, 0.3, -robot.drive.ride_height_m), (0.0, 0.0, 0.3))
    states = {}
    for body in ("plain", "wheels"):
        described = replace(robot, body=body)
        alone = own_state(described, place)
        for scene, distance_m, turns in SCENES:
            others = tuple(
                one
                for turn in turns
                for one in place_robot(described, place @ offset(distance_m, turn))
            )
            states[body, scene] = replace(alone, objects=(*others, *alone.objects))
    times: dict[tuple[str, str], list[float]] = {key: [] for key in states}
    for _ in range(num_rounds):
        for key, state in states.items():
            begin_s = time.process_time()
            view.render(state)
            times[key].append(1e3 * (time.process_time() - begin_s))
    for scene, *_ in SCENES:
        plain, parts = (statistics.median(times[body, scene][1:]) for body in ("plain", "wheels"))
        print(f"{scene}: {plain:.2f} ms plain, {parts:.2f} of parts, {parts / plain - 1:+.1%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--times", action="store_true")
    arguments = parser.parse_args()
    write_sheet(arguments.path)
    if arguments.times:
        print_times()
