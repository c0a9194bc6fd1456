// Provides the mirror's picture from the places that SAMPLES x SAMPLES samples a pixel look up.
// Twin: catoptra_server.render.trace.ray_samples.omni_samples, then the mean of what is met there.
#include "include/colour.glsl"
uniform sampler2D atlas;
uniform sampler2D places;            // of the samples in the atlas; negative where no mirror is
out vec4 colour;

void main()
{
    // Row 0 of the target is the top of the picture, and so are those of both textures.
    ivec2 corner = ivec2(gl_FragCoord.xy) * SAMPLES;
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row) {
        for (int column = 0; column < SAMPLES; ++column) {
            vec2 place = texelFetch(places, corner + ivec2(column, row), 0).xy;
            sum += place.x >= 0.0 ? textureLod(atlas, place, 0.0).rgb : vec3(0.0);
        }
    }
    vec3 linear = sum / float(SAMPLES * SAMPLES);
#ifndef LINEAR
    linear = srgb_from_linear(linear);
#endif
    colour = vec4(linear, 1.0);
}
