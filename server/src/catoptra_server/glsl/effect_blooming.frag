// Provides the image with the overflow of full wells above and below.
// Twin: catoptra_server.effects.sensor.blooming.Blooming.apply.
uniform sampler2D image;
uniform float overflow_fraction;
uniform float length_px;             // a whole number
out vec4 colour;

vec3 overflow(ivec2 pixel)
{
    if (pixel.y < 0 || pixel.y >= textureSize(image, 0).y)
        return vec3(0.0);
    return max(texelFetch(image, pixel, 0).rgb - 1.0, vec3(0.0));
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 total = vec3(0.0);
    for (int k = 1; k <= int(length_px); ++k) {
        float weight = (length_px + 1.0 - float(k)) / (length_px * (length_px + 1.0));
        total += weight * (overflow(pixel - ivec2(0, k)) + overflow(pixel + ivec2(0, k)));
    }
    colour = vec4(texelFetch(image, pixel, 0).rgb + overflow_fraction * total, 1.0);
}
