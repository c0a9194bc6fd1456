// Provides the mean, in linear light, of the SAMPLES x SAMPLES texels of each pixel, sRGB.
// Twin: catoptra_server.scene.colour.srgb_from_linear, of the mean.
#include "include/colour.glsl"
uniform sampler2D linear_picture;
out vec4 colour;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * SAMPLES;
    vec3 sum = vec3(0.0);
    for (int row = 0; row < SAMPLES; ++row)
        for (int column = 0; column < SAMPLES; ++column)
            sum += texelFetch(linear_picture, corner + ivec2(column, row), 0).rgb;
    colour = vec4(srgb_from_linear(sum / float(SAMPLES * SAMPLES)), 1.0);
}
