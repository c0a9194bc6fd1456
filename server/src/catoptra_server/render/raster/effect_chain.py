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

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.kernels.noise import QUANTILE_TABLE_SIDE, normal_quantile_table
from catoptra_server.effects.sensor.auto_exposure import LUMINANCE_WEIGHTS, count_mirror_pixels
from catoptra_server.render.raster.passes import AveragePass, Pass
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms, set_sampler
from catoptra_server.render.renderer import LinearImage

UniformValues = npt.NDArray[np.float32] | npt.NDArray[np.uint32]


# What an effect tells is a map if it has so many dimensions.
_MAP_DIMENSIONS = 3
# Texture units: the picture has 0, what each pixel sees 1, maps the next ones.
_RANGE_UNIT, _FIRST_MAP_UNIT = 1, 2
# Light is summed in so many rectangles a side before the sums are read back.
_METER_GRID_SIDE = 16


class EffectChain:
    """The passes of a view's effects and the encoding, from `first`, the target of the mirror."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        effects: tuple[ImageEffect, ...],
        camera: OmniCamera,
        target: moderngl.Framebuffer,
        *,
        ranges: RangeSource | None = None,
    ) -> None:
        self._images = [
            LinearImageTarget(context, camera.width_px, camera.height_px)
            for _ in range(min(len(effects), 1) + 1)
        ]
        self._programs = programs
        self._context = context
        self._ranges = ranges
        steps = [
            self._make_effect_pass(effect, camera, index) for index, effect in enumerate(effects)
        ]
        self._last = self._images[len(effects) % len(self._images)]
        encode = EncodePass(context, programs, self._last.texture, target)
        self.passes: tuple[Pass, ...] = (*steps, encode)

    @property
    def input_target(self) -> moderngl.Framebuffer:
        """Return the target of what comes before the effects."""
        return self._images[0].target

    def _make_effect_pass(self, effect: ImageEffect, camera: OmniCamera, index: int) -> EffectPass:
        source, target = self._images[index % 2], self._images[(index + 1) % 2]
        return EffectPass(
            self._context,
            self._programs,
            effect,
            camera,
            source.texture,
            target.target,
            ranges=self._ranges if effect.needs_range else None,
        )

    def read(self) -> LinearImage:
        """Return the last frame's picture behind all effects."""
        return self._last.read()

    def close(self) -> None:
        """Free the pictures; passes are freed by who draws them."""
        for picture in self._images:
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
        programs: ShaderPrograms,
        effect: ImageEffect,
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
        self._program = programs.get(ProgramSpec("fullscreen_triangle", f"effect_{_shader_name(effect.name)}"))
        self._fullscreen_triangle = context.vertex_array(self._program, [])
        self._meter = LuminanceMeter(context, programs, source)
        self._textures = EffectTextures(context, self._program)
        self._ranges = ranges
        if "normal_quantile_table" in self._program:
            self._textures.set_values(
                "normal_quantile_table",
                normal_quantile_table().reshape(QUANTILE_TABLE_SIDE, QUANTILE_TABLE_SIDE, 1),
            )

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target: every pixel is written, so nothing is cleared."""
        mean_light = partial(self._meter.measure_mean_luminance, self._camera)
        told = self._effect.uniforms(
            self._camera, CaptureContext(camera_state.noise_seed), mean_light
        )
        for name, values in told.items():
            if values.ndim == _MAP_DIMENSIONS:
                self._textures.set_values(name, values)
                continue
            uniform = self._program[name]
            assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
            uniform.write(values.tobytes())
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._source.use(0)
        self._textures.bind()
        if self._ranges is not None:
            set_sampler(self._program, "range_m", _RANGE_UNIT)
            self._ranges.texture.use(_RANGE_UNIT)
        self._fullscreen_triangle.render(vertices=3)

    def close(self) -> None:
        """Free the vertex array, the maps and the meter, where they are."""
        self._fullscreen_triangle.release()
        self._meter.close()
        self._textures.close()


class EffectTextures:
    """The textures of one effect's program, by name; what stays the same is uploaded once."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        self._context = context
        self._program = program
        self._textures: dict[str, tuple[UniformValues, moderngl.Texture]] = {}

    def set_values(self, name: str, values: UniformValues) -> None:
        """Have a name mean (rows, columns, channels) values; the same array is not sent again."""
        held = self._textures.get(name)
        if held is not None and held[0] is values:
            return
        if held is not None:
            held[1].release()
        rows, columns, channels = values.shape
        data = np.ascontiguousarray(values, dtype=np.float32).tobytes()
        texture = self._context.texture((columns, rows), channels, data, dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._textures[name] = (values, texture)

    def bind(self) -> None:
        """Bind all textures for a draw."""
        for unit, (name, (_, texture)) in enumerate(self._textures.items(), _FIRST_MAP_UNIT):
            set_sampler(self._program, name, unit)
            texture.use(unit)

    def close(self) -> None:
        """Free the textures."""
        for _, texture in self._textures.values():
            texture.release()
        self._textures.clear()


class EncodePass:
    """The last pass: linear light to sRGB."""

    name = "encode"

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        image: moderngl.Texture,
        target: moderngl.Framebuffer,
    ) -> None:
        self._average = AveragePass(context, programs, image, 1, target)

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target."""
        self._average.draw(camera_state)

    def close(self) -> None:
        """Free what the pass holds."""
        self._average.close()


class LuminanceMeter:
    """The mean light of a picture on the device; nothing is built before it is asked for."""

    def __init__(
        self, context: moderngl.Context, programs: ShaderPrograms, image: moderngl.Texture
    ) -> None:
        self._context = context
        self._programs = programs
        self._image = image
        self._sums: LinearImageTarget | None = None

    def measure_mean_luminance(self, camera: OmniCamera) -> float:
        """Return the mean luminance of the pixels that see the mirror."""
        if self._sums is None:
            self._sums = LinearImageTarget(self._context, _METER_GRID_SIDE, _METER_GRID_SIDE)
            program = self._programs.get(
                ProgramSpec("fullscreen_triangle", "mean_luminance", (("GRID_SIDE", _METER_GRID_SIDE),))
            )
            self._cover = self._context.vertex_array(program, [])
        self._context.enable_only(moderngl.NOTHING)
        self._sums.target.use()
        self._image.use(0)
        self._cover.render(vertices=3)
        colours = self._sums.read().sum(axis=(0, 1), dtype=np.float64)
        return float(colours @ LUMINANCE_WEIGHTS) / max(count_mirror_pixels(camera), 1)

    def close(self) -> None:
        """Free what was built."""
        if self._sums is not None:
            self._cover.release()
            self._sums.close()


class LinearImageTarget:
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


def _shader_name(name: str) -> str:
    """Return an effect's name as files are called: ShotNoise, shot_noise."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
