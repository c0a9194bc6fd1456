// Provides vec3 cubic_aside(sampler2D picture, ivec2 pixel, vec2 aside_px): light between pixels.
// Twin: catoptra_server.effects.cubic.cubic_aside.

// Light less half of f (1 - f) times its second differences: interpolated so, it is that of cubics.
vec3 corrected(sampler2D picture, ivec2 pixel, vec2 bulge)
{
    vec3 light = texelFetch(picture, pixel, 0).rgb;
    vec3 along = texelFetch(picture, pixel + ivec2(1, 0), 0).rgb - 2.0 * light
               + texelFetch(picture, pixel - ivec2(1, 0), 0).rgb;
    vec3 down = texelFetch(picture, pixel + ivec2(0, 1), 0).rgb - 2.0 * light
              + texelFetch(picture, pixel - ivec2(0, 1), 0).rgb;
    return light - bulge.x * along - bulge.y * down;
}

// Only where all pixels within two of it lie in the picture.
vec3 cubic_aside(sampler2D picture, ivec2 pixel, vec2 aside_px)
{
    vec2 whole = floor(aside_px);
    vec2 share = aside_px - whole;
    vec2 bulge = 0.5 * share * (1.0 - share);
    ivec2 low = pixel + ivec2(whole);
    vec3 above = mix(corrected(picture, low, bulge),
                     corrected(picture, low + ivec2(1, 0), bulge), share.x);
    vec3 below = mix(corrected(picture, low + ivec2(0, 1), bulge),
                     corrected(picture, low + ivec2(1, 1), bulge), share.x);
    return mix(above, below, share.y);
}
