"""Two robots in one world: the first one's picture shows the second, where it stands."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.usarsim.commands import Init
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.view_cache import ViewCache
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.render.render_plan import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.simulation import Fleet
from catoptra_server.startup import read_startup_config
from helpers.robots import FakeClient, render_channel

CONFIGS = Path(__file__).parents[2] / "configs"
STARTUP = read_startup_config(
    [CONFIGS / "robots" / "p2at_omni.ini"], CONFIGS / "worlds" / "four_legged_2006.ini"
)
(ROBOT,) = STARTUP.robots


@pytest.fixture
def fleet():
    """Yield a fleet of the field whose first robot stands in the middle, looking along x."""
    fleet = Fleet(STARTUP.robots, STARTUP.world, STARTUP.scene, seed=0)
    fleet.execute(FakeClient(), Init(ROBOT.class_name, "Seeing", (0.0, 0.0, 0.0)), 0.0)
    return fleet


@pytest.fixture(scope="module")
def view_cache():
    """Yield traced views of the field."""
    views = ViewCache(
        RenderPlanner(
            RendererChoice(TraceRenderer(STARTUP.scene, STARTUP.world), RendererKind.TRACE, "test")
        ),
        SceneSummarizer(STARTUP.scene, STARTUP.world),
    )
    yield views
    views.close()


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, -140.0])
def test_picture_when_another_robot_comes_shows_it_in_its_place(fleet, views, bearing_deg):
    before = render_channel(fleet, views).rgb.astype(int)
    bearing = math.radians(bearing_deg)
    place = (1.2 * math.cos(bearing), 1.2 * math.sin(bearing), 0.0)
    fleet.obey(FakeClient(), Init(ROBOT.class_name, "Seen", place), 0.0)
    changed = np.abs(render_channel(fleet, views).rgb.astype(int) - before).max(axis=-1) > 8
    assert ROBOT.omni_camera is not None
    # Its chassis, 1.2 m away and 0.45 m below the viewpoint.
    chassis, _ = pixel_from_direction(
        ROBOT.omni_camera.camera, np.array([math.cos(bearing), math.sin(bearing), 0.45 / 1.2])
    )
    u, v = chassis.astype(int)
    assert changed[v, u]
    assert 200 < changed.sum() < 5000
    rows, columns = np.nonzero(changed)
    # Half a metre at 1.2 m is seen under 24 degrees: some 45 px around the horizon.
    assert np.hypot(columns - chassis[0], rows - chassis[1]).max() < 60.0


def test_picture_when_the_other_robot_left_is_as_before(fleet, views):
    before = render_channel(fleet, views).rgb.copy()
    other = FakeClient()
    fleet.obey(other, Init(ROBOT.class_name, "Seen", (1.0, 0.0, 0.0)), 0.0)
    assert not np.array_equal(render_channel(fleet, views).rgb, before)
    fleet.remove(other)
    assert np.array_equal(render_channel(fleet, views).rgb, before)
