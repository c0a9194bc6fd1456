"""What the stream's clients of all transports share: frames, the simulation, the server itself."""

from __future__ import annotations

from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.transports.stream.plan_replies import QueryPlan
from catoptra_server.transports.stream.report_lines import ReportLines
from catoptra_server.transports.stream.robot_session import Post
from catoptra_server.transports.stream.server_info import ServerInfo


@dataclass(frozen=True, slots=True, eq=False)
class StreamContext:
    """One for all clients of a server, on ZeroMQ and on WebSockets."""

    mailboxes: Mailboxes
    """Newest frame of each channel."""
    post: Post
    """Hands an event to the simulation; thread-safe."""
    server_info: ServerInfo
    """Constant part of the replies."""
    query_plan: QueryPlan
    """Hands a camera to the render thread, for its plan."""
    report_lines: ReportLines = field(default_factory=ReportLines)
    """Lines of the reports that several clients read."""
    clients: set[object] = field(default_factory=set)
    """Connected clients; each adds and removes itself."""
