// Provides the picture times one gain.
// Twin: catoptra_server.effects.sensor.exposure.Exposure.apply.
uniform sampler2D picture;
uniform float gain;
out vec4 colour;

void main()
{
    colour = texelFetch(picture, ivec2(gl_FragCoord.xy), 0) * gain;
}
