from __future__ import annotations

from catoptra_server.render.renderer import StageClock


def test_stages_are_named_in_order_and_each_waits_for_the_device() -> None:
    waits: list[str] = []
    clock = StageClock(lambda: waits.append("finish"))
    clock.end_stage("faces")
    clock.end_stage("mirror")
    assert list(clock.stage_ms) == ["faces", "mirror"]
    assert all(ms >= 0.0 for ms in clock.stage_ms.values())
    assert waits == ["finish", "finish"]
