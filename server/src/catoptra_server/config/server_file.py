"""What ini files say of the server itself: ports, connections, pictures, tiles. UDK's sections.

    [USARBotAPI.BotServer]         ListenPort, MaxConnections
    [USARBotAPI.UPISImageServer]   bEnableImageServer, ListenPort, FrameSkip, ImageType, LegacyMode
    [USARBotAPI.MultiView]         CameraTileX, CameraTileY, CameraWidth, CameraHeight

UDK keeps them in the file that has its robots; they may stand in a robot's file here, too. What a
file does not say is not in its `ServerOptions`, so that one can go over another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from catoptra_protocol.errors import DomainError, LocalProtocolError
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.multi_view import TileLayout, multi_view_layout

_BOT_SERVER = "USARBotAPI.BotServer"
_IMAGE_SERVER = "USARBotAPI.UPISImageServer"
_MULTI_VIEW = "USARBotAPI.MultiView"
SERVER_SECTIONS = (_BOT_SERVER, _IMAGE_SERVER, _MULTI_VIEW)

_MAX_PORT = 65535
# Of a clock of 50 ticks a second: a picture a minute is the least that makes sense.
MAX_FRAME_SKIP = 3000
# UDK's own, for what its section leaves out.
_MULTI_VIEW_DEFAULTS = {"CameraTileX": 2, "CameraTileY": 2, "CameraWidth": 320, "CameraHeight": 240}


class ServerOptions(TypedDict, total=False):
    """What is said of a server, by a file or a command line, under the names of the settings."""

    control_port: int
    max_connections: int
    has_images: bool
    image_port: int
    image_type: ImageType
    legacy_images: bool
    frame_skip: int
    multi_view: TileLayout


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """What holds, with what holds where nothing is said.

    Port 0 = any free one. max_connections: control connections at once, None = any number.
    frame_skip: ticks between two pictures of the screen. multi_view: the screen's tiles, if any.
    """

    control_port: int = 3000
    max_connections: int | None = None
    has_images: bool = True
    image_port: int = 5003
    image_type: ImageType = ImageType.GOOD
    legacy_images: bool = False
    frame_skip: int = 1
    multi_view: TileLayout | None = None


def resolve_settings(*layers: ServerOptions) -> ServerSettings:
    """Return what holds after several have spoken; the last word counts."""
    together = ServerOptions()
    for one in layers:
        together.update(one)
    return ServerSettings(**together)


def read_server_options(file: IniFile) -> ServerOptions:
    """Return what a file says of the server. Raises ConfigError with file, line and key."""
    said = ServerOptions()
    _read_bot_server(file.get_section(_BOT_SERVER), said)
    _read_image_server(file.get_section(_IMAGE_SERVER), said)
    if file.has_section(_MULTI_VIEW):
        said["multi_view"] = _read_multi_view(file.get_section(_MULTI_VIEW))
    return said


def _read_bot_server(section: SectionReader, options: ServerOptions) -> None:
    if _has_key(section, "ListenPort"):
        options["control_port"] = section.get_int("ListenPort", max_value=_MAX_PORT)
    if _has_key(section, "MaxConnections"):
        options["max_connections"] = section.get_int("MaxConnections", min_value=1)


def _read_image_server(section: SectionReader, options: ServerOptions) -> None:
    if _has_key(section, "bEnableImageServer"):
        options["has_images"] = section.get_bool("bEnableImageServer", True)
    if _has_key(section, "ListenPort"):
        options["image_port"] = section.get_int("ListenPort", max_value=_MAX_PORT)
    if _has_key(section, "FrameSkip"):
        options["frame_skip"] = section.get_int("FrameSkip", min_value=1, max_value=MAX_FRAME_SKIP)
    if _has_key(section, "LegacyMode"):
        options["legacy_images"] = section.get_bool("LegacyMode", False)
    if _has_key(section, "ImageType"):
        options["image_type"] = _read_image_type(section)


def _has_key(section: SectionReader, key: str) -> bool:
    """Return whether a section has a key, which is then known."""
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
