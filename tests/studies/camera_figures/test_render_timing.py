from __future__ import annotations

from catoptra_studies.camera_figures.frame_rates import (
    NUM_WARM_UP_ROUNDS,
    DrawFunction,
    time_round_robin,
)


def test_draws_take_turns_and_know_their_round() -> None:
    calls: list[tuple[str, int]] = []

    def named(name: str) -> DrawFunction:
        def draw(number: int) -> dict[str, float]:
            calls.append((name, number))
            return {}

        return draw

    time_round_robin([named("a"), named("b")], num_rounds=2, on_round=lambda: None)
    expected = [(name, n) for n in range(NUM_WARM_UP_ROUNDS + 2) for name in "ab"]
    assert calls == expected


def test_stages_are_medians_without_the_warm_up() -> None:
    times = iter([*(1000.0,) * NUM_WARM_UP_ROUNDS, 1.0, 9.0, 2.0])
    (took,) = time_round_robin(
        [lambda _: {"trace": next(times)}], num_rounds=3, on_round=lambda: None
    )
    assert took.stage_ms == {"trace": 2.0}
    assert took.wall_ms >= 0.0


def test_every_round_is_told() -> None:
    rounds: list[int] = []
    time_round_robin([lambda _: {}], num_rounds=4, on_round=lambda: rounds.append(1))
    assert len(rounds) == NUM_WARM_UP_ROUNDS + 4
