"""What do effects cost: none that is named, some that are needless, and all that are called for?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/effects.py

Prints, for frames of 640 x 640 px of the field at 2 x 2 samples, drawn in turns through `Views` as
the server draws them, the median milliseconds on the wall and of all processors, and the ratio of
the latter to the view that knows of no effects. Decided by it: effects that are not called for
leave the usual view in place (imaging/views.py) instead of a chain without links; each effect is a
pass of its own, whose time is known, instead of one fused program.
"""

from __future__ import annotations

from collections.abc import Callable

from interleaved import median_ms
from scenes import EXPOSURE, camera, worlds

from catoptra_server.effects import EFFECTS
from catoptra_server.effects.effect import NO_WISHES, EffectWishes, Mode, Wish
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import OmniEye, Take
from catoptra_server.imaging.views import Views
from catoptra_server.render.choice import choose_renderer
from catoptra_server.robot.render_wish import RenderWish
from catoptra_server.scene.meshes import build_scene

ROUNDS = 60


def wishes(mode: Mode) -> EffectWishes:
    """Return all effects with their defaults."""
    effects = (kind.make(**{p.field: p.default for p in kind.parameters}) for kind in EFFECTS)
    return EffectWishes(tuple(Wish(effect, mode) for effect in effects))


def drawer(renderer: str, effects: EffectWishes) -> Callable[[], object]:
    """Return what draws a frame through views of their own."""
    world = worlds()["field"]
    choice = choose_renderer(renderer, build_scene(world), world, samples=2)
    views = Views(Planning(choice))
    take = Take(OmniEye(camera(), RenderWish(samples=2), effects), EXPOSURE)
    return lambda: views.draw(take)


def main() -> None:
    for renderer in ("trace", "raster"):
        draws = {
            "none named": drawer(renderer, NO_WISHES),
            "none named, again": drawer(renderer, NO_WISHES),
            "all named, none run": drawer(renderer, wishes(Mode.NEVER)),
            "all run": drawer(renderer, wishes(Mode.ALWAYS)),
        }
        times = median_ms(draws, rounds=ROUNDS)
        first = next(iter(times.values()))[1]
        for name, (wall, processors) in times.items():
            print(f"  {renderer:<7}{name:<22}{wall:8.2f}{processors:8.2f}{processors / first:8.3f}")


if __name__ == "__main__":
    main()
