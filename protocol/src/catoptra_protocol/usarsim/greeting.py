"""NFO: the first line on a connection, and the answer to GETSTARTPOSES."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import Message, split_words
from catoptra_protocol.usarsim.value_format import Vector3, format_vector


@dataclass(frozen=True, slots=True)
class Greeting:
    """The first line on every connection. The time limit is in minutes; 0 = none."""

    WORD: ClassVar[str] = "NFO"

    game_type: str
    level: str
    time_limit: int = 0

    @classmethod
    def from_message(cls, message: Message) -> Greeting:
        """Return the greeting of a parsed line."""
        return cls(
            game_type=strict_fields.read_text(message, "Gametype"),
            level=strict_fields.read_text(message, "Level"),
            time_limit=strict_fields.read_integer(message, "TimeLimit", default=0),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        limit = str(self.time_limit)
        pairs = (("Gametype", self.game_type), ("Level", self.level), ("TimeLimit", limit))
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class StartPose:
    """A named pose of the world file, in the world frame; roll, pitch, yaw."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3


@dataclass(frozen=True, slots=True)
class StartPoses:
    """The answer to GETSTARTPOSES: one block of `name x,y,z r,p,y`, absent if there is none."""

    WORD: ClassVar[str] = "NFO"

    poses: tuple[StartPose, ...]

    @classmethod
    def from_message(cls, message: Message) -> StartPoses:
        """Return the poses of a parsed line, whose second block starts with the first name."""
        blocks = [pair for pair in message.pairs if pair[0].lower() != "startposes"]
        found = split_words(" ".join(" ".join(pair) for pair in blocks[:1]))
        if len(found) != 3 * strict_fields.read_integer(message, "StartPoses"):
            raise RemoteProtocolError(
                f"NFO {{StartPoses {strict_fields.read_text(message, 'StartPoses')}}}: expected three words "
                f"(name x,y,z r,p,y) a pose, not {len(found)} in all"
            )
        triples = zip(found[::3], found[1::3], found[2::3], strict=True)
        return cls(tuple(_parse_start_pose(message, *triple) for triple in triples))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        said = [word for pose in self.poses for word in _format_start_pose(pose)]
        block = ((said[0], " ".join(said[1:])),) if said else ()
        return (Message(self.WORD, (("StartPoses", str(len(self.poses))), *block)),)


def greeting_from_message(message: Message) -> Greeting | StartPoses:
    """Return what an NFO line says."""
    is_poses = message.get("StartPoses") is not None
    return StartPoses.from_message(message) if is_poses else Greeting.from_message(message)


def _format_start_pose(pose: StartPose) -> tuple[str, str, str]:
    if not pose.name or " " in pose.name:
        raise LocalProtocolError(f"NFO: start pose {pose.name!r}: the name must be one word")
    return pose.name, format_vector(pose.location_m), format_vector(pose.rotation_rad)


def _parse_start_pose(message: Message, name: str, location: str, rotation: str) -> StartPose:
    return StartPose(
        name, *strict_fields.parse_vectors(message, Location=location, Orientation=rotation)
    )
