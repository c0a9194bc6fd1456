"""Effects as passes: each reads the linear picture of the one before, the last one is encoded.

Knows no effect by name: a shader is found by the effect's name, and told what the effect says.
However many there are, two textures are enough; with one effect or none, what is not needed does
not exist.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.auto_exposure import LUMINANCE, mirror_pixels
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.shared.noise import TABLE_SIDE, normal_table
from catoptra_server.render.raster.passes import AveragePass, Pass
from catoptra_server.render.raster.programs import Programs, ProgramSpec, set_sampler
from catoptra_server.render.renderer import Exposure, LinearImage

Values = npt.NDArray[np.float32] | npt.NDArray[np.uint32]


# What an effect tells is a map if it has so many dimensions.
_MAP_DIMENSIONS = 3
# Texture units: the picture has 0, what each pixel sees 1, maps the next ones.
_RANGE_UNIT, _FIRST_MAP_UNIT = 1, 2
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
        *,
        ranges: RangeSource | None = None,
    ) -> None:
        self._pictures = [
            LinearPicture(context, camera.width_px, camera.height_px)
            for _ in range(min(len(effects), 1) + 1)
        ]
        self._programs = programs
        self._context = context
        self._ranges = ranges
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
            self._context,
            self._programs,
            effect,
            camera,
            source.texture,
            target.target,
            ranges=self._ranges if effect.uses_range else None,
        )

    def read(self) -> LinearImage:
        """Return the last frame's picture behind all effects."""
        return self._last.read()

    def close(self) -> None:
        """Free the pictures; passes are freed by who draws them."""
        for picture in self._pictures:
            picture.close()


class RangeSource(Protocol):
    """What finds out how far away is what each pixel sees, before the effects run."""

    @property
    def texture(self) -> moderngl.Texture:
        """Return the picture of ranges."""


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
        *,
        ranges: RangeSource | None = None,
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
        self._maps = Maps(context, self._program)
        self._ranges = ranges
        if "normal_table" in self._program:
            self._maps.use("normal_table", normal_table().reshape(TABLE_SIDE, TABLE_SIDE, 1))

    def draw(self, exposure: Exposure) -> None:
        """Fill the target: every pixel is written, so nothing is cleared."""
        mean_light = partial(self._meter.mean, self._camera)
        told = self._effect.uniforms(self._camera, Capture(exposure.key), mean_light)
        for name, values in told.items():
            if values.ndim == _MAP_DIMENSIONS:
                self._maps.use(name, values)
                continue
            uniform = self._program[name]
            assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
            uniform.write(values.tobytes())
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._source.use(0)
        self._maps.bind()
        if self._ranges is not None:
            set_sampler(self._program, "range_m", _RANGE_UNIT)
            self._ranges.texture.use(_RANGE_UNIT)
        self._cover.render(vertices=3)

    def close(self) -> None:
        """Free the vertex array, the maps and the meter, where they are."""
        self._cover.release()
        self._meter.close()
        self._maps.close()


class Maps:
    """The textures of one effect's program, by name; what stays the same is uploaded once."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        self._context = context
        self._program = program
        self._held: dict[str, tuple[Values, moderngl.Texture]] = {}

    def use(self, name: str, values: Values) -> None:
        """Have a name mean (rows, columns, channels) values; the same array is not sent again."""
        held = self._held.get(name)
        if held is not None and held[0] is values:
            return
        if held is not None:
            held[1].release()
        rows, columns, channels = values.shape
        data = np.ascontiguousarray(values, dtype=np.float32).tobytes()
        texture = self._context.texture((columns, rows), channels, data, dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._held[name] = (values, texture)

    def bind(self) -> None:
        """Bind all textures for a draw."""
        for unit, (name, (_, texture)) in enumerate(self._held.items(), _FIRST_MAP_UNIT):
            set_sampler(self._program, name, unit)
            texture.use(unit)

    def close(self) -> None:
        """Free the textures."""
        for _, texture in self._held.values():
            texture.release()
        self._held.clear()


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


def _file_name(name: str) -> str:
    """Return an effect's name as files are called: ShotNoise, shot_noise."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
