"""What channels of ground truth cost beside the picture, and that none cost nothing.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/labels.py

Prints median processor milliseconds of one thread for 640 x 640 px of the paper's mirror, a 220
degree fish-eye and a chrome ball on the field: the picture with 2 x 2 samples, then what channels
add to the picture, in turns, and what they take alone, as beside raster's pictures. Decision:
labels are found while the picture is drawn, ARCHITECTURE's chapter "Ground truth".
"""

from __future__ import annotations

import argparse
import math
from functools import partial

from interleaved import median_ms
from scenes import CAMERA_STATE, FIELD

from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, SphericalMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import NO_THRESHOLDS, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.trace_renderer import TraceView
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene

CAMERAS = {
    "paper's mirror": (PAPER_MIRROR, 120.0),
    "fish-eye": (EquidistantLens(), 110.0),
    "chrome ball": (SphericalMirror(0.03, 0.2, math.radians(120.0)), 120.0),
}
ALL = tuple(LABEL_CHANNELS)
CHANNELS = {
    "range": ("range",),
    "ids": ("ids",),
    "range, ids, classes, valid": ("range", "ids", "classes", "valid"),
    "normal": ("normal",),
    "point": ("point",),
    "agreement": ("agreement",),
    "flow": ("flow",),
    "all but flow": tuple(name for name in ALL if name != "flow"),
    "all": ALL,
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    world = read_world(FIELD)[0]
    scene = build_scene(world)
    renderer = TraceRenderer(scene, world, threads=1)
    labels = LabelRenderer(renderer, scene)
    moved = CAMERA_STATE.world_from_mirror @ Pose.from_rpy((0.1, 0.02, 0.0), (0.0, 0.0, 0.05))
    other = CameraState(moved)
    for title, (projection, rim_deg) in CAMERAS.items():
        camera = camera_with_inscribed_rim(
            projection, width_px=640, height_px=640, rim_rad=math.radians(rim_deg)
        )
        settings = RenderSettings(samples=2)
        plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="measured")
        view = renderer.prepare(camera, plan)
        drawn = LabelledImage(camera, CAMERA_STATE, samples=2)

        def draw_labelled(
            channels: tuple[str, ...], view: TraceView = view, drawn: LabelledImage = drawn
        ) -> None:
            request = labels.request(drawn, channels)
            found = view.render_with_labels(CAMERA_STATE, (), NO_THRESHOLDS, request)[1]
            labels.render(drawn, channels, other, found)

        draws = {"picture": partial(view.render, CAMERA_STATE)}
        for name, channels in CHANNELS.items():
            draws[f"{name} beside"] = partial(draw_labelled, channels)
            draws[f"{name} alone"] = partial(labels.render, drawn, channels, other)
        times = {name: row[1] for name, row in median_ms(draws, rounds=rounds).items()}
        picture = times["picture"]
        print(f"{title}: picture {picture:.1f} ms")
        for name in CHANNELS:
            added, alone = times[f"{name} beside"] - picture, times[f"{name} alone"]
            print(
                f"  {name:28} adds {added:5.1f} ms, {added / picture:4.0%} of the picture; "
                f"alone {alone:5.1f} ms, {alone / picture:4.0%}"
            )
        view.close()
    labels.close()
    renderer.close()


if __name__ == "__main__":
    main()
