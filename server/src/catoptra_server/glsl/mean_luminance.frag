// Provides the sum of a rectangle of pixels, the rectangles of all texels covering the picture.
// Twin: catoptra_server.effects.sensor.auto_exposure.mean_of.
uniform sampler2D picture;
out vec4 colour;

void main()
{
    ivec2 size = textureSize(picture, 0);
    ivec2 block = (size + GRID - 1) / GRID;
    ivec2 first = ivec2(gl_FragCoord.xy) * block;
    ivec2 end = min(first + block, size);
    vec4 sum = vec4(0.0);
    for (int y = first.y; y < end.y; ++y)
        for (int x = first.x; x < end.x; ++x)
            sum += texelFetch(picture, ivec2(x, y), 0);
    colour = sum;
}
