// Provides the summed light of the pixels that share a weight of a kernel symmetric eight ways.
// Twin: catoptra_server.effects.kernels.symmetric_kernels.

// Light is taken from within this circle; a is how many pixels it is of.
struct Region {
    vec2 centre_px;
    float radius_px;
};

bool is_inside(Region region, ivec2 pixel)
{
    vec2 aside = vec2(pixel) + 0.5 - region.centre_px;
    return dot(aside, aside) < region.radius_px * region.radius_px;
}

vec4 light_at(sampler2D picture, Region region, ivec2 pixel)
{
    pixel = clamp(pixel, ivec2(0), textureSize(picture, 0) - 1);
    return is_inside(region, pixel) ? vec4(texelFetch(picture, pixel, 0).rgb, 1.0) : vec4(0.0);
}

vec4 four_ways(sampler2D picture, Region region, ivec2 pixel, int i, int j)
{
    vec4 sum = light_at(picture, region, pixel + ivec2(i, j));
    if (i > 0)
        sum += light_at(picture, region, pixel + ivec2(-i, j));
    if (j > 0)
        sum += light_at(picture, region, pixel + ivec2(i, -j));
    if (i > 0 && j > 0)
        sum += light_at(picture, region, pixel - ivec2(i, j));
    return sum;
}

// The pixels at (+-i, +-j) and (+-j, +-i).
vec4 pair_sum(sampler2D picture, Region region, ivec2 pixel, int i, int j)
{
    vec4 sum = four_ways(picture, region, pixel, i, j);
    return i == j ? sum : sum + four_ways(picture, region, pixel, j, i);
}
