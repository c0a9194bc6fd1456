// Provides bool direction_from_pixel(vec2 pixel, out vec3 direction): mirror frame, not unit.
// Twin: catoptra_protocol.optics.camera.direction_from_pixel, up to the length of the direction.
#include <mirror_law>

uniform vec2 camera_centre_px;
uniform float camera_inverse_h;      // one over the radius of the 90 degree circle, 1/px
uniform float camera_rim_t;          // tan(rim / 2)
uniform vec2 camera_up;              // cosine and sine of the azimuth that points up in the image

// Beyond the rim the direction is still finite; only the answer says that no mirror is there.
bool direction_from_pixel(vec2 pixel, out vec3 direction)
{
    vec2 ratio = (pixel - camera_centre_px) * camera_inverse_h;
    float ratio_squared = dot(ratio, ratio);
    float gain = tangent_per_ratio(ratio_squared);
    float t = gain * sqrt(ratio_squared);
    vec2 turned = vec2(camera_up.y * ratio.x - camera_up.x * ratio.y,
                       -camera_up.x * ratio.x - camera_up.y * ratio.y);
    direction = vec3(2.0 * gain * turned, (1.0 - t) * (1.0 + t));
    return t <= camera_rim_t;
}
