"""Hashes of frames: picture, decisions about effects and error bounds of every shipped camera.

A change of the code that should change no frame is run before and after:

    python tests/measurements/frame_hashes.py out/before.json
    python tests/measurements/frame_hashes.py out/after.json --before out/before.json

Each robot file with a camera drives through each world on a lockstep server of its own, by either
renderer; omnidirectional cameras have their effects on auto, always and never. Servers are reached
over the stream alone, so that the script survives any change inside. Exit status 1: something
differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.server_process import serve_stream
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.requests import FrameVariant, ImageEncoding

CONFIGS = Path(__file__).parents[2] / "configs"
RENDERERS = ("trace", "raster")
MODES = ("auto", "always", "never")
# Wheels at 2 and 3 rad/s for a quarter of a second: a motion that blur and rolling shutter notice.
WHEELS_RAD_S = (2.0, 3.0)
DRIVE_S = 0.26

Hashes = dict[str, dict[str, str]]


def hash_frame(frame: Frame) -> dict[str, str]:
    """Short hashes of a frame's parts, and what two equal frames have in common in words."""
    decisions = [
        (e.name, e.enabled, e.bound, e.threshold, e.reason, e.basis, e.change, e.displacement_px)
        for e in frame.effects
    ]
    return {
        "picture": _digest(str(frame.rgb.shape).encode() + frame.rgb.tobytes()),
        "decisions": _digest(json.dumps(decisions).encode()),
        "bounds": _digest(json.dumps(frame.error_bounds, sort_keys=True).encode()),
        "enabled": " ".join(e.name for e in frame.effects if e.enabled),
    }


def hash_frames(robot: str, world: str, renderer: str) -> Hashes:
    """Hashes of all cameras of a robot file's first class, after a short drive."""
    arguments = ("--renderer", renderer, "--threads", "1")
    key = f"{robot} {world} {renderer}"
    with serve_stream(
        Path(robot), Path(world), seed=1, timeout_s=120.0, extra_arguments=arguments
    ) as client:
        start = next((pose.name for pose in client.get_start_poses()), None)
        client.spawn(client.get_status().class_names[0], start_pose=start)
        client.drive(*WHEELS_RAD_S)
        client.step(DRIVE_S)
        return dict(_hash_cameras(client, key))


def _hash_cameras(client: StreamClient, key: str) -> Iterator[tuple[str, dict[str, str]]]:
    camera = client.get_camera()
    for mode in MODES if isinstance(camera, OmniCamera) else MODES[:1]:
        variant = None
        if mode != "auto":
            names = [one.name for one in _get_frame(client).effects]
            if not names:
                continue
            variant = FrameVariant(effects=dict.fromkeys(names, mode))
        yield f"{key} {mode}", hash_frame(_get_frame(client, variant))


def _get_frame(client: StreamClient, variant: FrameVariant | None = None) -> Frame:
    robot = client.get_state().robots[0].name
    return client.get_frame(encoding=ImageEncoding.RAW, robot=robot, variant=variant)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def compare(before: Hashes, after: Hashes) -> list[str]:
    """Lines of all differences."""
    lines = [f"{key}: only before" for key in before if key not in after]
    lines += [f"{key}: only after" for key in after if key not in before]
    for key in before.keys() & after.keys():
        parts = [part for part in before[key] if before[key][part] != after[key].get(part)]
        lines += [f"{key}: {', '.join(parts)}"] if parts else []
    return sorted(lines)


def main() -> int:
    """Run the script; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="JSON file to write")
    parser.add_argument("--before", type=Path, help="JSON file of an earlier run to compare with")
    parser.add_argument("--renderers", nargs="+", default=RENDERERS, choices=RENDERERS)
    parsed = parser.parse_args()
    robots, worlds = (
        sorted(path.stem for path in (CONFIGS / kind).glob("*.ini"))
        for kind in ("robots", "worlds")
    )
    cases = [*product(robots, worlds, parsed.renderers)]
    hashes: Hashes = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(lambda case: _try(*case), cases):
            hashes |= found
    parsed.out.parent.mkdir(parents=True, exist_ok=True)
    parsed.out.write_text(json.dumps(hashes, indent=1, sort_keys=True) + "\n")
    print(f"{len(hashes)} frames of {len(cases)} servers")
    if parsed.before is None:
        return 0
    differences = compare(json.loads(parsed.before.read_text()), hashes)
    print("\n".join(differences) or "no difference")
    return 1 if differences else 0


def _try(robot: str, world: str, renderer: str, *, tries: int = 3) -> Hashes:
    try:
        return hash_frames(robot, world, renderer)
    except Exception as error:
        # Of a loaded machine: software OpenGL compiles its programs for seconds.
        if "heartbeat" in str(error) and tries > 1:
            return _try(robot, world, renderer, tries=tries - 1)
        # Equal errors are equal behaviour: a robot without a camera, a renderer that refuses one.
        text = str(error).splitlines()[0]
        return {f"{robot} {world} {renderer}": {"error": re.sub(r"127\.0\.0\.1:\d+", "", text)}}


if __name__ == "__main__":
    sys.exit(main())
