"""Shader programs out of the files of `glsl/`, compiled when first asked for.

The loader knows one kind of line beside GLSL: `#include "path"`, a file under `glsl/`. What a
variant switches on is defined under the version line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files

import moderngl
import numpy as np
import numpy.typing as npt

_ROOT = files("catoptra_server") / "glsl"
_INCLUDE = re.compile(r'^#include "(?P<path>[\w./]+)"$', re.MULTILINE)

GLSL_VERSION = "#version 330 core"

Definitions = tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class ProgramSpec:
    """A program: its two files without suffix, and what it defines."""

    vertex: str
    fragment: str
    definitions: Definitions = ()

    def __str__(self) -> str:
        parts = [self.fragment, *(f"{name}={value}" for name, value in self.definitions)]
        return " ".join(parts)


class ShaderPrograms:
    """The programs of one context. What is not asked for is not built."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._programs: dict[ProgramSpec, moderngl.Program] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the programs that were built, in order."""
        return tuple(str(spec) for spec in self._programs)

    def get(self, spec: ProgramSpec) -> moderngl.Program:
        """Return the program of a specification, compiled the first time."""
        if spec not in self._programs:
            self._programs[spec] = self._context.program(
                vertex_shader=load_source(f"{spec.vertex}.vert", spec.definitions),
                fragment_shader=load_source(f"{spec.fragment}.frag", spec.definitions),
            )
        return self._programs[spec]


def set_uniform(program: moderngl.Program, name: str, values: npt.ArrayLike) -> None:
    """Set a float, vector, matrix or array uniform; matrices column by column, as OpenGL counts."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform), f"{name} is no uniform"
    uniform.write(np.asarray(values, dtype=np.float32).tobytes())


def set_sampler(program: moderngl.Program, name: str, unit: int) -> None:
    """Have a sampler read the texture of a unit."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform), f"{name} is no sampler"
    uniform.value = unit


def load_source(path: str, definitions: Definitions = ()) -> str:
    """Return the full text of a shader: version, definitions, the file with its includes."""
    head = [GLSL_VERSION, *(f"#define {name} {value}" for name, value in definitions)]
    return "\n".join((*head, _load_with_includes(path)))


def _load_with_includes(path: str) -> str:
    text = (_ROOT / path).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda line: _load_with_includes(line["path"]), text)
