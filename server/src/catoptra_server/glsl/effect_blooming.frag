// Provides the picture with what runs over from full wells above and below.
// Twin: catoptra_server.effects.sensor.blooming.Blooming.apply.
uniform sampler2D picture;
uniform float share;
uniform float length_px;             // whole pixels
out vec4 colour;

vec3 run_over(ivec2 pixel)
{
    if (pixel.y < 0 || pixel.y >= textureSize(picture, 0).y)
        return vec3(0.0);
    return max(texelFetch(picture, pixel, 0).rgb - 1.0, vec3(0.0));
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 gained = vec3(0.0);
    for (int k = 1; k <= int(length_px); ++k) {
        float weight = (length_px + 1.0 - float(k)) / (length_px * (length_px + 1.0));
        gained += weight * (run_over(pixel - ivec2(0, k)) + run_over(pixel + ivec2(0, k)));
    }
    colour = vec4(texelFetch(picture, pixel, 0).rgb + share * gained, 1.0);
}
