"""Which engine traces: the kernel where it can run, else the reference with one warning."""

from __future__ import annotations

import logging

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.trace_renderer import EngineName, EngineRequest, create_engine
from catoptra_server.world.scene_mesh import build_scene
from helpers.worlds import make_test_world

WORLD = make_test_world()


def create_name(request: EngineRequest) -> tuple[EngineName, str]:
    """Name and description of the engine of a request."""
    name, engine = create_engine(
        request,
        build_scene(WORLD),
        WORLD,
        threads=1,
        scene_lights=WORLD.lights,
        instruction_set="auto",
    )
    engine.close()
    return name, engine.description


@pytest.fixture
def no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")


@pytest.mark.usefixtures("no_kernel")
def test_engine_when_the_kernel_is_missing_is_the_reference_with_one_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO):
        name, description = create_name("auto")
    assert name == "reference"
    assert description.startswith("reference (")
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "CATOPTRA_KERNEL=off" in record.message
    assert "reference" in record.message


@pytest.mark.usefixtures("no_kernel")
def test_kernel_when_requested_and_missing_is_an_error() -> None:
    with pytest.raises(KernelUnavailableError, match="CATOPTRA_KERNEL=off"):
        create_name("kernel")


def test_reference_when_requested_is_given_without_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        assert create_name("reference")[0] == "reference"
    assert not caplog.records


def test_kernel_where_it_can_run_is_the_choice(caplog: pytest.LogCaptureFixture) -> None:
    try:
        expected = create_name("kernel")
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    with caplog.at_level(logging.WARNING):
        assert create_name("auto") == expected
    assert expected[1].startswith("kernel (")
    assert not caplog.records


def test_engine_that_does_not_exist_is_refused() -> None:
    with pytest.raises(DomainError, match="auto, kernel or reference, not 'fast'"):
        create_name("fast")  # type: ignore[arg-type]
