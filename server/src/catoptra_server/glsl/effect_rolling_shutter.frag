// Provides the picture whose rows are exposed one after the other.
// Twin: catoptra_server.effects.rolling_shutter.RollingShutter.apply.
#include "include/image_motion.glsl"

const float STILL_PX = 0.05;
uniform sampler2D picture;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = texelFetch(picture, pixel, 0);
    float height = float(textureSize(picture, 0).y);
    float tau = ((float(pixel.y) + 0.5) / height - 0.5) * duration_s;
    Ways ways = ways_to(pixel);
    if (speed_px_s(ways) * abs(tau) <= STILL_PX)
        return;
    colour.rgb = max(moved_light(picture, pixel, way(ways, tau)), vec3(0.0));
}
