"""What do effects cost: none that is named, all where none is needed, and all that are called for?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/effects.py

Prints, for frames of 640 x 640 px of the field, drawn in turns through `Views` as the server draws
them, standing and driving, the median milliseconds on the wall and of all processors, and the ratio
of the latter to the view that knows of no effects. `none needed` names all kinds that there are, on
auto, with numbers of a good camera; what the criterion calls for all the same is named by the
second line, and left out by `never`. Decided by it: effects that are not called for leave the usual
view in place (imaging/views.py) instead of a chain without links; each effect is a pass of its own,
whose time is known, instead of one fused program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle

from driving import drive
from interleaved import median_ms
from scenes import EXPOSURE, camera, worlds

from catoptra_server.effects import EFFECTS
from catoptra_server.effects.effect import NO_WISHES, EffectWishes, Kind, Mode, Wish
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import OmniEye, Take
from catoptra_server.imaging.views import Views
from catoptra_server.render.choice import choose_renderer
from catoptra_server.render.renderer import Exposure
from catoptra_server.robot.render_wish import RenderWish
from catoptra_server.scene.meshes import build_scene

ROUNDS = 60
FEW_ROUNDS = 5
# Numbers with which no effect is needed in the field, by kind; those of every other field are the
# defaults, and `*` stands for all kinds. They are small, not nothing: bounds have to be found.
QUIET = {
    "*": {"full_well_e": 1e12, "read_noise_e": 1.0},
    "RollingShutter": {"readout_s": 1e-4},
    "MotionBlur": {"exposure_s": 1e-4},
    "DefocusByDepth": {"f_number": 64.0},
    "Defocus": {"f_number": 64.0},
    "MirrorDust": {"cover": 0.0, "scratches": 0.0},
    "MirrorReflectance": {"n": 0.01, "k": 20.0},
    "AutoExposure": {"least": 1.0, "most": 1.0},
    "Bloom": {"share": 0.0},
    "FixedPattern": {"prnu": 0.0, "dsnu_e": 0.0},
    "Quantisation": {"adc_bits": 16.0},
}


def wishes(mode: Mode) -> EffectWishes:
    """Return all effects with their defaults."""
    effects = (kind.make(**{p.field: p.default for p in kind.parameters}) for kind in EFFECTS)
    return EffectWishes(tuple(Wish(effect, mode) for effect in effects))


def quiet(kind: Kind, mode: Mode) -> Wish:
    """Return an effect with the numbers of a good camera."""
    numbers = QUIET["*"] | QUIET.get(kind.name, {})
    return Wish(
        kind.make(**{p.field: numbers.get(p.field, p.default) for p in kind.parameters}), mode
    )


def quiet_wishes(called_for: frozenset[str]) -> EffectWishes:
    """Return all effects on auto, but for those that are called for whatever their numbers."""
    modes = ((k, Mode.NEVER if k.name in called_for else Mode.AUTO) for k in EFFECTS)
    return EffectWishes(tuple(quiet(kind, mode) for kind, mode in modes))


def drawer(
    renderer: str, samples: int, effects: EffectWishes, exposures: Iterator[Exposure]
) -> Callable[[], object]:
    """Return what draws frames through views of their own."""
    world = worlds()["field"]
    choice = choose_renderer(renderer, build_scene(world), world, samples=samples)
    views = Views(Planning(choice))
    eye = OmniEye(camera(), RenderWish(samples=samples), effects)
    return lambda: views.draw(Take(eye, next(exposures)))


def called_for() -> frozenset[str]:
    """Return what the field calls for, whatever the numbers."""
    frames = drawer("trace", 1, quiet_wishes(frozenset()), iter(drive("field", 40)))
    decisions = (one for _ in range(40) for one in frames().effects)  # type: ignore[attr-defined]
    return frozenset(one.effect for one in decisions if one.is_on)


def main() -> None:
    on = called_for()
    print(f"called for whatever the numbers, left out by `never`: {', '.join(sorted(on))}")
    ways = {"standing": (EXPOSURE,), "driving": drive("field", 400)}
    for renderer, samples in (("trace", 1), ("trace", 2), ("raster", 1), ("raster", 2)):
        for way, exposures in ways.items():
            named = {
                "none named": NO_WISHES,
                "none named, again": NO_WISHES,
                "none needed": quiet_wishes(on),
            }
            draws = {k: drawer(renderer, samples, w, cycle(exposures)) for k, w in named.items()}
            tell(f"{renderer} {samples}x{samples} {way:<9}", median_ms(draws, rounds=ROUNDS))
        all_run = {
            name: drawer(renderer, samples, named, cycle((EXPOSURE,)))
            for name, named in {"none named": NO_WISHES, "all run": wishes(Mode.ALWAYS)}.items()
        }
        tell(f"{renderer} {samples}x{samples} standing ", median_ms(all_run, rounds=FEW_ROUNDS))


def tell(what: str, times: dict[str, tuple[float, float]]) -> None:
    """Print a row each, with the ratio to the first."""
    first = next(iter(times.values()))[1]
    for name, (wall, processors) in times.items():
        row = f"{name:<18}{wall:8.2f}{processors:8.2f}{processors / first:8.3f}"
        print(f"  {what}{row}", flush=True)


if __name__ == "__main__":
    main()
