// Provides the range at each pixel's centre: the nearest texel of the atlas of ranges.
// Twin: catoptra_server.render.trace.trace_engine.RayHits.
uniform sampler2D atlas;             // ranges, metres
uniform sampler2D lookup_map;        // atlas coordinates of pixel centres; negative off the mirror
out float range_m;

void main()
{
    vec2 position = texelFetch(lookup_map, ivec2(gl_FragCoord.xy), 0).xy;
    ivec2 texel = ivec2(position * vec2(textureSize(atlas, 0)));
    range_m = position.x >= 0.0 ? texelFetch(atlas, texel, 0).r : uintBitsToFloat(0x7f800000u);
}
