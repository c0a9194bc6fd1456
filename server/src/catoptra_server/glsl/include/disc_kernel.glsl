// Provides the mean light of the disc around a pixel, by the kernels of a table.
// Twin: catoptra_server.effects.disc_kernel, effects.symmetric_kernels.gathered.
#include "include/symmetric_kernels.glsl"
const float ROWS_PER_PX2 = 64.0;

float row_of(float diameter_px)
{
    return ROWS_PER_PX2 / 16.0 * diameter_px * diameter_px;
}

// weights: a row a variance, a column a pair of distances.
vec3 disc_mean(sampler2D picture, sampler2D weights, ivec2 pixel, float row)
{
    ivec2 size = textureSize(weights, 0);
    row = min(row, float(size.y - 1));
    int below = min(int(row), size.y - 2);
    float share = row - float(below);
    vec3 total = vec3(0.0);
    int pair = 0;
    for (int i = 0; pair < size.x; ++i) {
        for (int j = 0; j <= i; ++j, ++pair) {
            float lower = texelFetch(weights, ivec2(pair, below), 0).r;
            float upper = texelFetch(weights, ivec2(pair, below + 1), 0).r;
            float weight = mix(lower, upper, share);
            if (weight > 0.0)
                total += weight * pair_sum(picture, pixel, i, j);
        }
    }
    return total;
}
