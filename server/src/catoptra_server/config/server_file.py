"""What ini files say of the server itself: ports, connections, pictures, tiles. UDK's sections.

    [USARBotAPI.BotServer]         ListenPort, MaxConnections
    [USARBotAPI.UPISImageServer]   bEnableImageServer, ListenPort, FrameSkip, ImageType, LegacyMode
    [USARBotAPI.MultiView]         CameraTileX, CameraTileY, CameraWidth, CameraHeight

UDK keeps them in the file that has its robots; they may stand in a robot's file here, too. What a
file does not say is not in its `Said`, so that one can go over another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from catoptra_protocol.errors import DomainError, LocalProtocolError
from catoptra_protocol.wire.image import ImageType
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.settings import Settings
from catoptra_server.imaging.multi_view import TileLayout, multi_view

_BOT_SERVER = "USARBotAPI.BotServer"
_IMAGE_SERVER = "USARBotAPI.UPISImageServer"
_MULTI_VIEW = "USARBotAPI.MultiView"
SECTIONS = (_BOT_SERVER, _IMAGE_SERVER, _MULTI_VIEW)

_LAST_PORT = 65535
# Of a clock of 50 ticks a second: a picture a minute is the least that makes sense.
MOST_SKIPPED = 3000
# UDK's own, for what its section leaves out.
_TILES = {"CameraTileX": 2, "CameraTileY": 2, "CameraWidth": 320, "CameraHeight": 240}


class Said(TypedDict, total=False):
    """What is said of a server, by a file or a command line, under the names of the settings."""

    control_port: int
    most_controllers: int
    has_images: bool
    image_port: int
    image_type: ImageType
    legacy_images: bool
    frame_skip: int
    multi_view: TileLayout


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """What holds, with what holds where nothing is said.

    Port 0 = any free one. most_controllers: control connections at once, None = any number.
    frame_skip: ticks between two pictures of the screen. multi_view: the screen's tiles, if any.
    """

    control_port: int = 3000
    most_controllers: int | None = None
    has_images: bool = True
    image_port: int = 5003
    image_type: ImageType = ImageType.GOOD
    legacy_images: bool = False
    frame_skip: int = 1
    multi_view: TileLayout | None = None


def settings_of(*said: Said) -> ServerSettings:
    """Return what holds after several have spoken; the last word counts."""
    together = Said()
    for one in said:
        together.update(one)
    return ServerSettings(**together)


def read_server(file: IniFile) -> Said:
    """Return what a file says of the server. Raises ConfigError with file, line and key."""
    said = Said()
    _read_bot_server(file.section(_BOT_SERVER), said)
    _read_image_server(file.section(_IMAGE_SERVER), said)
    if file.has(_MULTI_VIEW):
        said["multi_view"] = _tiles(file.section(_MULTI_VIEW))
    return said


def _read_bot_server(section: Settings, said: Said) -> None:
    if _says(section, "ListenPort"):
        said["control_port"] = section.integer("ListenPort", at_most=_LAST_PORT)
    if _says(section, "MaxConnections"):
        said["most_controllers"] = section.integer("MaxConnections", at_least=1)


def _read_image_server(section: Settings, said: Said) -> None:
    if _says(section, "bEnableImageServer"):
        said["has_images"] = section.boolean("bEnableImageServer", True)
    if _says(section, "ListenPort"):
        said["image_port"] = section.integer("ListenPort", at_most=_LAST_PORT)
    if _says(section, "FrameSkip"):
        said["frame_skip"] = section.integer("FrameSkip", at_least=1, at_most=MOST_SKIPPED)
    if _says(section, "LegacyMode"):
        said["legacy_images"] = section.boolean("LegacyMode", False)
    if _says(section, "ImageType"):
        said["image_type"] = _image_type(section)


def _says(section: Settings, key: str) -> bool:
    """Return whether a section has a key, which is then known."""
    section.text(key, "")
    return section.has(key)


def _image_type(section: Settings) -> ImageType:
    try:
        return ImageType.from_text(section.text("ImageType"))
    except LocalProtocolError as error:
        expected = "RAW, SUPER, GOOD, NORMAL, FAIR, BAD, or 0 to 5"
        raise section.complain("ImageType", expected=expected) from error


def _tiles(section: Settings) -> TileLayout:
    columns, rows, width, height = (
        section.integer(key, default, at_least=1, at_most=_LAST_PORT)
        for key, default in _TILES.items()
    )
    try:
        return multi_view(columns, rows, width_px=width, height_px=height)
    except DomainError as error:
        raise section.complain(
            "CameraTileX", expected=f"smaller or fewer tiles: {error}"
        ) from error
