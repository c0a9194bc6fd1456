"""Two robots in one world: the camera of the first shows the second at its position."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.usarsim.commands import Init
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererChoice, RendererPool
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.simulation.fleet import Fleet
from helpers.robots import FakeClient, render_channel

CONFIGS = Path(__file__).parents[2] / "configs"
STARTUP = read_startup_config(
    [CONFIGS / "robots" / "p2at_omni.ini"], CONFIGS / "worlds" / "four_legged_2006.ini"
)
(ROBOT,) = STARTUP.robots


@pytest.fixture
def fleet():
    """A fleet of the field with one robot at the origin, heading along x."""
    fleet = Fleet(STARTUP.robots, STARTUP.world, STARTUP.scene, seed=0)
    fleet.execute(FakeClient(), Init(ROBOT.class_name, "Seeing", (0.0, 0.0, 0.0)), 0.0)
    return fleet


@pytest.fixture(scope="module")
def view_cache():
    """Traced views of the field."""
    views = ViewCache(
        RenderPlanner(
            RendererPool(
                RendererChoice(
                    TraceRenderer(STARTUP.scene, STARTUP.world), RendererKind.TRACE, "test"
                )
            )
        ),
        SceneSummarizer(STARTUP.scene, STARTUP.world),
    )
    yield views
    views.close()


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, -140.0])
def test_frame_when_another_robot_is_spawned_shows_the_robot(fleet, view_cache, bearing_deg):
    before = render_channel(fleet, view_cache).rgb.astype(int)
    bearing = math.radians(bearing_deg)
    location_m = (1.2 * math.cos(bearing), 1.2 * math.sin(bearing), 0.0)
    fleet.execute(FakeClient(), Init(ROBOT.class_name, "Seen", location_m), 0.0)
    changed = np.abs(render_channel(fleet, view_cache).rgb.astype(int) - before).max(axis=-1) > 8
    assert ROBOT.omni_camera is not None
    # The chassis of the other robot, 1.2 m away and 0.45 m below the viewpoint.
    chassis, _ = pixel_from_direction(
        ROBOT.omni_camera.camera, np.array([math.cos(bearing), math.sin(bearing), 0.45 / 1.2])
    )
    u, v = chassis.astype(int)
    assert changed[v, u]
    assert 200 < changed.sum() < 5000
    rows, columns = np.nonzero(changed)
    # Half a metre at 1.2 m subtends 24 degrees: some 45 px near the horizon.
    assert np.hypot(columns - chassis[0], rows - chassis[1]).max() < 60.0


def test_frame_when_the_other_robot_is_removed_is_as_before(fleet, view_cache):
    before = render_channel(fleet, view_cache).rgb.copy()
    other = FakeClient()
    fleet.execute(other, Init(ROBOT.class_name, "Seen", (1.0, 0.0, 0.0)), 0.0)
    assert not np.array_equal(render_channel(fleet, view_cache).rgb, before)
    fleet.remove(other)
    assert np.array_equal(render_channel(fleet, view_cache).rgb, before)
