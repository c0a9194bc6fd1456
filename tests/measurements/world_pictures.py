"""Structure, entropy and range of greys in perspective pictures of the furnished worlds.

Run: .venv/bin/python tests/measurements/world_pictures.py [WORLD ...]

Twenty random free poses of the P2AT for each world, a perspective camera 0.6 m high, 640 x 480 and
320 x 240 px, with shadows and gloss, without noise. Medians over the poses: blocks of 8 x 8 px
whose grey deviates by less than 0.6 levels, entropy of the grey levels in bit, share of greys below
5 and above 250. Aims: at most 15 %, at least 6.3, at most 10 %.

With --sheet out/worlds.png: a sheet of all worlds from fixed poses, the plain worlds left; the same
bytes at each run. With --pairs out/pairs: for judges who shall not know which is which, three
random free poses of each world, plain and dressed beside each other in random order, and the key in
a file of its own.

With --landmarks: landmarks found in the laboratory by p2at_omni_lab, and in the field by p2at_omni:
of 26 random poses after a training on 30, bearings within 5 degrees. 96.2 %, 6 false; in the field,
with 360 px, 75.6 %, 7 false. Aims: 85 %; at most 2 more false ones than in the field.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))

from catoptra_client.landmarks import Viewpoint, detect, make_detector, train
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import start_server
from catoptra_client.training_frames import capture_training_frames
from catoptra_protocol.landmarks import read_landmarks
from catoptra_protocol.optics.numerics import angle_difference
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from helpers.configs import WORLDS
from helpers.world_pictures import (
    PLACES,
    Picture,
    find_free_poses,
    load_world,
    measure_structure,
    render_perspective,
)

NUM_POSES, NUM_LANDMARK_POSES = 20, 26
FIELD_CSV = "four_legged_2006.csv"
# Poses (x, y, height, yaw and pitch in degrees), the same in a plain world and its dressed one.
SHEET = {
    ("four_legged_2006", "laboratory"): ((-4, 2.9, 1.4, -38, 5), (2.6, 1.4, 0.6, -150, 0)),
    ("corridors_and_rooms", "offices"): ((-9.2, -3, 0.9, 0, 0), (8.9, -5.2, 1.1, -140, 5)),
    ("arena", "rescue_site"): ((-2.6, 0.6, 1.3, 20, 8), (2.4, 2.2, 0.6, -150, 0)),
    ("warehouse", "warehouse_stocked"): ((-7.2, 0.4, 1.4, -4, 4), (6.6, 3, 0.9, -160, 0)),
    ("meadow", "yard"): ((0, 0, 0.6, 0, -4), (-9.8, -2.6, 1.6, 12, 5)),
}


def main(worlds: list[str]) -> None:
    """Print a row for each world and size."""
    print(f"{'world':20} {'px':>5} {'flat %':>7} {'bit':>5} {'ends %':>7}")
    for name in worlds or list(PLACES):
        world = load_world(name)
        poses = find_free_poses(world, name, NUM_POSES)
        for width, height in ((640, 480), (320, 240)):
            camera = PerspectiveCamera(width, height, math.radians(75.0))
            pictures = render_perspective(world, camera, poses)
            flat, bits, ends = np.median([measure_structure(one) for one in pictures], axis=0)
            print(
                f"{name:20} {width:5d} {100 * flat:7.1f} {bits:5.2f} {100 * ends:7.1f}", flush=True
            )


def draw_pair(
    pair: tuple[str, str], poses: Sequence[Pose], size: tuple[int, int]
) -> list[list[Picture]]:
    """Pictures of a plain world and of its dressed one from the same poses."""
    camera = PerspectiveCamera(*size, math.radians(75.0))
    return [render_perspective(load_world(name), camera, poses) for name in pair]


def draw_sheet(path: str) -> None:
    """Write the pictures of all worlds, a row each."""
    rows = []
    for pair, places in SHEET.items():
        poses = [
            Pose.from_rpy((x, y, -z), (0.0, math.radians(-pitch), math.radians(yaw)))
            for x, y, z, yaw, pitch in places
        ]
        plain, dressed = draw_pair(pair, poses, (480, 300))
        rows.append(np.concatenate([*plain, *dressed], axis=1))
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).save(path)


def draw_pairs(folder: Path) -> None:
    """Write numbered pairs for a blind comparison, and key.txt: which side is dressed."""
    pairs = []
    for pair in SHEET:
        poses = find_free_poses(load_world(pair[1]), pair[1], 3)
        pairs += zip(*draw_pair(pair, poses, (640, 480)), strict=True)
    random, key = np.random.default_rng(43), []
    folder.mkdir(parents=True, exist_ok=True)
    gap = np.full((480, 16, 3), 255, dtype=np.uint8)
    for number, place in enumerate(random.permutation(len(pairs)).tolist()):
        plain, dressed = pairs[place]
        is_left = bool(random.integers(2))
        sides = (dressed, gap, plain) if is_left else (plain, gap, dressed)
        Image.fromarray(np.concatenate(sides, axis=1)).save(folder / f"{number:02}.png")
        key.append(f"{number:02} {'left' if is_left else 'right'}\n")
    (folder / "key.txt").write_text("".join(key), encoding="utf-8")


def count_landmarks(world: str, robot: str) -> None:
    """Print how many landmarks are found in a world of the field, and how many false ones."""
    landmarks = {one.name: one for one in read_landmarks(WORLDS / "../landmarks" / FIELD_CSV)}
    ports = ("--control-port", "0", "--image-port", "0")
    with (
        tempfile.TemporaryDirectory() as folder,
        start_server(
            ("--robot", robot, "--world", world, *ports), log_file=Path(folder) / "log"
        ) as address,
    ):
        capture = partial(
            capture_training_frames,
            address,
            landmarks=tuple(landmarks.values()),
            on_frame=lambda: None,
        )
        classifier = train(capture(num_frames=30, seed=1))
        with RobotClient.connect(address.host, address.control_port) as client:
            client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
            camera, height_m = client.get_camera_and_height()
        detector = make_detector(
            camera,
            classifier,
            landmarks=tuple(landmarks.values()),
            viewpoint=Viewpoint(height_m),
        )
        # The poses of the frames, drawn once more.
        random = np.random.Generator(np.random.Philox(key=2))
        num_found = num_false = 0
        for frame, _ in capture(num_frames=NUM_LANDMARK_POSES, seed=2):
            x, y, yaw = (random.uniform(-one, one) for one in (2.0, 1.3, math.pi))
            right = set()
            for seen in detect(detector, frame):
                one = landmarks[seen.name]
                bearing = math.atan2(one.y_m - y, one.x_m - x) - yaw
                is_right = abs(angle_difference(seen.bearing_rad, bearing)) < math.radians(5.0)
                right |= {seen.name} if is_right else set()
                num_false += not is_right
            num_found += len(right)
    share = num_found / (NUM_LANDMARK_POSES * len(landmarks))
    print(f"{world:20} {robot:16} {100 * share:5.1f} % found, {num_false} false", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--landmarks"]:
        count_landmarks("four_legged_2006", "p2at_omni")
        count_landmarks("laboratory", "p2at_omni_lab")
    elif sys.argv[1:2] == ["--sheet"]:
        draw_sheet(sys.argv[2])
    elif sys.argv[1:2] == ["--pairs"]:
        draw_pairs(Path(sys.argv[2]))
    else:
        main(sys.argv[1:])
