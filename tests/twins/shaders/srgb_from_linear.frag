// Provides the encoded value of input_0.rgb, linear light.
// Twin: catoptra_server.world.world_description.srgb_from_linear.
uniform sampler2D input_0;
out vec4 result;

void main()
{
    vec3 linear = texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).rgb;
    result = vec4(srgb_from_linear(linear), 1.0);
}
