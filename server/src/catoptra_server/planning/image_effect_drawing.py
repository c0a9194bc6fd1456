"""Choice of what draws raster's image effects: the native kernel on software OpenGL.

On the processor the kernel's stages are several times as fast as the same formulas in shaders,
leave out what nobody sees by cells, and measure each effect's largest change; an exposure is read
back in less than a millisecond. On a graphics processor the shaders are faster than the way back.
Measured in tests/measurements/effect_frame_times.py.
"""

from __future__ import annotations

from catoptra_server.processor_count import count_processors
from catoptra_server.render.image_effect_choice import ImageEffectChoice
from catoptra_server.render.renderer_kind import AUTO


def choose_image_effects(
    *, is_software: bool, threads: int = 0, instruction_set: str = AUTO
) -> ImageEffectChoice:
    """Drawing of image effects for an OpenGL device.

    Args:
        is_software: Whether the device renders on the processor.
        threads: Threads of the kernel; 0: one for each processor.
        instruction_set: Instruction set of the kernel.
    """
    if not is_software:
        return ImageEffectChoice(None, "OpenGL on a graphics processor")
    # Loaded where it is needed: raster serves without the kernel, and without Embree.
    from catoptra_server.render.trace.kernel.kernel_image_changer import open_image_changer
    from catoptra_server.render.trace.kernel.library_files import KernelUnavailableError

    try:
        changer = open_image_changer(threads or count_processors(), instruction_set)
    except KernelUnavailableError as error:
        return ImageEffectChoice(None, error.reason)
    return ImageEffectChoice(changer, "OpenGL on the processor", changer.close)
