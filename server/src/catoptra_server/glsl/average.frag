// Provides the mean, in linear light, of SAMPLES x SAMPLES texels of each pixel, sRGB or linear.
// Twin: catoptra_server.world.world_description.srgb_from_linear, of the mean.
#include "include/colour.glsl"
uniform sampler2D linear_image;
out vec4 colour;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * SAMPLES;
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row)
        for (int column = 0; column < SAMPLES; ++column)
            sum += texelFetch(linear_image, corner + ivec2(column, row), 0).rgb;
    vec3 linear = sum / float(SAMPLES * SAMPLES);
#ifndef LINEAR
    linear = srgb_from_linear(linear);
#endif
    colour = vec4(linear, 1.0);
}
