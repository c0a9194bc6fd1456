"""NFO: the first line on a connection, and the reply to GETSTARTPOSES."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import Dialect, Message, split_words
from catoptra_protocol.usarsim.value_format import format_vector
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Greeting:
    """The first line on every connection."""

    WORD: ClassVar[str] = "NFO"

    game_type: str
    level: str
    """Name of the world."""
    time_limit: int = 0
    """Minutes; 0 = none."""

    @classmethod
    def from_message(cls, message: Message) -> Greeting:
        """Parse the message of a line."""
        return cls(
            game_type=strict_fields.read_text(message, "Gametype"),
            level=strict_fields.read_text(message, "Level"),
            time_limit=strict_fields.read_integer(message, "TimeLimit", default=0),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        limit = str(self.time_limit)
        pairs = (("Gametype", self.game_type), ("Level", self.level), ("TimeLimit", limit))
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class StartPose:
    """A named pose of the world file, in the world frame."""

    name: str
    """One word."""
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""


@dataclass(frozen=True, slots=True)
class StartPoses:
    """The reply to GETSTARTPOSES: one block of `name x,y,z r,p,y`, absent without poses."""

    WORD: ClassVar[str] = "NFO"

    poses: tuple[StartPose, ...]

    @classmethod
    def from_message(cls, message: Message) -> StartPoses:
        """Parse a line, whose second block begins with the first name.

        Raises:
            RemoteProtocolError: The number of words does not fit the number of poses.
        """
        blocks = [pair for pair in message.pairs if pair[0].lower() != "startposes"]
        # No spaces inside a list of numbers, so the words come in threes: name, location, rotation.
        words = split_words(" ".join(" ".join(pair) for pair in blocks[:1]))
        if len(words) != 3 * strict_fields.read_integer(message, "StartPoses"):
            raise RemoteProtocolError(
                f"NFO {{StartPoses {strict_fields.read_text(message, 'StartPoses')}}}: "
                f"expected three words (name x,y,z r,p,y) per pose, not {len(words)} in total"
            )
        triples = zip(words[::3], words[1::3], words[2::3], strict=True)
        return cls(tuple(_parse_start_pose(message, *triple) for triple in triples))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line, the same in both dialects.

        Raises:
            LocalProtocolError: A name is not one word.
        """
        words = [word for pose in self.poses for word in _format_start_pose(pose)]
        # The block has no name of its own: the name of the first pose stands in its position.
        block = ((words[0], " ".join(words[1:])),) if words else ()
        return (Message(self.WORD, (("StartPoses", str(len(self.poses))), *block)),)


def greeting_from_message(message: Message) -> Greeting | StartPoses:
    """Parse an NFO line of either kind."""
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
