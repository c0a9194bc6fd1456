"""Cost of the mirror pass: camera model in the shader or looked up, and two encodings to sRGB.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/mirror_pass.py

Prints, for the mirror pass of a 640 x 640 px image, the median milliseconds of wall time and of all
processors, rendered in turns, and the ratio of the latter to the camera model in the shader with
the power function of sRGB's definition. Decisions: render/projection/atlas.py, and the square
roots in glsl/include/colour.glsl.
"""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np
from interleaved import median_ms
from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.projection.atlas import compute_lookup_map, pack_atlas
from catoptra_server.render.raster import RasterRenderer, open_device
from catoptra_server.render.raster.device import GLSL_VERSION, load_source, set_uniform
from catoptra_server.render.raster.mirror_pass import rim_polygon
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.scene_mesh import build_scene

ROUNDS = 40

# The camera model in t = tan(theta / 2), as in optics/mirrors/hyperbolic.py, then face and texel.
CAMERA_MODEL = """
uniform sampler2D atlas;
uniform vec2 centre_px;
uniform float inverse_h, kappa_s, inverse_s2, rim_t;
vec3 light(ivec2 sample_at)
{
    vec2 ratio = ((vec2(sample_at) + 0.5) / float(SAMPLES) - centre_px) * inverse_h;
    float squared = dot(ratio, ratio);
    float gain = 1.0 / (kappa_s * (1.0 + sqrt(1.0 + squared * inverse_s2)));
    float t = gain * sqrt(squared);
    vec3 direction = vec3(-2.0 * gain * ratio.yx, (1.0 - t) * (1.0 + t));
    vec3 radiance = textureLod(atlas, atlas_coordinates(direction), 0.0).rgb;
    return t <= rim_t ? radiance : vec3(0.0);
}
"""
LOOKUP_MAP = """
uniform sampler2D atlas, lookup_map;
vec3 light(ivec2 sample_at)
{
    vec2 coordinates = texelFetch(lookup_map, sample_at, 0).xy;
    return coordinates.x >= 0.0 ? textureLod(atlas, coordinates, 0.0).rgb : vec3(0.0);
}
"""
POWER = """
vec3 encoded(vec3 light)
{
    vec3 curved = 1.055 * pow(max(light, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(curved, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
}
"""
ROOTS = "vec3 encoded(vec3 light) { return srgb_from_linear(light); }\n"
MAIN = """
out vec4 colour;
void main()
{
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row)
        for (int column = 0; column < SAMPLES; ++column)
            sum += light(ivec2(gl_FragCoord.xy) * SAMPLES + ivec2(column, row));
    colour = vec4(encoded(clamp(sum / float(SAMPLES * SAMPLES), 0.0, 1.0)), 1.0);
}
"""


def fragment(samples: int, light: str, encoded: str) -> str:
    head = f"{GLSL_VERSION}\n#define SAMPLES {samples}\n#define NUM_FACES 5\n"
    includes = ["include/colour.glsl", *(["include/atlas.glsl"] if light is CAMERA_MODEL else [])]
    texts = [load_source(path).removeprefix(GLSL_VERSION) for path in includes]
    return "\n".join((head, *texts, light, encoded, MAIN))


def set_camera_model(program: moderngl.Program) -> None:
    camera = make_camera()
    mirror = camera.mirror
    assert isinstance(mirror, HyperbolicMirror)
    set_uniform(program, "centre_px", camera.centre_px)
    set_uniform(program, "inverse_h", 1.0 / camera.scale_px)
    set_uniform(program, "kappa_s", mirror.kappa * mirror.s)
    set_uniform(program, "inverse_s2", 1.0 / mirror.s**2)
    set_uniform(program, "rim_t", camera.rim_t)


def make_renderer(samples: int, light: str, encoded: str) -> Callable[[], object]:
    """A function that renders the pass from faces of the field, on a device of its own."""
    world = make_worlds()["field"]
    device = open_device()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    plan = plan_from_settings(
        RenderSettings(PerPixel(), samples),
        make_camera(),
        kind=RendererKind.RASTER,
        reason="measured",
    )
    view = renderer.prepare(make_camera(), plan)
    view.render(CAMERA_STATE)
    context = device.context
    atlas = pack_atlas(plan.face_regions, guard_texels=2, max_texels=16384)
    faces = view._faces.texture
    with context:
        program = context.program(
            vertex_shader=load_source("mirror.vert"),
            fragment_shader=fragment(samples, light, encoded),
        )
        corners = context.buffer(rim_polygon(make_camera()).astype(np.float32).tobytes())
        vertices = context.vertex_array(program, [(corners, "2f", "position")])
        target = context.framebuffer([context.renderbuffer((640, 640), 3)])
        if light is CAMERA_MODEL:
            set_camera_model(program)
            set_uniform(program, "face_texel_transform", atlas.texel_transforms())
            set_uniform(program, "atlas_texel", (1.0 / atlas.width, 1.0 / atlas.height))
        else:
            size = (640 * samples, 640 * samples)
            table = compute_lookup_map(make_camera(), atlas, samples)
            lookup_texture = context.texture(size, 2, table, dtype="f4")
            lookup_texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            program["lookup_map"] = 1

    def draw() -> None:
        with context:
            faces.use(0)
            if light is not CAMERA_MODEL:
                lookup_texture.use(1)
            context.enable_only(moderngl.NOTHING)
            target.use()
            target.clear()
            vertices.render(moderngl.TRIANGLE_FAN)
            context.finish()

    return draw


def main() -> None:
    for samples in (1, 2, 3):
        draws = {
            "model in the shader, power": make_renderer(samples, CAMERA_MODEL, POWER),
            "model in the shader, roots": make_renderer(samples, CAMERA_MODEL, ROOTS),
            "looked up, power": make_renderer(samples, LOOKUP_MAP, POWER),
            "looked up, roots": make_renderer(samples, LOOKUP_MAP, ROOTS),
        }
        times = median_ms(draws, rounds=ROUNDS)
        first = next(iter(times.values()))[1]
        for name, (wall, processors) in times.items():
            ratio = processors / first
            print(f"  {samples}^2 {name:<30}{wall:8.2f}{processors:8.2f}{ratio:8.2f}")


if __name__ == "__main__":
    main()
