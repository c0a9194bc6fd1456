// Provides the image with each colour amplified, clipped at the full well before.
// Twin: catoptra_server.effects.sensor.white_balance.WhiteBalance.apply.
uniform sampler2D image;
uniform vec3 gains;
out vec4 colour;

void main()
{
    vec3 radiance = texelFetch(image, ivec2(gl_FragCoord.xy), 0).rgb;
    colour = vec4(min(radiance, vec3(1.0)) * gains, 1.0);
}
