// Provides the summed light of the pixels that share a weight of a kernel symmetric eight ways.
// Twin: catoptra_server.effects.symmetric_kernels.

vec3 light_at(sampler2D picture, ivec2 pixel)
{
    return texelFetch(picture, clamp(pixel, ivec2(0), textureSize(picture, 0) - 1), 0).rgb;
}

vec3 four_ways(sampler2D picture, ivec2 pixel, int i, int j)
{
    vec3 sum = light_at(picture, pixel + ivec2(i, j));
    if (i > 0)
        sum += light_at(picture, pixel + ivec2(-i, j));
    if (j > 0)
        sum += light_at(picture, pixel + ivec2(i, -j));
    if (i > 0 && j > 0)
        sum += light_at(picture, pixel - ivec2(i, j));
    return sum;
}

// The pixels at (+-i, +-j) and (+-j, +-i).
vec3 pair_sum(sampler2D picture, ivec2 pixel, int i, int j)
{
    vec3 sum = four_ways(picture, pixel, i, j);
    return i == j ? sum : sum + four_ways(picture, pixel, j, i);
}
