// Provides the image convolved with the Airy pattern of each colour.
// Twin: catoptra_server.effects.medium.diffraction.Diffraction.apply.
#include "include/symmetric_kernels.glsl"
uniform sampler2D image;
uniform sampler2D weights;           // one column per pair of offsets
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int pairs = textureSize(weights, 0).x;
    Region everywhere = Region(vec2(0.0), 1e9);
    vec3 total = vec3(0.0);
    int pair = 0;
    for (int i = 0; pair < pairs; ++i)
        for (int j = 0; j <= i; ++j, ++pair)
            total += texelFetch(weights, ivec2(pair, 0), 0).rgb
                   * octant_sum(image, everywhere, pixel, i, j).rgb;
    colour = vec4(total, 1.0);
}
