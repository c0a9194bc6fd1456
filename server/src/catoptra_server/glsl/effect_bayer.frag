// Provides the picture of one measured colour a pixel (RGGB), the others bilinear.
// Twin: catoptra_server.effects.sensor.bayer.Bayer.apply.
uniform sampler2D picture;
out vec4 colour;

// What the pixel measures; beyond the border it is mirrored about the last pixel.
float raw(ivec2 pixel)
{
    ivec2 last = textureSize(picture, 0) - 1;
    pixel = last - abs(last - abs(pixel));
    int filtered = (pixel.x & 1) + (pixel.y & 1);
    return texelFetch(picture, pixel, 0)[filtered];
}

void main()
{
    ivec2 p = ivec2(gl_FragCoord.xy);
    float own = raw(p);
    float across = 0.5 * (raw(p - ivec2(1, 0)) + raw(p + ivec2(1, 0)));
    float along = 0.5 * (raw(p - ivec2(0, 1)) + raw(p + ivec2(0, 1)));
    float corners = 0.25 * (raw(p - ivec2(1, 1)) + raw(p + ivec2(1, -1))
                          + raw(p + ivec2(-1, 1)) + raw(p + ivec2(1, 1)));
    float plus = 0.5 * (across + along);
    bvec2 odd = bvec2((p.x & 1) == 1, (p.y & 1) == 1);
    if (!odd.x && !odd.y)
        colour = vec4(own, plus, corners, 1.0);
    else if (odd.x && odd.y)
        colour = vec4(corners, plus, own, 1.0);
    else if (odd.x)
        colour = vec4(across, own, along, 1.0);
    else
        colour = vec4(along, own, across, 1.0);
}
