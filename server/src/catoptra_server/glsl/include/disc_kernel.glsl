// Provides vec3 disc_mean(...): the mean of the disc around a pixel, by the kernels of a table.
// Twin: catoptra_server.effects.kernels.disc_kernel, symmetric_kernels.convolve_symmetric_within.
#include "include/symmetric_kernels.glsl"
const float ROWS_PER_PX2 = 64.0;     // of kernels/disc_kernel

float kernel_row_of_diameter(float diameter_px)
{
    return ROWS_PER_PX2 / 16.0 * diameter_px * diameter_px;
}

// weights: one row per variance, one column per pair of offsets. Weights that fall outside the
// region go to the pixel itself; pixels outside the region do not change.
vec3 disc_mean(sampler2D image, Region region, sampler2D weights, ivec2 pixel, float row)
{
    vec3 centre = texelFetch(image, pixel, 0).rgb;
    if (!is_inside(region, pixel))
        return centre;
    ivec2 size = textureSize(weights, 0);
    row = min(row, float(size.y - 1));
    int below = min(int(row), size.y - 2);
    float fraction = row - float(below);
    vec4 total = vec4(0.0);
    int pair = 0;
    for (int i = 0; pair < size.x; ++i) {
        for (int j = 0; j <= i; ++j, ++pair) {
            float lower = texelFetch(weights, ivec2(pair, below), 0).r;
            float upper = texelFetch(weights, ivec2(pair, below + 1), 0).r;
            float weight = mix(lower, upper, fraction);
            // The table is as wide as its widest kernel: most pixels need a few of its columns.
            if (weight > 0.0)
                total += weight * octant_sum(image, region, pixel, i, j);
        }
    }
    return total.rgb + (1.0 - total.a) * centre;
}
