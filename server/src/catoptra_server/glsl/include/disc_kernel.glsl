// Provides the mean light of the disc around a pixel, by the kernels of a table.
// Twin: catoptra_server.effects.kernels.disc_kernel, effects.symmetric_kernels.gathered_within.
#include "include/symmetric_kernels.glsl"
const float ROWS_PER_PX2 = 64.0;

float row_of(float diameter_px)
{
    return ROWS_PER_PX2 / 16.0 * diameter_px * diameter_px;
}

// weights: a row a variance, a column a pair of distances. What lies outside the region is taken
// from the pixel itself; outside nothing changes.
vec3 disc_mean(sampler2D picture, Region region, sampler2D weights, ivec2 pixel, float row)
{
    vec3 own = texelFetch(picture, pixel, 0).rgb;
    if (!is_inside(region, pixel))
        return own;
    ivec2 size = textureSize(weights, 0);
    row = min(row, float(size.y - 1));
    int below = min(int(row), size.y - 2);
    float share = row - float(below);
    vec4 total = vec4(0.0);
    int pair = 0;
    for (int i = 0; pair < size.x; ++i) {
        for (int j = 0; j <= i; ++j, ++pair) {
            float lower = texelFetch(weights, ivec2(pair, below), 0).r;
            float upper = texelFetch(weights, ivec2(pair, below + 1), 0).r;
            float weight = mix(lower, upper, share);
            if (weight > 0.0)
                total += weight * pair_sum(picture, region, pixel, i, j);
        }
    }
    return total.rgb + (1.0 - total.a) * own;
}
