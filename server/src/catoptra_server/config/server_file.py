"""Sections of ini files that configure the server itself, by UDK's names:

    [USARBotAPI.BotServer]         ListenPort, MaxConnections, HandshakeTimeout, IdleTimeout
    [USARBotAPI.UPISImageServer]   bEnableImageServer, ListenPort, FrameSkip, ImageType, LegacyMode,
                                   MaxConnections
    [USARBotAPI.MultiView]         CameraTileX, CameraTileY, CameraWidth, CameraHeight

UDK has these sections in the file of robots; so may a robot's file here. The time-outs, in
seconds, are ours, for both ports. A missing key is absent from `ServerOptions`,
so that the options of several sources can be layered.

A tile or viewport of the image port has the size of the layout, whatever the camera's own: a camera
of 100 px with 16 x 16 samples would take gigabytes in a tile of 2000 px. Clients switch viewports
at any time, so that the memory of all cameras is checked at start.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypedDict

from catoptra_protocol.errors import DomainError, LocalProtocolError, SourceLocation
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.multi_view import (
    Tile,
    TileLayout,
    ViewportConfig,
    fit_omni_camera,
    multi_view_layout,
    viewport_layout,
)
from catoptra_server.frames.plan.plans import omni_view_size, perspective_view_size
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MemoryBudget, ViewSize
from catoptra_server.simulation.robot_description import RobotDescription

_BOT_SERVER = "USARBotAPI.BotServer"
_IMAGE_SERVER = "USARBotAPI.UPISImageServer"
_MULTI_VIEW = "USARBotAPI.MultiView"
SERVER_SECTIONS = (_BOT_SERVER, _IMAGE_SERVER, _MULTI_VIEW)
_MAX_PORT = 65535
# One image a minute at 50 ticks a second: a larger number is taken for a typing error.
MAX_FRAME_SKIP = 3000
# Descriptors of open files set a lower limit on most systems.
MAX_CONNECTIONS = 4096
# A day: a larger number is taken for milliseconds.
MAX_TIMEOUT_S = 86_400.0
# UDK's defaults for keys that the section leaves out.
_MULTI_VIEW_DEFAULTS = {"CameraTileX": 2, "CameraTileY": 2, "CameraWidth": 320, "CameraHeight": 240}


class ServerOptions(TypedDict, total=False):
    """Settings that one source states: a file, or the command line. Keys as in ServerSettings."""

    control_port: int
    max_connections: int
    max_per_address: int
    handshake_timeout_s: float
    idle_timeout_s: float
    has_images: bool
    image_port: int
    max_image_connections: int
    image_type: ImageType
    legacy_images: bool
    frame_skip: int
    multi_view: TileLayout


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """Settings in effect, with USARSim's defaults. Port 0 = any free one."""

    control_port: int = 3000
    """TCP port of the USARSim protocol."""
    max_connections: int = 64
    """Control connections at the same time, 64 as in UDK."""
    max_per_address: int = 16
    """Connections to a port of one address that is not of this machine."""
    handshake_timeout_s: float = 0.0
    """Time until the first command or request of a connection; 0 = no limit."""
    idle_timeout_s: float = 0.0
    """Silence of a viewer, or of a controller without a robot; 0 = no limit."""
    has_images: bool = True
    """Whether there is an image port."""
    image_port: int = 5003
    """TCP port of the image server."""
    max_image_connections: int = 64
    """Image connections at the same time."""
    image_type: ImageType = ImageType.GOOD
    """Raw, or a JPEG quality."""
    legacy_images: bool = False
    """Whether a new viewer gets one frame without a request, as from early image servers."""
    frame_skip: int = 1
    """Ticks of 20 ms from one image of the image port to the next, at least."""
    multi_view: TileLayout | None = None
    """Tiles of the image port, one for each camera; None = one camera fills the image."""


def resolve_settings(*layers: ServerOptions) -> ServerSettings:
    """Settings in effect after several sources; a later one overrides an earlier one."""
    merged = ServerOptions()
    for layer in layers:
        merged.update(layer)
    return ServerSettings(**merged)


def read_server_options(file: IniFile) -> ServerOptions:
    """Server options that a file states.

    Raises:
        ConfigError: for a value out of range, with file, line and key.
    """
    options = ServerOptions()
    _read_bot_server(file.get_section(_BOT_SERVER), options)
    _read_image_server(file.get_section(_IMAGE_SERVER), options)
    # As in UDK the presence of the section switches the tiles on, even without a key.
    if file.has_section(_MULTI_VIEW):
        options["multi_view"] = _read_multi_view(file.get_section(_MULTI_VIEW))
    return options


def require_tiles_fit(
    robots: Sequence[RobotDescription],
    layout: TileLayout | None,
    *,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
) -> None:
    """Check that each camera fits into memory at the sizes of tile and viewport.

    Args:
        robots: all robots.
        layout: tiles of the image port; None for viewports, a quarter of the largest camera each.
        limit_bytes: memory that a view may take.

    Raises:
        ConfigError: for the first camera that does not fit.
    """
    for robot in robots:
        tile = layout.first_tile if layout else _viewport_tile(robot)
        for name, size in _view_sizes(robot, tile):
            MemoryBudget(limit_bytes).reserve(
                size.num_bytes,
                where=SourceLocation(robot.class_name),
                key=name,
                value=f"a tile of {tile.width_px} x {tile.height_px} px",
                remedy="smaller tiles, or fewer Samples or texels of the camera",
            )


def _read_bot_server(section: SectionReader, options: ServerOptions) -> None:
    # An absent key stays absent: a default here would override the value of another source.
    if _has_key(section, "ListenPort"):
        options["control_port"] = section.get_int("ListenPort", max_value=_MAX_PORT)
    if _has_key(section, "MaxConnections"):
        options["max_connections"] = section.get_int(
            "MaxConnections", min_value=1, max_value=MAX_CONNECTIONS
        )
    if _has_key(section, "HandshakeTimeout"):
        options["handshake_timeout_s"] = _read_timeout_s(section, "HandshakeTimeout")
    if _has_key(section, "IdleTimeout"):
        options["idle_timeout_s"] = _read_timeout_s(section, "IdleTimeout")


def _read_timeout_s(section: SectionReader, key: str) -> float:
    return section.get_float(key, 0.0, min_value=0.0, max_value=MAX_TIMEOUT_S)


def _read_image_server(section: SectionReader, options: ServerOptions) -> None:
    if _has_key(section, "bEnableImageServer"):
        options["has_images"] = section.get_bool("bEnableImageServer", True)
    if _has_key(section, "ListenPort"):
        options["image_port"] = section.get_int("ListenPort", max_value=_MAX_PORT)
    if _has_key(section, "MaxConnections"):
        options["max_image_connections"] = section.get_int(
            "MaxConnections", min_value=1, max_value=MAX_CONNECTIONS
        )
    if _has_key(section, "FrameSkip"):
        options["frame_skip"] = section.get_int("FrameSkip", min_value=1, max_value=MAX_FRAME_SKIP)
    if _has_key(section, "LegacyMode"):
        options["legacy_images"] = section.get_bool("LegacyMode", False)
    if _has_key(section, "ImageType"):
        options["image_type"] = _read_image_type(section)


def _has_key(section: SectionReader, key: str) -> bool:
    """Whether a section has a key, which counts as known in either case."""
    # An empty value, `ImageType=`, is present: UDK takes this one for the type NORMAL.
    section.get_str(key, "")
    return section.has_key(key)


def _read_image_type(section: SectionReader) -> ImageType:
    try:
        return ImageType.from_text(section.get_str("ImageType"))
    except LocalProtocolError as error:
        expected = "RAW, SUPER, GOOD, NORMAL, FAIR, BAD, or 0 to 5"
        raise section.make_error("ImageType", expected=expected) from error


def _read_multi_view(section: SectionReader) -> TileLayout:
    columns, rows, width, height = (
        section.get_int(key, default, min_value=1, max_value=_MAX_PORT)
        for key, default in _MULTI_VIEW_DEFAULTS.items()
    )
    try:
        return multi_view_layout(columns, rows, width_px=width, height_px=height)
    except DomainError as error:
        raise section.make_error(
            "CameraTileX", expected=f"smaller or fewer tiles: {error}"
        ) from error


def _viewport_tile(robot: RobotDescription) -> Tile:
    """Largest viewport of a robot's quad view."""
    sizes = [(camera.width_px, camera.height_px) for camera in robot.perspective_cameras]
    sizes.extend((omni.camera.width_px, omni.camera.height_px) for omni in robot.omni_cameras)
    # A camera of one pixel has no viewport; a tile has at least one pixel.
    width = max((width for width, _ in sizes), default=2)
    height = max((height for _, height in sizes), default=2)
    quad = ViewportConfig.QUAD_VIEW
    return viewport_layout(quad, width_px=max(width, 2), height_px=max(height, 2)).first_tile


def _view_sizes(robot: RobotDescription, tile: Tile) -> Iterable[tuple[str, ViewSize]]:
    """Yield name and size in memory of each camera of a robot in a tile."""
    for omni in robot.omni_cameras:
        camera = fit_omni_camera(tile, omni.camera)
        # A smaller view than the camera's own, which fits: `camera_sections.reserve_view`.
        own = omni.camera
        if camera.width_px <= own.width_px and camera.height_px <= own.height_px:
            continue
        bytes_per_px = omni.effects.bytes_per_px
        settings = omni.render_settings
        yield omni.name, omni_view_size(camera, settings, effect_bytes_per_px=bytes_per_px)
    for perspective in robot.perspective_cameras:
        yield (
            perspective.name,
            perspective_view_size(
                PerspectiveCamera(tile.width_px, tile.height_px, perspective.fov_rad),
                effect_bytes_per_px=perspective.effects.bytes_per_px,
            ),
        )
