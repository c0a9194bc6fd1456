"""A client changes the accuracy target of a running server, and the next frame meets it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.requests import ImageEncoding
from helpers.server_process import RunningServer, start_server


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
    scene_px = frame.error_bounds["scene_px"]
    assert 0.0 < scene_px < 0.01
    assert frame.error_bound_px == pytest.approx(plan.error_bound_px + scene_px)
    assert plan.error_bound_px <= tolerance_px
    assert frame.plan == plan.plan


def test_tolerance_when_no_plan_meets_it_is_reported(client: StreamClient) -> None:
    plan = client.set_accuracy(max_error_px=0.001)
    assert not plan.target_met
    assert "no plan stays within 0.001 px" in plan.plan


def test_budget_when_negative_is_rejected(client: StreamClient) -> None:
    with pytest.raises(CatoptraError, match="budget_ms must be 0"):
        client.set_accuracy(budget_ms=-1.0)


def test_plan_when_the_target_is_removed_is_that_of_the_file(client: StreamClient) -> None:
    before = client.set_accuracy()
    assert (before.cost_ms, before.max_error_px) == (None, 0.0)
    assert client.set_accuracy(max_error_px=2.0).plan != before.plan
    assert client.set_accuracy(max_error_px=0.0).plan == before.plan
