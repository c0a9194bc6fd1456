"""Messages that wait for room: their order, their bounds, and the one frame."""

from __future__ import annotations

from dataclasses import dataclass, field

from catoptra_server.serve.stream.router import Outbox, SendResult


@dataclass
class Queue:
    """A queue with room for some messages, and a record of the outbox's calls."""

    room: int
    sent: list[list[bytes]] = field(default_factory=list)
    num_blocked: int = 0
    num_overflows: int = 0

    def send(self, parts: list[bytes]) -> SendResult:
        """Accept a message if there is room."""
        if not self.room:
            return SendResult.QUEUE_FULL
        self.room -= 1
        self.sent.append(parts)
        return SendResult.SENT

    def block(self) -> None:
        """Count a call."""
        self.num_blocked += 1

    def overflow(self) -> None:
        """Count a call."""
        self.num_overflows += 1


def open_outbox(queue: Queue) -> Outbox:
    return Outbox(queue.send, on_blocked=queue.block, on_overflow=queue.overflow)


def test_messages_when_there_is_no_room_wait_and_keep_their_order() -> None:
    queue = Queue(room=1)
    outbox = open_outbox(queue)
    for number in range(4):
        outbox.send(b"%d" % number)
    assert (queue.sent, outbox.is_blocked, queue.num_blocked) == ([[b"0"]], True, 1)
    queue.room = 2
    assert outbox.flush()
    assert (len(queue.sent), outbox.is_blocked) == (3, True)
    queue.room = 9
    outbox.send(b"4")
    assert [parts[0] for parts in queue.sent] == [b"%d" % number for number in range(5)]
    assert not outbox.is_blocked
    assert not outbox.flush()


def test_frame_when_it_waits_is_withdrawn_and_its_neighbours_stay() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send(b"before")
    outbox.send_frame(b"header", b"image")
    outbox.send(b"after")
    assert outbox.withdraw_frame()
    assert not outbox.withdraw_frame()
    queue.room = 9
    outbox.flush()
    assert queue.sent == [[b"before"], [b"after"]]


def test_frame_when_sent_is_not_withdrawn() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send_frame(b"header", b"image")
    queue.room = 2
    outbox.flush()
    assert not outbox.withdraw_frame()
    outbox.send_frame(b"header 2", b"image")
    assert not outbox.withdraw_frame()
    assert queue.sent == [[b"header", b"image"], [b"header 2", b"image"]]


def test_messages_when_too_many_wait_are_an_overflow() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    for _ in range(128):
        outbox.send(b"")
    assert queue.num_overflows == 0
    outbox.send(b"")
    assert queue.num_overflows == 1


def test_messages_when_too_long_are_an_overflow_and_a_frame_is_not() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send_frame(b"header", bytes(8 * 1024 * 1024))
    outbox.send(bytes(4 * 1024 * 1024))
    assert queue.num_overflows == 0
    outbox.send(b"1")
    assert queue.num_overflows == 1


def test_bytes_when_sent_count_no_longer() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    for _ in range(20):
        outbox.send(bytes(1024 * 1024))
        queue.room = 1
        outbox.flush()
    assert (queue.num_overflows, len(queue.sent)) == (0, 20)


def test_messages_when_closed_are_dropped() -> None:
    queue = Queue(room=0)
    outbox = open_outbox(queue)
    outbox.send(b"early")
    outbox.close()
    queue.room = 9
    outbox.send(b"late")
    outbox.flush()
    assert (queue.sent, outbox.is_blocked) == ([], False)
