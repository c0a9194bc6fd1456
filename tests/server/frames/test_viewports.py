"""SET Viewports: cameras by viewport, missing cameras, unknown divisions."""

from __future__ import annotations

from catoptra_protocol.usarsim.commands import SetViewports
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.frames.multi_view import Viewports


def test_viewports_when_set_are_confirmed_in_the_captured_form() -> None:
    command = SetViewports("singleview", ("camera", "Disable", "Disable", "Disable"))
    assert line_from_report(Viewports(["Camera"]).execute(command, 1.0)) == (
        b"RES {Time 1.00} {Type Viewports} {Config SingleView} {Status OK} {Viewport1 Camera} "
        b"{Status OK} {Viewport2 Disabled} {Status OK} {Viewport3 Disabled} {Status OK} "
        b"{Viewport4 Disabled} {Status OK}\r\n"
    )


def test_viewports_when_a_camera_is_missing_fail_and_keep_the_rest() -> None:
    viewports = Viewports(["Camera", "Camera2"])
    viewports.execute(SetViewports("QuadView", (None, "Camera2", None, None)), 1.0)
    result = viewports.execute(SetViewports("Circle", (None, None, "Camera9", None)), 2.0)
    assert (result.config, result.status) == ("QuadView", "Failed")
    assert [(v.camera, v.status) for v in result.viewports] == [
        ("Camera", "OK"),
        ("Camera2", "OK"),
        ("None", "Failed"),
        ("Disabled", "OK"),
    ]
