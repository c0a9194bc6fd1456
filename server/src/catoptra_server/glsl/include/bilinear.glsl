// Provides vec3 bilinear(picture, px), sample_bilinear_at_offset(picture, pixel, aside_px): light between.
// Twin: catoptra_server.effects.kernels.resampling.bilinear, sample_bilinear_at_offset.

// Pixels' middles are at +0.5. Beyond the border the last pixel's light goes on. What is aside of a pixel's middle is told as
// that, since a place in a wide picture would have lost the last bits of it.
vec3 sample_bilinear_at_offset(sampler2D picture, ivec2 pixel, vec2 aside_px)
{
    ivec2 last = textureSize(picture, 0) - 1;
    vec2 whole = floor(aside_px);
    vec2 share = aside_px - whole;
    ivec2 low = clamp(pixel + ivec2(whole), ivec2(0), last);
    ivec2 high = clamp(pixel + ivec2(whole) + 1, ivec2(0), last);
    vec3 above = mix(texelFetch(picture, low, 0).rgb,
                     texelFetch(picture, ivec2(high.x, low.y), 0).rgb, share.x);
    vec3 below = mix(texelFetch(picture, ivec2(low.x, high.y), 0).rgb,
                     texelFetch(picture, high, 0).rgb, share.x);
    return mix(above, below, share.y);
}

vec3 bilinear(sampler2D picture, vec2 px)
{
    vec2 pixel = floor(px);
    return sample_bilinear_at_offset(picture, ivec2(pixel), px - pixel - 0.5);
}
