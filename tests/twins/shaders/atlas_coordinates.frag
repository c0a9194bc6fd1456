// Provides the atlas coordinates of input_0.xyz, a direction.
// Twin: catoptra_protocol.optics.cube_map.face_coordinates.
uniform sampler2D input_0;
out vec4 result;

void main()
{
    vec3 direction = texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).xyz;
    result = vec4(atlas_coordinates(direction), 0.0, 0.0);
}
