"""Processor time of the real camera's image effects, on two threads at 640 x 480 px.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/image_chain.py [--before FOLDER]

Prints median milliseconds of all threads for the stages that a frame of p2at_omni_real.ini at the
field's start needs: those that act on a pixel, and all, with the thresholds of that frame and
without. FOLDER holds the kernel's libraries of another build with the same structures: both are
called in turns, so that a disturbance affects both alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from unittest import mock

from effect_frame_times import Bench
from interleaved import median_ms

from catoptra_server.commands import explain
from catoptra_server.effects import ImageEffect, Threshold
from catoptra_server.render.image_changer import ChangedImage, ExposedImage
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace.kernel import library
from catoptra_server.render.trace.kernel.image import KernelImageChanger
from catoptra_server.render.trace.kernel.library import KernelDevice, choose_instruction_set

LENS = frozenset(
    {"DefocusByDepth", "Defocus", "Misalignment", "ChromaticAberration", "Diffraction", "Blooming"}
)


Chain = tuple[ExposedImage, tuple[ImageEffect, ...], Mapping[str, Threshold]]


def record_chain() -> Chain:
    """Exposed image, effects and thresholds of a frame, as the renderer hands them over."""
    recorded: list[Chain] = []
    encode = KernelImageChanger.encode

    def record(
        changer: KernelImageChanger,
        exposed: ExposedImage,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
    ) -> ChangedImage[Image]:
        recorded.append((exposed, effects, thresholds))
        return encode(changer, exposed, effects, thresholds)

    bench = Bench("four_legged_2006", "trace")
    with mock.patch.object(KernelImageChanger, "encode", record):
        bench.make_real_draw(explain.ZERO_VELOCITY)()
    bench.views.close()
    return recorded[-1]


def open_changer(folder: Path | None, threads: int) -> KernelImageChanger:
    """Image changer of the libraries in a folder; None: of those that are installed."""
    instruction_set = choose_instruction_set()
    path = library.kernel_library_path(instruction_set)
    chosen = path if folder is None else folder / path.name
    with mock.patch.object(library, "kernel_library_path", return_value=chosen):
        return KernelImageChanger(KernelDevice(instruction_set, threads))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=30)
    parsed = parser.parse_args()
    exposed, effects, thresholds = record_chain()
    folders = {"before": parsed.before, "now": None} if parsed.before else {"now": None}
    changers = {name: open_changer(one, parsed.threads) for name, one in folders.items()}
    points = tuple(one for one in effects if one.name not in LENS)
    draws: dict[str, Callable[[], ChangedImage[Image]]] = {}
    for chain_name, chain in (("points", points), ("all", effects)):
        for limits_name, limits in (("no thresholds", {}), ("thresholds", thresholds)):
            for name, changer in changers.items():
                label = f"{chain_name}, {limits_name}, {name}"
                draws[label] = partial(changer.encode, exposed, chain, limits)
    print(", ".join(one.name for one in effects))
    for label, (wall, processors) in median_ms(draws, rounds=parsed.rounds).items():
        stages = draws[label]().stage_ms
        shares = " ".join(f"{name} {ms:.2f}" for name, ms in stages.items())
        print(f"{label:<30}{wall:8.2f} wall {processors:8.2f} processor   {shares}", flush=True)


if __name__ == "__main__":
    main()
