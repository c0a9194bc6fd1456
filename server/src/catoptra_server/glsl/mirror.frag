// Provides the mirror's image: the mean of SAMPLES x SAMPLES atlas look-ups of each pixel.
// Twin: catoptra_server.render.trace.ray_table.omni_ray_table, then the mean over a pixel's rays.
#include "include/colour.glsl"
uniform sampler2D atlas;
uniform sampler2D lookup_map;        // atlas coordinates of the samples; negative off the mirror
out vec4 colour;

void main()
{
    // Row 0 of the target is the top of the image, and so is row 0 of both textures.
    ivec2 corner = ivec2(gl_FragCoord.xy) * SAMPLES;
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row) {
        for (int column = 0; column < SAMPLES; ++column) {
            vec2 position = texelFetch(lookup_map, corner + ivec2(column, row), 0).xy;
            sum += position.x >= 0.0 ? textureLod(atlas, position, 0.0).rgb : vec3(0.0);
        }
    }
    vec3 linear = sum / float(SAMPLES * SAMPLES);
#ifndef LINEAR
    linear = srgb_from_linear(linear);
#endif
    colour = vec4(linear, 1.0);
}
