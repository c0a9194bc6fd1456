"""What the doctor says of renderers, by what the processes that try them answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest

from catoptra_server.doctor.children import Answer
from catoptra_server.doctor.finding import Finding, Level, exit_status
from catoptra_server.doctor.renderers import renderer_findings

WELL = Answer({"renderer": "a renderer", "error_px": 0.05, "bound_px": 0.2, "took_s": 1.0})
WRONG = Answer({"renderer": "a renderer", "error_px": 2.5, "bound_px": 0.2, "took_s": 1.0})
BLIND = Answer({"renderer": "a renderer", "error_px": float("inf"), "bound_px": 0.2, "took_s": 1.0})
CRASHED = Answer(trouble="it crashed (SIGSEGV)")


def answers(
    *, devices: Answer, trace: Answer = WELL, raster: tuple[Answer, ...] = (WELL,)
) -> Callable[..., Answer]:
    """Return who answers so; raster by the number of the device that is asked for."""

    def ask(*words: str, environment: Mapping[str, str] | None = None) -> Answer:
        match words:
            case ("egl-devices",):
                return devices
            case ("self-test", "trace"):
                return trace
        assert words == ("self-test", "raster")
        return raster[int((environment or {})["GLCONTEXT_DEVICE_INDEX"])]

    return ask


ONE = Answer({"devices": ["software"]})
TWO = Answer({"devices": ["/dev/dri/card0", "software"]})


def problems(renderer: str, ask: Callable[..., Answer]) -> list[Finding]:
    """Return what is not well."""
    return [f for f in renderer_findings(renderer, ask) if f.level is not Level.OK]


@pytest.mark.parametrize("renderer", ["auto", "trace", "raster"])
def test_renderers_when_all_draw_are_well(renderer: str) -> None:
    assert problems(renderer, answers(devices=ONE)) == []


@pytest.mark.parametrize(
    ("devices", "said"),
    [
        (Answer(trouble="libEGL.so.1 cannot be loaded"), "libEGL.so.1 cannot be loaded"),
        (Answer(trouble="it crashed (SIGSEGV)"), "it crashed (SIGSEGV)"),
        (Answer({"devices": []}), "lists no device"),
    ],
    ids=["no libEGL", "crash", "no driver"],
)
@pytest.mark.parametrize(("renderer", "status"), [("auto", 1), ("raster", 2), ("trace", 0)])
def test_opengl_when_missing_is_as_bad_as_it_is_needed(
    devices: Answer, said: str, renderer: str, status: int
) -> None:
    found = problems(renderer, answers(devices=devices))
    assert exit_status(found) == status
    assert all(said in f.what and "libegl1" in f.remedy for f in found)


@pytest.mark.parametrize("answer", [CRASHED, WRONG, BLIND], ids=["crash", "wrong", "blind"])
def test_device_when_it_fails_alone_is_the_only_problem(answer: Answer) -> None:
    found = problems("raster", answers(devices=TWO, raster=(WELL, answer)))
    assert [(f.level, f.topic) for f in found] == [(Level.WARNING, "raster on device 1 (software)")]


@pytest.mark.parametrize("answer", [CRASHED, WRONG, BLIND], ids=["crash", "wrong", "blind"])
def test_device_when_the_first_fails_is_a_fault_where_raster_is_asked_for(answer: Answer) -> None:
    ask = answers(devices=ONE, raster=(answer,))
    assert exit_status(problems("raster", ask)) == 2
    assert exit_status(problems("auto", ask)) == 1


def test_trace_when_it_cannot_run_is_a_fault() -> None:
    (found,) = problems("auto", answers(devices=ONE, trace=Answer(trouble="No module 'embreex'")))
    assert found.level is Level.FAULT
    assert "embreex" in found.remedy
