"""Shader programs from the files of `glsl/`, compiled at first use.

The loader adds one directive to GLSL: `#include "path"`, a file under `glsl/`. A variant's
definitions follow the version line.
"""

from __future__ import annotations

import re
from importlib.resources import files

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass

_ROOT = files("catoptra_server") / "glsl"
_INCLUDE = re.compile(r'^#include "(?P<path>[\w./]+)"$', re.MULTILINE)

GLSL_VERSION = "#version 330 core"

Definitions = tuple[tuple[str, int], ...]


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


def load_source(path: str, definitions: Definitions = ()) -> str:
    """Full text of a shader: version, definitions, the file with its includes."""
    head = [GLSL_VERSION, *(f"#define {name} {value}" for name, value in definitions)]
    return "\n".join((*head, _load_with_includes(path)))


def _load_with_includes(path: str) -> str:
    """Text of a file in which every include is replaced by the included file."""
    text = (_ROOT / path).read_text(encoding="utf-8")
    # Recursive and without include guards: each include is named once, by the file that calls it.
    return _INCLUDE.sub(lambda line: _load_with_includes(line["path"]), text)
