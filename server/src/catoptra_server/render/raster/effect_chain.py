"""Effects as passes: each reads the linear image of the pass before, the last image is encoded.

No effect is known by name: a shader file is found by the effect's name and receives the uniforms
that the effect computes. Two textures are enough for any number of effects; with one effect or
none, unneeded resources do not exist.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.effects.kernels.noise import QUANTILE_TABLE_SIDE, normal_quantile_table
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.luminance_meter import LuminanceMeter
from catoptra_server.render.raster.passes import AveragePass, Pass, image_bytes
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms, set_sampler
from catoptra_server.render.renderer import LinearImage

UniformValues = npt.NDArray[np.float32] | npt.NDArray[np.uint32]


# A value of an effect with this number of dimensions is a texture, any other a uniform.
_TEXTURE_DIMENSIONS = 3
# Texture units: 0 is the image, 1 the ranges of pixels, textures of the effect follow.
_RANGE_UNIT, _FIRST_TEXTURE_UNIT = 1, 2


class EffectChain:
    """The passes of a view's effects and of the encoding.

    `input_target` is the target of the passes before the effects.
    """

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        effects: tuple[ImageEffect, ...],
        camera: RadialCamera,
        target: moderngl.Framebuffer,
        *,
        ranges: RangeSource | None = None,
    ) -> None:
        """Build one pass per effect between alternating images, and the encoding pass.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            effects: Effects in optical order.
            camera: Camera whose image the effects change.
            target: Target of the encoded image.
            ranges: Ranges of all pixels, for effects that use them.
        """
        self._images = [
            LinearImageTarget(context, camera.width_px, camera.height_px)
            # Each pass reads one image and writes the other; without effects a single image is
            # read by the encoding alone.
            for _ in range(min(len(effects), 1) + 1)
        ]
        self._programs = programs
        self._context = context
        self._ranges = ranges
        effect_passes = [
            self._make_effect_pass(effect, camera, index) for index, effect in enumerate(effects)
        ]
        self._last = self._images[len(effects) % len(self._images)]
        encode = EncodePass(context, programs, self._last.texture, target)
        self.passes: tuple[Pass, ...] = (*effect_passes, encode)

    @property
    def input_target(self) -> moderngl.Framebuffer:
        """Target of the passes before the effects."""
        return self._images[0].target

    @property
    def memory_bytes(self) -> int:
        """Size of the images between the passes."""
        return sum(image.memory_bytes for image in self._images)

    def _make_effect_pass(
        self, effect: ImageEffect, camera: RadialCamera, index: int
    ) -> EffectPass:
        """Pass of the effect at an index of the chain."""
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
        """Read the last frame's linear image, after all effects."""
        return self._last.read()

    def close(self) -> None:
        """Free the images; passes are freed with their sequence."""
        for image in self._images:
            image.close()


class RangeSource(Protocol):
    """A pass that measures the range of each pixel before the effects run."""

    @property
    def texture(self) -> moderngl.Texture:
        """Image of ranges, metres."""


class EffectPass:
    """One effect, from one image to another; the stage has the effect's name."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        effect: ImageEffect,
        camera: RadialCamera,
        source: moderngl.Texture,
        target: moderngl.Framebuffer,
        *,
        ranges: RangeSource | None = None,
    ) -> None:
        """Load the effect's program and the quantile table that noise needs."""
        self.name = effect.name
        self._context = context
        self._effect = effect
        self._camera = camera
        self._source = source
        self._target = target
        self._program = programs.get(
            ProgramSpec("fullscreen_triangle", f"effect_{_shader_name(effect.name)}")
        )
        self._fullscreen_triangle = context.vertex_array(self._program, [])
        self._meter = LuminanceMeter(context, programs, source)
        self._textures = EffectTextures(context, self._program)
        self._ranges = ranges
        # Only programs that include noise.glsl have this sampler: an effect without noise uploads
        # no table.
        if "normal_quantile_table" in self._program:
            self._textures.set_values(
                "normal_quantile_table",
                normal_quantile_table().reshape(QUANTILE_TABLE_SIDE, QUANTILE_TABLE_SIDE, 1),
            )

    @property
    def memory_bytes(self) -> int:
        """Size of the effect's textures."""
        return self._textures.memory_bytes

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target: every pixel is written, so nothing is cleared."""
        # Passed as a function: auto-exposure and dust call it, and only that call builds the meter.
        measure_mean = partial(self._meter.measure_mean_luminance, self._camera)
        uniforms = self._effect.uniforms(
            self._camera, CaptureContext(camera_state.noise_seed), measure_mean
        )
        for name, values in uniforms.items():
            if values.ndim == _TEXTURE_DIMENSIONS:
                self._textures.set_values(name, values)
                continue
            uniform = self._program[name]
            assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
            # Effects give arrays in the layout and type of their uniforms; moderngl rejects any
            # other size.
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
        """Free the vertex array, the textures and the luminance meter."""
        self._fullscreen_triangle.release()
        self._meter.close()
        self._textures.close()


class EffectTextures:
    """The textures of one effect's program, by sampler name; unchanged arrays are uploaded once."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        self._context = context
        self._program = program
        self._textures: dict[str, tuple[UniformValues, moderngl.Texture]] = {}

    @property
    def memory_bytes(self) -> int:
        """Size of all textures."""
        return image_bytes(*(texture for _, texture in self._textures.values()))

    def set_values(self, name: str, values: UniformValues) -> None:
        """Assign (rows, columns, channels) values to a sampler, once per array."""
        current = self._textures.get(name)
        # Identity, not equality: effects cache their arrays, and a comparison would read megabytes
        # in every frame.
        if current is not None and current[0] is values:
            return
        if current is not None:
            current[1].release()
        rows, columns, channels = values.shape
        data = np.ascontiguousarray(values, dtype=np.float32).tobytes()
        texture = self._context.texture((columns, rows), channels, data, dtype="f4")
        # Shaders address texels by index: a sampled position would depend on float32 coordinates.
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._textures[name] = (values, texture)

    def bind(self) -> None:
        """Bind all textures for a draw call."""
        for unit, (name, (_, texture)) in enumerate(self._textures.items(), _FIRST_TEXTURE_UNIT):
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
    memory_bytes = 0

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
        """Free the pass's resources."""
        self._average.close()


def _shader_name(name: str) -> str:
    """File name of an effect's shader: ShotNoise becomes shot_noise."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
