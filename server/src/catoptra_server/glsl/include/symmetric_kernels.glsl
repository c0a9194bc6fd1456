// Provides vec4 octant_sum(...): the sum over the pixels that share a symmetric kernel's weight.
// Twin: catoptra_server.effects.kernels.symmetric_kernels.

// Only pixels within this circle contribute; alpha counts them.
struct Region {
    vec2 centre_px;
    float radius_px;
};

bool is_inside(Region region, ivec2 pixel)
{
    vec2 offset = vec2(pixel) + 0.5 - region.centre_px;
    return dot(offset, offset) < region.radius_px * region.radius_px;
}

vec4 radiance_at(sampler2D image, Region region, ivec2 pixel)
{
    pixel = clamp(pixel, ivec2(0), textureSize(image, 0) - 1);
    return is_inside(region, pixel) ? vec4(texelFetch(image, pixel, 0).rgb, 1.0) : vec4(0.0);
}

// The pixels at (+-i, +-j).
vec4 quadrant_sum(sampler2D image, Region region, ivec2 pixel, int i, int j)
{
    vec4 sum = radiance_at(image, region, pixel + ivec2(i, j));
    if (i > 0)
        sum += radiance_at(image, region, pixel + ivec2(-i, j));
    if (j > 0)
        sum += radiance_at(image, region, pixel + ivec2(i, -j));
    if (i > 0 && j > 0)
        sum += radiance_at(image, region, pixel - ivec2(i, j));
    return sum;
}

// The pixels at (+-i, +-j) and (+-j, +-i).
vec4 octant_sum(sampler2D image, Region region, ivec2 pixel, int i, int j)
{
    vec4 sum = quadrant_sum(image, region, pixel, i, j);
    return i == j ? sum : sum + quadrant_sum(image, region, pixel, j, i);
}
