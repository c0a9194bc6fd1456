// Provides the irradiance at input_0.xyz, an offset, on a facet of normal input_1.xyz.
// Twin: catoptra_server.world.shading.point_irradiance.
uniform sampler2D input_0;
uniform sampler2D input_1;
out vec4 result;

void main()
{
    ivec2 index = ivec2(gl_FragCoord.xy);
    vec3 offset = texelFetch(input_0, index, 0).xyz;
    vec3 normal = texelFetch(input_1, index, 0).xyz;
    result = vec4(point_irradiance(offset, normal), 1.0);
}
