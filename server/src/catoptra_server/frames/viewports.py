"""State of UT2004's `SET {Type Viewports}`: the camera that each viewport of a robot shows."""

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
# Clients differ in the word that switches a viewport off.
_DISABLE_KEYWORDS = ("disable", "disabled", "none")


class Viewports:
    """Viewports of one robot; at first the first camera fills the image."""

    def __init__(self, cameras: Sequence[str]) -> None:
        """Start with the first of the robot's cameras, given by name."""
        self._cameras = tuple(cameras)
        self._config = _CONFIGS[0]
        # All four viewports exist from the start: RES reports each, whatever the division.
        first = [Viewport(name) for name in self._cameras[:1]]
        self._viewports = (*first, *[Viewport()] * (NUM_VIEWPORTS - len(first)))

    @property
    def config(self) -> ViewportConfig:
        """Division of the image."""
        return ViewportConfig(self._config)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Camera of each viewport; a name that no camera has for a viewport that is off."""
        return tuple(viewport.camera for viewport in self._viewports)

    def execute(self, command: SetViewports, time_s: float) -> ViewportsResult:
        """Apply a command; viewports and division that the command leaves out keep their state."""
        configs = {config.lower(): config for config in _CONFIGS}
        requested = command.config or self._config
        # An unknown Config fails, but the viewports of the same command are applied all the same.
        self._config = configs.get(requested.lower(), self._config)
        self._viewports = tuple(
            old if name is None else self._viewport(name)
            for old, name in zip(self._viewports, command.cameras, strict=True)
        )
        status = STATUS_OK if requested.lower() in configs else STATUS_FAILED
        return ViewportsResult(time_s, self._config, self._viewports, status)

    def _viewport(self, name: str) -> Viewport:
        if name.lower() in _DISABLE_KEYWORDS:
            return Viewport(CAMERA_DISABLED)
        for camera in self._cameras:
            if camera.lower() == name.lower():
                return Viewport(camera)
        return Viewport(CAMERA_MISSING, STATUS_FAILED)
