// Provides the mirror's picture by its own law in SAMPLES x SAMPLES places of each pixel, sRGB.
// Twin: catoptra_server.render.trace.samples.omni_samples, then the mean of what is met there.
#include "include/omni_camera.glsl"
#include "include/atlas.glsl"
#include "include/colour.glsl"
out vec4 colour;

void main()
{
    // Row 0 of the target is the top of the picture, so a fragment's place is its pixel (u, v).
    vec2 corner = gl_FragCoord.xy - 0.5;
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row) {
        for (int column = 0; column < SAMPLES; ++column) {
            vec2 pixel = corner + (vec2(column, row) + 0.5) / float(SAMPLES);
            vec3 direction;
            bool on_mirror = direction_from_pixel(pixel, direction);
            sum += on_mirror ? radiance_seen(direction) : vec3(0.0);
        }
    }
    colour = vec4(srgb_from_linear(sum / float(SAMPLES * SAMPLES)), 1.0);
}
