// Provides vec3 sample_bilinear(image, px), sample_bilinear_at_offset(image, pixel, offset_px).
// Twin: catoptra_server.effects.kernels.resampling.sample_bilinear, sample_bilinear_at_offset.

// Pixel centres are at +0.5; outside the image the border pixel is repeated. Pixel and offset stay
// apart, since their sum would lose the last bits of the offset in a wide image.
vec3 sample_bilinear_at_offset(sampler2D image, ivec2 pixel, vec2 offset_px)
{
    ivec2 last = textureSize(image, 0) - 1;
    vec2 whole = floor(offset_px);
    vec2 fraction = offset_px - whole;
    ivec2 low = clamp(pixel + ivec2(whole), ivec2(0), last);
    ivec2 high = clamp(pixel + ivec2(whole) + 1, ivec2(0), last);
    vec3 above = mix(texelFetch(image, low, 0).rgb,
                     texelFetch(image, ivec2(high.x, low.y), 0).rgb, fraction.x);
    vec3 below = mix(texelFetch(image, ivec2(low.x, high.y), 0).rgb,
                     texelFetch(image, high, 0).rgb, fraction.x);
    return mix(above, below, fraction.y);
}

vec3 sample_bilinear(sampler2D image, vec2 px)
{
    vec2 pixel = floor(px);
    return sample_bilinear_at_offset(image, ivec2(pixel), px - pixel - 0.5);
}
