"""Renderers are created on demand, made anew, and replaced."""

from __future__ import annotations

from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_server.frames.plan.renderers import RendererChoice, RendererPool
from catoptra_server.render.renderer_kind import RendererKind

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


class PooledRenderer:
    """Logs its creation and its end."""

    def __init__(self, log: list[str], name: str) -> None:
        self._log, self._name = log, name
        log.append(f"create {name}")

    def describe(self) -> str:
        return self._name

    def close(self) -> None:
        self._log.append(f"close {self._name}")


def make_pool(log: list[str], *, named: bool = False, may_replace: bool = True) -> RendererPool:
    def create_trace() -> Any:
        return PooledRenderer(log, "trace")

    def create_raster() -> Any:
        return PooledRenderer(log, "raster")

    alternatives = {} if named else {RASTER: create_raster}
    choice = RendererChoice(create_trace(), TRACE, "test", {TRACE: create_trace, **alternatives})
    return RendererPool(choice, may_replace=may_replace)


def test_alternative_is_created_at_its_first_use() -> None:
    log: list[str] = []
    pool = make_pool(log)
    assert pool.get(TRACE) is pool.get(TRACE)
    assert log == ["create trace"]
    assert pool.get(RASTER) is pool.get(RASTER)
    pool.close()
    assert log == ["create trace", "create raster", "close trace", "close raster"]


def test_renewed_renderer_is_closed_at_once_and_created_at_the_next_use() -> None:
    log: list[str] = []
    pool = make_pool(log)
    before = pool.get(TRACE)
    pool.renew(TRACE)
    assert log == ["create trace", "close trace"]
    assert pool.get(TRACE) is not before
    pool.renew(RASTER)
    assert log[2:] == ["create trace"]


def test_renderer_without_a_factory_is_kept() -> None:
    log: list[str] = []
    renderer: Any = PooledRenderer(log, "trace")
    pool = RendererPool(RendererChoice(renderer, TRACE, "test"))
    pool.renew(TRACE)
    assert pool.get(TRACE) is renderer
    assert log == ["create trace"]


def test_all_renderers_that_can_be_created_are_usable(caplog: pytest.LogCaptureFixture) -> None:
    log: list[str] = []

    def fail() -> Any:
        raise RendererUnavailableError("no OpenGL")

    assert make_pool(log).create_all() == [TRACE, RASTER]
    renderer: Any = PooledRenderer(log, "trace")
    pool = RendererPool(RendererChoice(renderer, TRACE, "test", {RASTER: fail}))
    with caplog.at_level("INFO"):
        assert pool.create_all() == [TRACE]
        assert pool.create_all() == [TRACE]
    assert caplog.text.count("raster is not available: no OpenGL") == 1


def test_replacement_is_the_other_kind_and_can_be_undone() -> None:
    pool = make_pool([])
    assert pool.find_replacement(TRACE) is RASTER
    pool.replace(TRACE, RASTER)
    assert pool.default_kind is RASTER
    assert pool.reason == "raster in place of trace, which failed: test"
    assert pool.create_all() == [RASTER]
    assert pool.find_replacement(RASTER) is None
    pool.restore(TRACE)
    assert (pool.default_kind, pool.reason) == (TRACE, "test")


def test_replacement_of_an_alternative_leaves_the_default() -> None:
    pool = make_pool([])
    pool.replace(RASTER, TRACE)
    assert pool.default_kind is TRACE
    assert pool.create_all() == [TRACE]


@pytest.mark.parametrize("settings", [{"named": True}, {"may_replace": False}], ids=str)
def test_renderer_by_name_or_under_lockstep_is_not_replaced(settings: dict[str, bool]) -> None:
    assert make_pool([], **settings).find_replacement(TRACE) is None


def test_usable_renderers_are_those_that_exist_or_can_be_created_and_were_not_replaced() -> None:
    pool = make_pool([])
    assert [pool.is_usable(kind) for kind in (TRACE, RASTER)] == [True, True]
    assert pool.describe(RASTER) == "raster"
    pool.replace(TRACE, RASTER)
    assert [pool.is_usable(kind) for kind in (TRACE, RASTER)] == [False, True]
    assert not make_pool([], named=True).is_usable(RASTER)
