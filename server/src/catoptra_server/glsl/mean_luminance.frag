// Provides the sum of one rectangle of pixels; GRID_SIDE x GRID_SIDE rectangles cover the image.
// Twin: catoptra_server.effects.kernels.luminance.mean_luminance.
uniform sampler2D image;
out vec4 colour;

void main()
{
    ivec2 size = textureSize(image, 0);
    ivec2 block = (size + GRID_SIDE - 1) / GRID_SIDE;
    ivec2 first = ivec2(gl_FragCoord.xy) * block;
    ivec2 end = min(first + block, size);
    vec4 sum = vec4(0.0);
    for (int y = first.y; y < end.y; ++y)
        for (int x = first.x; x < end.x; ++x)
            sum += texelFetch(image, ivec2(x, y), 0);
    colour = sum;
}
