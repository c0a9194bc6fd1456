// Provides the picture spread along the ways of what it shows while the shutter is open.
// Twin: catoptra_server.effects.motion_blur.MotionBlur.apply.
#include "include/image_motion.glsl"

const float STILL_PX = 0.1;
const float SPACING_PX = 1.5;
const int MOST_TIMES = 64;
uniform sampler2D picture;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = texelFetch(picture, pixel, 0);
    Ways ways = ways_to(pixel);
    float width_px = speed_px_s(ways) * duration_s;
    if (width_px <= STILL_PX)
        return;
    int count = min(1 + int(ceil(width_px / SPACING_PX)), MOST_TIMES);
    float spread = duration_s / sqrt(1.0 - 1.0 / float(count * count));
    vec3 sum = vec3(0.0);
    for (int k = 0; k < count; ++k) {
        float tau = ((float(k) + 0.5) / float(count) - 0.5) * spread;
        sum += moved_light(picture, pixel, way(ways, tau));
    }
    colour.rgb = max(sum / float(count), vec3(0.0));
}
