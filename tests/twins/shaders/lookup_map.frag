// Provides input_0.xy, atlas coordinates as a shader reads them from a texture, and their validity.
// Twin: catoptra_server.render.projection.atlas.atlas_coordinates.
uniform sampler2D input_0;
out vec4 result;

void main()
{
    vec2 position = texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).xy;
    result = vec4(position, 0.0, position.x >= 0.0 ? 1.0 : 0.0);
}
