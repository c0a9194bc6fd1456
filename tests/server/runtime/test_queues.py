"""The order of work in a fair queue."""

from __future__ import annotations

from catoptra_server.runtime.queues import FairQueue


class _Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def take_all(queue: FairQueue[str, int]) -> list[int]:
    taken = []
    while (entry := queue.take()) is not None:
        taken.append(entry[1])
    return taken


def test_queue_within_the_shares_keeps_the_order_of_arrival() -> None:
    queue = FairQueue[str, int](share=0.1, monotonic=_Clock())
    for number, key in enumerate("abcabca"):
        queue.put(key, number)
    queue.charge("a", 0.004)
    assert take_all(queue) == [0, 1, 2, 3, 4, 5, 6]


def test_client_above_its_share_is_last_until_it_is_paid_back() -> None:
    clock = _Clock()
    queue = FairQueue[str, int](share=0.1, monotonic=clock)
    for number, key in enumerate("aabbc"):
        queue.put(key, number)
    assert queue.take() == ("a", 0)
    queue.charge("a", 0.5)
    assert queue.take() == ("b", 2)
    queue.charge("b", 0.2)
    assert take_all(queue) == [4, 3, 1]
    clock.now_s = 6.0
    for number, key in enumerate("ab"):
        queue.put(key, number)
    assert take_all(queue) == [0, 1]


def test_client_above_its_share_is_in_order_once_its_use_is_written_off() -> None:
    queue = FairQueue[str, int](share=0.1, monotonic=_Clock())
    queue.write_off("a")
    for number, key in enumerate("aab"):
        queue.put(key, number)
    queue.charge("a", 0.5)
    queue.write_off("a")
    assert take_all(queue) == [0, 1, 2]


def test_queue_without_shares_ignores_all_use() -> None:
    queue = FairQueue[str, int](share=None, monotonic=_Clock())
    for number, key in enumerate("abab"):
        queue.put(key, number)
    queue.charge("a", 100.0)
    assert take_all(queue) == [0, 1, 2, 3]


def test_queue_counts_replaces_and_drops_the_work_of_a_client() -> None:
    queue = FairQueue[str, int](share=0.1, monotonic=_Clock())
    for number, key in enumerate("aab"):
        queue.put(key, number)
    queue.replace_newest("a", 7)
    assert (len(queue), queue.count("a"), queue.newest("a"), queue.num_arrived) == (3, 2, 7, 3)
    assert queue.drop("a") == [0, 7]
    assert (len(queue), queue.count("a"), queue.newest("a")) == (1, 0, None)
    assert queue.drop("nobody") == []
    assert queue.clear() == [2]
    assert len(queue) == 0


def test_accounts_without_work_and_use_are_forgotten() -> None:
    clock = _Clock()
    queue = FairQueue[str, int](share=0.5, monotonic=clock)
    for number in range(2000):
        clock.now_s += 1.0
        queue.put(str(number), number)
        queue.take()
        queue.charge(str(number), 0.01)
    assert len(queue._accounts) < 300


def queue_with_long_work(clock: _Clock, *charges: tuple[str, float]) -> FairQueue[str, int]:
    """Queue in which some clients had work and the last one has more waiting."""
    queue = FairQueue[str, int](share=0.1, patience_s=0.2, monotonic=clock)
    for key, duration_s in charges:
        queue.put(key, 0)
        assert queue.take() == (key, 0)
        queue.charge(key, duration_s)
    queue.put(charges[-1][0], 1)
    return queue


def test_long_work_waits_for_a_client_that_was_active_a_moment_ago() -> None:
    clock = _Clock()
    queue = queue_with_long_work(clock, ("viewer", 0.01), ("long", 2.0))
    queue.put("viewer", 1)
    assert queue.take() == ("viewer", 1)
    queue.charge("viewer", 0.01)
    # Between two requests of the viewer ...
    clock.now_s += 0.19
    assert queue.take() is None
    # ... and after the viewer has left.
    clock.now_s += 0.02
    assert queue.take() == ("long", 1)


def test_long_work_waits_for_four_times_its_duration_at_most() -> None:
    clock = _Clock()
    queue = queue_with_long_work(clock, ("viewer", 1e-5), ("long", 2.0))
    for num in range(79):
        clock.now_s += 0.1
        assert queue.take() is None, num
        queue.charge("viewer", 1e-5)
    clock.now_s += 0.2
    queue.charge("viewer", 1e-5)
    assert queue.take() == ("long", 1)


def test_newcomer_comes_before_busy_clients_for_a_moment_only() -> None:
    clock = _Clock()
    queue = FairQueue[str, int](share=0.1, monotonic=clock)
    served = {"viewer": 0, "other": 0, "newcomer": 0}
    for num in range(3000):
        # Two clients use all the time for 20 s; then a third one wants all of it, too.
        for key in list(served)[: 2 if num < 2000 else 3]:
            if not queue.count(key):
                queue.put(key, num)
        taken = queue.take()
        assert taken is not None
        served[taken[0]] += num >= 2100
        clock.now_s += 0.01
        queue.charge(taken[0], 0.01)
    # From a second after its arrival on each has a third.
    assert min(served.values()) > 270


def test_short_work_waits_for_nobody() -> None:
    queue = queue_with_long_work(_Clock(), ("idle", 0.001), ("busy", 0.1))
    assert queue.take() == ("busy", 1)


def test_long_work_of_the_client_with_the_least_use_is_not_delayed() -> None:
    queue = queue_with_long_work(_Clock(), ("used", 3.0), ("long", 2.0))
    assert queue.take() == ("long", 1)


def test_weight_counts_as_use() -> None:
    queue = FairQueue[str, int](share=0.1, monotonic=_Clock())
    for key, weight in (("heavy", 4.0), ("light", 1.0)):
        queue.put(key, 0)
        queue.take()
        queue.charge(key, 1.0, weight=weight)
        queue.put(key, 1)
    assert queue.take() == ("light", 1)
