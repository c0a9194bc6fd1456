// Provides the filtered linear colour of a texture at input_0.xy.
// Twin: catoptra_server.world.shading.texture_value.
uniform sampler2D input_0;
uniform sampler2D albedo_texture;
out vec4 result;

void main()
{
    vec2 uv = texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).xy;
    result = vec4(textureLod(albedo_texture, uv, 0.0).rgb, 1.0);
}
