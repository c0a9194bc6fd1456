"""A client changes the accuracy target of a running server, and the next frame meets it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_server.commands.explain import main as explain
from helpers.configs import FIELD
from helpers.server_process import RunningServer, start_server, write_small_robot


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Server under lockstep, with a cost cache of its own."""
    folder = tmp_path_factory.mktemp("accuracy_target")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        with start_server(folder, "--clock", "lockstep") as running:
            yield running
            assert running.terminate() == 0
            assert "Traceback" not in running.log.read_text()
    assert len(list((folder / "cache/catoptra/costs").iterdir())) == 1


@pytest.fixture
def client(server: RunningServer) -> Iterator[StreamClient]:
    """A client with a robot."""
    with server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
        yield client
        client.reset()


@pytest.mark.parametrize("tolerance_px", [2.0, 0.5, 0.15])
def test_tolerance_when_set_is_met_by_the_next_frame(
    client: StreamClient, tolerance_px: float
) -> None:
    plan = client.set_accuracy(max_error_px=tolerance_px)
    assert plan.target_met
    assert f"the cheapest within {tolerance_px:g} px" in plan.plan
    assert plan.cost_ms is not None
    assert plan.faster is None or plan.faster.error_bound_px > tolerance_px
    frame = client.get_frame(encoding=ImageEncoding.RAW)
    assert plan.error_bound_px is not None
    assert frame.error_bounds is not None
    assert 0.0 < frame.error_bounds["scene_px"] < 0.01
    assert frame.error_bound_px <= tolerance_px
    assert (frame.error_bounds, frame.plan) == (plan.error_bounds, plan.plan)


def test_tolerance_when_no_plan_meets_it_is_reported(client: StreamClient) -> None:
    plan = client.set_accuracy(max_error_px=0.001)
    assert not plan.target_met
    assert "0.001 px is not met: edge 0.0884 of 0.0" in plan.plan


def test_budget_when_negative_is_rejected(client: StreamClient) -> None:
    with pytest.raises(CatoptraError, match="budget_ms must be 0"):
        client.set_accuracy(budget_ms=-1.0)


def test_plan_when_the_target_is_removed_is_that_of_the_file(client: StreamClient) -> None:
    before = client.set_accuracy()
    assert (before.cost_ms, before.max_error_px) == (None, 0.0)
    assert client.set_accuracy(max_error_px=2.0).plan != before.plan
    assert client.set_accuracy(max_error_px=0.0).plan == before.plan


# A rectangle of 20 km, and a disc 3 cm above the effective viewpoint.
LARGE_WORLD = """[Catoptra.World]
Name=Plain
PlayerStarts=(Tag="Middle",Location=(X=0,Y=0,Z=0),Rotation=(X=0,Y=0,Z=0))
PlayerStarts=(Tag="Far",Location=(X=9000,Y=9000,Z=0),Rotation=(X=0,Y=0,Z=0))
Rectangles=(Name="Ground",Position=(X=0,Y=0,Z=0),Size=(X=20000,Y=20000),Colour=(R=90,G=90,B=90))
Rings=(Name="Lid",Position=(X=9000,Y=9000,Z=-0.63),InnerRadius=0,OuterRadius=0.05,Colour=(R=9,G=9,B=9))
"""
BOUND_IN_LOG = re.compile(
    r"error bound of 64 x 64 px: outlines are displaced by at most ([.\d]+) px"
)


@pytest.mark.parametrize("name", ["field", "large"])
def test_plan_frame_log_and_explain_state_one_bound(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    robot, world = write_small_robot(tmp_path), FIELD
    if name == "large":
        world = tmp_path / "large.ini"
        world.write_text(LARGE_WORLD)
    with (
        start_server(tmp_path, "--clock", "lockstep", robot=robot, world=world) as server,
        server.connect_stream() as client,
    ):
        starts = client.get_start_poses()
        plans, frames = [], []
        for start in (starts[0], starts[-1]):
            client.spawn("USARBot.OmniP2AT", location_m=start.location_m)
            for tolerance_px in (0.0, 0.3, 0.1, 1e-3):
                plans.append(client.set_accuracy(max_error_px=tolerance_px))
                frames.append(client.get_frame(encoding=ImageEncoding.RAW))
            client.reset()
    for plan, frame in zip(plans, frames, strict=True):
        assert (plan.error_bounds, plan.error_bound_px) == (
            frame.error_bounds,
            frame.error_bound_px,
        )
        assert plan.plan == frame.plan
        target_px, bound_px = plan.max_error_px, plan.error_bound_px
        assert bound_px == frame.error_bounds["outline_px"]
        assert plan.target_met is (target_px == 0.0 or bound_px <= target_px)
        excess = f"{target_px:g} px is not met: "
        assert (excess in plan.plan) is not plan.target_met
        if not plan.target_met:
            assert f" of {bound_px:.3g} px (" in plan.plan
            assert f"accuracy target of 64 x 64 px: {excess}" in server.log.read_text()
    # A bound is logged with the first frame of each plan; here each target had one at the start.
    logged = BOUND_IN_LOG.findall(server.log.read_text())
    assert set(logged) == {f"{frame.error_bound_px:.3g}" for frame in frames[:4]}
    capsys.readouterr()
    arguments = ["--robot", str(robot), "--world", str(world), "--renderer", "trace"]
    assert explain([*arguments, "--json"]) == 0
    (report,) = json.loads(capsys.readouterr().out)
    assert report["error_bounds"] == frames[0].error_bounds
    assert explain(arguments) == 0
    assert f" outline_px {frames[0].error_bound_px:.3g}, " in capsys.readouterr().out
