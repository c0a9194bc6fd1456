// Provides the picture in whole steps of the converter.
// Twin: catoptra_server.effects.sensor.quantisation.Quantisation.apply.
uniform sampler2D picture;
uniform float steps;                 // the largest code
out vec4 colour;

void main()
{
    vec3 light = texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb;
    colour = vec4(min(floor(light * steps + 0.5) / steps, vec3(1.0)), 1.0);
}
