// Provides what the middle of each pixel sees: the texel where it looks in the atlas.
// Twin: catoptra_server.render.trace.pixel_geometry.PixelGeometry.of.
uniform sampler2D atlas;             // (range, mover)
uniform sampler2D places;            // of the pixels' middles; negative where no mirror is
out vec2 seen;

void main()
{
    vec2 place = texelFetch(places, ivec2(gl_FragCoord.xy), 0).xy;
    ivec2 texel = ivec2(place * vec2(textureSize(atlas, 0)));
    seen = place.x >= 0.0 ? texelFetch(atlas, texel, 0).xy
                          : vec2(uintBitsToFloat(0x7f800000u), 0.0);
}
