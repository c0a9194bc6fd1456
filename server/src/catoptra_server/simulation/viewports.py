"""SET Viewports: which camera one client wants in which quarter of the picture."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.usarsim.command_results import (
    CAMERA_DISABLED,
    CAMERA_MISSING,
    NUM_VIEWPORTS,
    STATUS_FAILED,
    STATUS_OK,
)
from catoptra_protocol.usarsim.commands import SetViewports
from catoptra_protocol.usarsim.reports import Viewport, ViewportsResult
from catoptra_server.frames.multi_view import ViewportConfig

_CONFIGS = tuple(config.value for config in ViewportConfig)
# How clients switch a viewport off.
_DISABLE_KEYWORDS = ("disable", "disabled", "none")


class Viewports:
    """What a client has asked for, kept and confirmed.

    At first the first camera fills the picture.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self._cameras = tuple(cameras)
        self._config = _CONFIGS[0]
        first = [Viewport(name) for name in self._cameras[:1]]
        self._viewports = (*first, *[Viewport()] * (NUM_VIEWPORTS - len(first)))

    @property
    def config(self) -> ViewportConfig:
        """Return how the picture is divided."""
        return ViewportConfig(self._config)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Return the camera of each viewport by name; one that shows none has another word."""
        return tuple(viewport.camera for viewport in self._viewports)

    def execute(self, command: SetViewports, time_s: float) -> ViewportsResult:
        """Take over what is named; a viewport that is not named stays as it is."""
        known = {config.lower(): config for config in _CONFIGS}
        wished = command.config or self._config
        self._config = known.get(wished.lower(), self._config)
        self._viewports = tuple(
            old if name is None else self._viewport(name)
            for old, name in zip(self._viewports, command.cameras, strict=True)
        )
        status = STATUS_OK if wished.lower() in known else STATUS_FAILED
        return ViewportsResult(time_s, self._config, self._viewports, status)

    def _viewport(self, name: str) -> Viewport:
        if name.lower() in _DISABLE_KEYWORDS:
            return Viewport(CAMERA_DISABLED)
        for camera in self._cameras:
            if camera.lower() == name.lower():
                return Viewport(camera)
        return Viewport(CAMERA_MISSING, STATUS_FAILED)
