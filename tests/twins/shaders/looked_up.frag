// Provides input_0.xy, a place, as a shader reads it from a texture, and whether it is one.
// Twin: catoptra_server.render.projection.lookup_map.places_of.
uniform sampler2D input_0;
out vec4 result;

void main()
{
    vec2 place = texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).xy;
    result = vec4(place, 0.0, place.x >= 0.0 ? 1.0 : 0.0);
}
