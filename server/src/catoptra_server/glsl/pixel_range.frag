// Provides how far away is what the middle of each pixel sees: the texel where it looks.
// Twin: catoptra_server.render.trace.pixel_ranges.PixelRanges.of.
uniform sampler2D atlas;             // ranges
uniform sampler2D places;            // of the pixels' middles; negative where no mirror is
out float range_m;

void main()
{
    vec2 place = texelFetch(places, ivec2(gl_FragCoord.xy), 0).xy;
    ivec2 texel = ivec2(place * vec2(textureSize(atlas, 0)));
    range_m = place.x >= 0.0 ? texelFetch(atlas, texel, 0).r : uintBitsToFloat(0x7f800000u);
}
