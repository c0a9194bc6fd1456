// Provides the image with one measured colour per pixel (RGGB), the others bilinear.
// Twin: catoptra_server.effects.sensor.bayer.Bayer.apply.
uniform sampler2D image;
out vec4 colour;

// Measured value of a pixel; at the border the image is mirrored about its last pixel.
float raw(ivec2 pixel)
{
    ivec2 last = textureSize(image, 0) - 1;
    pixel = last - abs(last - abs(pixel));
    // Index of the filter: red at (even, even), blue at (odd, odd), green between.
    int channel = (pixel.x & 1) + (pixel.y & 1);
    return texelFetch(image, pixel, 0)[channel];
}

void main()
{
    ivec2 p = ivec2(gl_FragCoord.xy);
    float measured = raw(p);
    float horizontal = 0.5 * (raw(p - ivec2(1, 0)) + raw(p + ivec2(1, 0)));
    float vertical = 0.5 * (raw(p - ivec2(0, 1)) + raw(p + ivec2(0, 1)));
    float diagonal = 0.25 * (raw(p - ivec2(1, 1)) + raw(p + ivec2(1, -1))
                           + raw(p + ivec2(-1, 1)) + raw(p + ivec2(1, 1)));
    float cross_mean = 0.5 * (horizontal + vertical);
    bvec2 odd = bvec2((p.x & 1) == 1, (p.y & 1) == 1);
    if (!odd.x && !odd.y)
        colour = vec4(measured, cross_mean, diagonal, 1.0);
    else if (odd.x && odd.y)
        colour = vec4(diagonal, cross_mean, measured, 1.0);
    else if (odd.x)
        colour = vec4(horizontal, measured, vertical, 1.0);
    else
        colour = vec4(vertical, measured, horizontal, 1.0);
}
