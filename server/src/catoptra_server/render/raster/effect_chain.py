"""Effects as passes: each reads the linear picture of the one before, the last one is encoded.

Knows no effect by name: a shader is found by the effect's name, and told what the effect says.
However many there are, two textures are enough; with one effect or none, what is not needed does
not exist.
"""

from __future__ import annotations

import re
from functools import partial

import moderngl
import numpy as np

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.auto_exposure import LUMINANCE, mirror_pixels
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.noise import TABLE_SIDE, normal_table
from catoptra_server.render.raster.passes import AveragePass, Pass
from catoptra_server.render.raster.programs import Programs, ProgramSpec
from catoptra_server.render.renderer import Exposure, LinearImage

# Light is summed in so many rectangles a side before the sums are read back.
_METER_GRID = 16


class EffectChain:
    """The passes of a view's effects and the encoding, from `first`, the target of the mirror."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        effects: tuple[Effect, ...],
        camera: OmniCamera,
        target: moderngl.Framebuffer,
    ) -> None:
        self._pictures = [
            LinearPicture(context, camera.width_px, camera.height_px)
            for _ in range(min(len(effects), 1) + 1)
        ]
        self._programs = programs
        self._context = context
        steps = [self._step(effect, camera, index) for index, effect in enumerate(effects)]
        self._last = self._pictures[len(effects) % len(self._pictures)]
        encode = EncodePass(context, programs, self._last.texture, target)
        self.passes: tuple[Pass, ...] = (*steps, encode)

    @property
    def first(self) -> moderngl.Framebuffer:
        """Return the target of what comes before the effects."""
        return self._pictures[0].target

    def _step(self, effect: Effect, camera: OmniCamera, index: int) -> EffectPass:
        source, target = self._pictures[index % 2], self._pictures[(index + 1) % 2]
        return EffectPass(
            self._context, self._programs, effect, camera, source.texture, target.target
        )

    def read(self) -> LinearImage:
        """Return the last frame's picture behind all effects."""
        return self._last.read()

    def close(self) -> None:
        """Free the pictures; passes are freed by who draws them."""
        for picture in self._pictures:
            picture.close()


class EffectPass:
    """One effect, from a picture to another one; its stage is called as the effect is."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        effect: Effect,
        camera: OmniCamera,
        source: moderngl.Texture,
        target: moderngl.Framebuffer,
    ) -> None:
        self.name = effect.name
        self._context = context
        self._effect = effect
        self._camera = camera
        self._source = source
        self._target = target
        self._program = programs.get(ProgramSpec("cover", f"effect_{_file_name(effect.name)}"))
        self._cover = context.vertex_array(self._program, [])
        self._meter = Meter(context, programs, source)
        self._normals: moderngl.Texture | None = None
        if "normal_table" in self._program:
            self._normals = _normal_texture(context)
            self._program["normal_table"] = 1

    def draw(self, exposure: Exposure) -> None:
        """Fill the target: every pixel is written, so nothing is cleared."""
        mean_light = partial(self._meter.mean, self._camera)
        told = self._effect.uniforms(self._camera, exposure.key, mean_light)
        for name, values in told.items():
            uniform = self._program[name]
            assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
            uniform.write(values.tobytes())
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._source.use(0)
        if self._normals is not None:
            self._normals.use(1)
        self._cover.render(vertices=3)

    def close(self) -> None:
        """Free the vertex array, the table of normal numbers and the meter, where they are."""
        self._cover.release()
        self._meter.close()
        if self._normals is not None:
            self._normals.release()


class EncodePass:
    """The last pass: linear light to sRGB."""

    name = "encode"

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        picture: moderngl.Texture,
        target: moderngl.Framebuffer,
    ) -> None:
        self._average = AveragePass(context, programs, picture, 1, target)

    def draw(self, exposure: Exposure) -> None:
        """Fill the target."""
        self._average.draw(exposure)

    def close(self) -> None:
        """Free what the pass holds."""
        self._average.close()


class Meter:
    """The mean light of a picture on the device; nothing is built before it is asked for."""

    def __init__(
        self, context: moderngl.Context, programs: Programs, picture: moderngl.Texture
    ) -> None:
        self._context = context
        self._programs = programs
        self._picture = picture
        self._sums: LinearPicture | None = None

    def mean(self, camera: OmniCamera) -> float:
        """Return the mean luminance of the pixels that see the mirror."""
        if self._sums is None:
            self._sums = LinearPicture(self._context, _METER_GRID, _METER_GRID)
            program = self._programs.get(ProgramSpec("cover", "meter", (("GRID", _METER_GRID),)))
            self._cover = self._context.vertex_array(program, [])
        self._context.enable_only(moderngl.NOTHING)
        self._sums.target.use()
        self._picture.use(0)
        self._cover.render(vertices=3)
        colours = self._sums.read().sum(axis=(0, 1), dtype=np.float64)
        return float(colours @ LUMINANCE) / max(mirror_pixels(camera), 1)

    def close(self) -> None:
        """Free what was built."""
        if self._sums is not None:
            self._cover.release()
            self._sums.close()


class LinearPicture:
    """A float32 picture on the device: a texture to read, a target to draw into."""

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self.texture = context.texture((width, height), 4, dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.target = context.framebuffer([self.texture])

    def read(self) -> LinearImage:
        """Return the picture as a (h, w, 3) array of its own."""
        width, height = self.texture.size
        data = self.target.read(components=3, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width, 3)

    def close(self) -> None:
        """Free texture and target."""
        self.target.release()
        self.texture.release()


def _normal_texture(context: moderngl.Context) -> moderngl.Texture:
    table = context.texture((TABLE_SIDE, TABLE_SIDE), 1, normal_table().tobytes(), dtype="f4")
    table.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return table


def _file_name(name: str) -> str:
    """Return an effect's name as files are called: ShotNoise, shot_noise."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
