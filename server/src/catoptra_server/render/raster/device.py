"""An OpenGL context without a window, its shader programs, and the uniforms that passes share.

EGL is loaded by the names of its runtime libraries: the bare names that moderngl looks for by
default exist only with development packages. Programs are compiled at their first use from the
files of `glsl/`. The loader adds one directive to GLSL, `#include "path"` for a file under `glsl/`;
a variant's definitions follow the version line.

Positions have 48 bits: a float32 number and, as another, the remainder of the float64 one. The
shader subtracts the viewpoint from the corners (`glsl/face.vert`), and the difference is as exact
as float32 can hold it anywhere in the world. With one float32 number each, a thing two centimetres
away is displaced by 7 px of a 640 px image, 11 km from the scene's centre. A frame of 60 000
triangles takes 1.05 times as long on llvmpipe.

Clip z is in [0, w], and depth buffers hold float32 numbers (`projection/frustum.py` says why).
moderngl has a call for neither.

The level of a texture on a cube's face follows from the samples of the image, not from the face's
texels: how many texels a sample covers depends on where on the mirror it is. The angles between
samples vary smoothly with the incidence angle, so a polynomial of their logarithms is enough;
`glsl/include/texture_levels.glsl` evaluates it.
"""

from __future__ import annotations

import ctypes
import re
from importlib.resources import files
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt
from numpy.polynomial import Polynomial

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.image_plane import compute_image_scale
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import FogMedium
from catoptra_server.world.world_description import PointLight

EGL_LIBRARY = "libEGL.so.1"
GL_LIBRARY = "libGL.so.1"
# Debian's names; the last one is Mesa's drivers, without which EGL finds no device.
_PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# 3.3 core: the oldest version with integer arithmetic, texelFetch and multisampled textures; Mesa's
# software drivers have it too.
_REQUIRED_VERSION = 330
GLSL_VERSION = "#version 330 core"
_CONTEXT_SETTINGS: dict[str, Any] = {"backend": "egl", "libgl": GL_LIBRARY, "libegl": EGL_LIBRARY}
# Of OpenGL 4.5, which Mesa's drivers have had as an extension since 2014.
_CLIP_CONTROL = "GL_ARB_clip_control"
_GL_LOWER_LEFT, _GL_ZERO_TO_ONE = 0x8CA1, 0x935F
_GL_RENDERBUFFER, _GL_DEPTH_COMPONENT32F = 0x8D41, 0x8CAC
# Names in GL_RENDERER of drivers that render on the processor.
_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software")
_ROOT = files("catoptra_server") / "glsl"
_INCLUDE = re.compile(r'^#include "(?P<path>[\w./]+)"$', re.MULTILINE)
SPLIT_FORMAT = "3f 3f"
"""Buffer format of one split position."""
_NUM_TERMS = 8
"""Coefficients of a polynomial; the bundled mirrors need eight for an error below 1 %."""
Definitions = tuple[tuple[str, int], ...]


class OpenGLMissingError(RendererUnavailableError):
    """OpenGL 3.3 is unavailable; the text names the reason and the packages that bring OpenGL."""

    def __init__(self, reason: str) -> None:
        """Compose the message from a reason: a clause for a log line, kept as `reason`."""
        super().__init__(
            f"the raster renderer cannot run: {reason}. On Debian and Ubuntu install "
            f"{_PACKAGES}, or use the trace renderer, which needs none of them"
        )
        self.reason = reason


def open_device() -> GlDevice:
    """Open a headless OpenGL 3.3 device.

    The context is bound to the calling thread from here on.

    Raises:
        OpenGLMissingError: A library is missing, or EGL offers no OpenGL 3.3 context with clip
            control.
    """
    _require_library(EGL_LIBRARY)
    library = _require_library(GL_LIBRARY)
    try:
        context = moderngl.create_context(
            require=_REQUIRED_VERSION, standalone=True, **_CONTEXT_SETTINGS
        )
    except Exception as error:  # the C extension raises bare Exception, and ValueError for too old
        raise OpenGLMissingError(f"EGL offers no OpenGL 3.3 context ({error})") from error
    if _CLIP_CONTROL not in context.extensions:
        context.release()
        raise OpenGLMissingError(f"its driver has no {_CLIP_CONTROL}")
    library.glClipControl(_GL_LOWER_LEFT, _GL_ZERO_TO_ONE)
    info = context.info
    return GlDevice(context, info["GL_VENDOR"], info["GL_RENDERER"], info["GL_VERSION"])


@dataclass(frozen=True, slots=True, eq=False)
class GlDevice:
    """An OpenGL context and the names of its driver."""

    context: moderngl.Context
    """OpenGL context, bound to one thread."""
    vendor: str
    """GL_VENDOR of the driver."""
    renderer: str
    """GL_RENDERER of the driver."""
    version: str
    """GL_VERSION of the driver."""

    @property
    def is_software(self) -> bool:
        """Whether the driver renders on the processor."""
        return any(name in self.renderer.lower() for name in _SOFTWARE_RENDERERS)

    def __str__(self) -> str:
        return f"{self.renderer}, {self.vendor}, OpenGL {self.version}"

    def close(self) -> None:
        """Free the context with all its resources."""
        self.context.release()


def make_depth_buffer(
    context: moderngl.Context, size: tuple[int, int], samples: int = 0
) -> moderngl.Renderbuffer:
    """Depth buffer of float32 numbers."""
    buffer = context.depth_renderbuffer(size, samples=samples)
    # moderngl's has 24 bits: another store under the same name.
    library = ctypes.CDLL(GL_LIBRARY)
    library.glBindRenderbuffer(_GL_RENDERBUFFER, buffer.glo)
    library.glRenderbufferStorageMultisample(
        _GL_RENDERBUFFER, samples, _GL_DEPTH_COMPONENT32F, *size
    )
    return buffer


def _require_library(library: str) -> ctypes.CDLL:
    """Load a shared library, or raise OpenGLMissingError."""
    try:
        # moderngl reports a missing library as a bare exception without the file's name, so each
        # library is loaded here first.
        return ctypes.CDLL(library)
    except OSError as error:
        raise OpenGLMissingError(f"{library} cannot be loaded ({error})") from error


class ShaderPrograms:
    """The programs of one context, each compiled at its first use."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._programs: dict[ProgramSpec, moderngl.Program] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the compiled programs, in order of compilation."""
        return tuple(str(spec) for spec in self._programs)

    def get(self, spec: ProgramSpec) -> moderngl.Program:
        """Program of a specification, compiled at the first call."""
        if spec not in self._programs:
            self._programs[spec] = self._context.program(
                vertex_shader=load_source(f"{spec.vertex}.vert", spec.definitions),
                fragment_shader=load_source(f"{spec.fragment}.frag", spec.definitions),
            )
        return self._programs[spec]


@dataclass(frozen=True, slots=True)
class ProgramSpec:
    """A program: its two files, without suffix, and its preprocessor definitions."""

    vertex: str
    """Name of the vertex shader's file."""
    fragment: str
    """Name of the fragment shader's file."""
    definitions: Definitions = ()
    """Names and values for the preprocessor, in order."""

    def __str__(self) -> str:
        parts = [self.fragment, *(f"{name}={value}" for name, value in self.definitions)]
        return " ".join(parts)


def load_source(path: str, definitions: Definitions = ()) -> str:
    """Full text of a shader: version, definitions, the file with its includes."""
    head = [GLSL_VERSION, *(f"#define {name} {value}" for name, value in definitions)]
    return "\n".join((*head, _load_with_includes(path)))


def _load_with_includes(path: str) -> str:
    """Text of a file in which every include is replaced by the included file."""
    text = (_ROOT / path).read_text(encoding="utf-8")
    # Recursive and without include guards: each include is named once, by the file that calls it.
    return _INCLUDE.sub(lambda line: _load_with_includes(line["path"]), text)


def set_uniform(program: moderngl.Program, name: str, values: npt.ArrayLike) -> None:
    """Set a float, vector, matrix or array uniform; matrices in column-major order."""
    # moderngl returns attributes and uniforms by one mapping: a shader's change is noticed here.
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
    uniform.write(np.asarray(values, dtype=np.float32).tobytes())


def set_sampler(program: moderngl.Program, name: str, unit: int) -> None:
    """Assign a texture unit to a sampler."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform), f"{name} is no sampler"
    uniform.value = unit


def split_positions(positions: Floats) -> npt.NDArray[np.float32]:
    """(..., 6) float32 parts of (..., 3) positions: rounded values, then the remainders."""
    rounded = positions.astype(np.float32)
    return np.concatenate((rounded, (positions - rounded).astype(np.float32)), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class FrameUniforms:
    """Viewpoint and point lights of one frame."""

    viewpoint: Floats
    """(3,) position in the scene's frame, metres."""
    light_positions: Floats
    """(k, 3) positions of point lights relative to the viewpoint, metres."""
    light_intensities: Floats
    """(k, 3) irradiance at one metre."""

    @classmethod
    def from_viewpoint(
        cls, viewpoint: Floats, *, lights: tuple[PointLight, ...], origin: Floats
    ) -> FrameUniforms:
        """Uniforms of a viewpoint; `origin` is the scene frame's, since lights are in the world."""
        # Differences in float64, before the cast: both positions may be far from the origin.
        offsets = [np.asarray(light.position_m) - origin - viewpoint for light in lights]
        intensities = [light.intensity for light in lights]
        return cls(
            viewpoint,
            np.asarray(offsets).reshape(-1, 3),
            np.asarray(intensities, dtype=np.float64).reshape(-1, 3),
        )

    def apply_to(self, program: moderngl.Program) -> None:
        """Write the uniforms to a program."""
        viewpoint = split_positions(self.viewpoint)
        set_uniform(program, "viewpoint", viewpoint[:3])
        set_uniform(program, "viewpoint_rest", viewpoint[3:])
        # GLSL has no arrays of length zero: programs of a world without point lights lack these
        # uniforms.
        if len(self.light_positions):
            set_uniform(program, "light_positions", self.light_positions)
            set_uniform(program, "light_intensities", self.light_intensities)


def set_fog(program: moderngl.Program, fog: FogMedium | None) -> None:
    """Write the airlight and the extinction per metre, 0 in clear air, to a program."""
    clear = (0.0, 0.0, 0.0, 0.0)
    set_uniform(program, "fog", clear if fog is None else (*fog.airlight, fog.density_per_m))


@dataclass(frozen=True, slots=True, eq=False)
class SampleSpacing:
    """Angles between samples by the cosine of the incidence angle."""

    log_spacing: Floats
    """(8, 2) coefficients, lowest power first: logarithms of the radial and tangential angles."""
    cosine_limits: tuple[float, float]
    """Smallest and largest cosine in the image, where the polynomials' variable is -1 and 1."""

    @property
    def least_rad(self) -> float:
        """Smallest angle of all."""
        return float(self.at(np.linspace(*self.cosine_limits, 64)).min())

    def at(self, cosine: Floats) -> Floats:
        """(n, 2) radial and tangential angles between samples, rad; float64 twin of the shader."""
        low, high = self.cosine_limits
        x = np.clip((2.0 * cosine - low - high) / (high - low), -1.0, 1.0)
        powers = x[:, None] ** np.arange(_NUM_TERMS)
        return np.exp(powers @ self.log_spacing)


def fit_spacing(camera: OmniCamera, samples: int) -> SampleSpacing:
    """Spacing of an image with `samples` along a pixel's side."""
    scale = compute_image_scale(camera)
    cosine = (1.0 - scale.t) * (1.0 + scale.t) / (1.0 + scale.t * scale.t)
    limits = (float(cosine.min()), float(cosine.max()))
    # Rings may crowd at one end of the cosines, as beside the antipode of a wide rim: even steps.
    even = np.linspace(*limits, 64)
    columns = [
        Polynomial.fit(even, np.interp(even, cosine[::-1], -np.log(row[::-1])), _NUM_TERMS - 1).coef
        for row in (samples * scale.radial, samples * scale.tangential)
    ]
    return SampleSpacing(np.stack(columns, axis=-1), limits)


def set_spacing(program: moderngl.Program, spacing: SampleSpacing | None, axis: Floats) -> None:
    """Write the uniforms of a program that reads textures; no other program is changed.

    Args:
        spacing: None where the samples are the fragments themselves.
        axis: (3,) axis of the mirror, world axes.
    """
    if program.get("has_spacing", None) is None:
        return
    set_uniform(program, "has_spacing", float(spacing is not None))
    if spacing is not None:
        set_uniform(program, "log_spacing", spacing.log_spacing)
        set_uniform(program, "cosine_limits", spacing.cosine_limits)
        set_uniform(program, "spacing_axis", axis)
