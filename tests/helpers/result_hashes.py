"""Hashes of results of shipped worlds: pictures, labels, readings, reports and headers.

    PYTHONPATH=tests python -m helpers.result_hashes

`tests/end_to_end/test_same_bytes.py` compares the lines of processes whose libraries take other
code, `tests/packaging/arm.py` those of an emulated ARM processor. It needs the packages of a trace
server without transports.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from catoptra_protocol.usarsim.commands import Drive, Init
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.config.startup import create_ray_caster, read_startup_config
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import SampleDescriber, encode_sample
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import CameraChannel, FrameRequest
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.render_thread import render_frame
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.simulation.fleet import Fleet
from helpers.configs import REPOSITORY
from helpers.robots import FakeClient

_CONFIGS = REPOSITORY / "configs"
_MODELS = ("paper", "parabolic", "spherical", "conical", "equiangular", "equidistant_220")
_MODELS += ("kaidan_360", "lafida", "tum_vi_double_sphere", "woodscape_front", "theta_back")
_EFFECTS = ("Shadows", "Fog", "MotionBlur", "DefocusByDepth", "ChromaticAberration", "Vignetting")
_EFFECTS += ("Diffraction", "Blooming", "FixedPattern", "ShotNoise", "ReadNoise", "Bayer")
_RECIPE = """[Catoptra.Dataset]
Samples={samples}
Seed=3
Worlds={world}
{cameras}
Poses=random
Channels=range,normal,point,ids,classes,agreement,valid
Formats=coco
[Catoptra.RandomPoses]
Speed=(Min=0.2,Max=0.7)
YawRate=(Min=-1,Max=1)
[Catoptra.Effects]
FogDensity=0.05
{effects}
"""


def hash_results() -> Iterator[tuple[str, str]]:
    """Name and hash of each result."""
    for world, robot, models, effects in (
        ("four_legged_2006", "p2at_omni", _MODELS, ()),
        ("corridor", "p2at_omni_real", ("paper",), _EFFECTS),
        ("rescue", "p2at_omni", ("paper", "equidistant_220"), ("Shadows",)),
        ("warehouse", "p2at_omni_real", ("paper", "parabolic"), ("Shadows", "MotionBlur")),
    ):
        yield from _hash_samples(world, robot, models, effects)
    yield from _hash_drive("four_legged_2006", "p2at_omni_real", "OmniP2AT")
    yield from _hash_drive("corridor", "p2dx", "P2DX")


def _hash_samples(
    world: str, robot: str, models: tuple[str, ...], effects: tuple[str, ...]
) -> Iterator[tuple[str, str]]:
    """Hash the files of a sample for each camera model, with some effects drawn everywhere."""
    cameras = [f'Cameras=(Robot="{robot}",Model="{name}",Width=96,Height=96)' for name in models]
    text = _RECIPE.format(
        samples=len(models),
        world=world,
        cameras="\n".join(cameras),
        effects="\n".join(f"{name}=always" for name in effects),
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recipe.ini"
        path.write_text(text, encoding="utf-8")
        stage = DatasetStage(read_recipe(path))
    yield f"{world} digest", _hash(stage.digest.encode())
    describer, renderer = SampleDescriber(stage), SampleRenderer(stage)
    for index, name in enumerate(models):
        sample = renderer.render_sample(describer.describe_sample(index))
        for suffix, content in encode_sample(sample).items():
            yield f"{world} {robot} {name} {suffix}", _hash(content)
    renderer.close()


def _hash_drive(world: str, robot: str, class_name: str) -> Iterator[tuple[str, str]]:
    """Hash the reports of a robot on its way, and the frames and headers of its cameras."""
    startup = read_startup_config(
        [_CONFIGS / "robots" / f"{robot}.ini"], _CONFIGS / "worlds" / f"{world}.ini"
    )
    caster = create_ray_caster(startup)
    fleet = Fleet(startup.robots, startup.world, startup.scene, seed=5, ray_caster=caster)
    choice = choose_renderer("trace", startup.scene, startup.world)
    views = ViewCache(
        RenderPlanner(RendererPool(choice)), SceneSummarizer(startup.scene, startup.world)
    )
    client = FakeClient()
    fleet.execute(client, Init(class_name, name="R", location_m=(0.3, 0.2, 0.0)), 0.0)
    fleet.execute(client, Drive(3.0, 1.0), 0.0)
    time_s = 0.0
    for tick in range(40):
        time_s += 0.05
        fleet.step(0.05, time_s)
        fleet.deliver_due_reports(time_s)
        if tick % 20 == 19:
            lines = b"".join(line_from_report(report) for report in client.reports)
            yield f"{world} {robot} reports {tick}", _hash(lines)
            yield from _hash_frames(f"{world} {robot} {tick}", fleet, views, time_s)
    views.close()


def _hash_frames(
    label: str, fleet: Fleet, views: ViewCache, time_s: float
) -> Iterator[tuple[str, str]]:
    robot = fleet.cameras.find_robot("R")
    assert robot is not None
    for camera in robot.all_cameras:
        composition = fleet.cameras.compose_frame(CameraChannel("R", camera.name))
        assert composition is not None
        request = FrameRequest(CameraChannel("R", camera.name), 1, time_s, time_s, composition)
        frame = render_frame(request, views, monotonic=lambda: 0.0)
        yield f"{label} {camera.name} picture", _hash(np.ascontiguousarray(frame.rgb).tobytes())
        header = (frame.plan, frame.error_bounds, frame.effect_decisions, frame.metadata)
        yield f"{label} {camera.name} header", _hash(repr(header).encode())


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def main() -> None:
    """Print the lines; without a cache of baked occlusion, which another process may have baked."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for name, digest in hash_results():
            print(f"{name}: {digest}", flush=True)


if __name__ == "__main__":
    main()
