// Provides Ways ways_to(pixel), way(ways, tau): how far aside what a pixel shows at a time was when
// the sharp picture was taken; speed_px_s(ways); moved_light(picture, pixel, aside).
// Twin: catoptra_server.effects.image_ways.WaysTo, moved_light.moved_light.
#include "include/cubic.glsl"

const int BESIDE = 0, AT_RIM = 1, WHOLE = 2, INNER = 3;
uniform sampler2D geometry;          // (range, mover)
uniform sampler2D to_u;              // the camera law next to each pixel; zero beside the mirror
uniform sampler2D to_v;
uniform sampler2D about_u;
uniform sampler2D about_v;
uniform sampler2D standing;          // BESIDE to INNER
uniform sampler2D twists;            // a row a mover: m/s, rad/s
uniform float duration_s;

int standing_of(ivec2 pixel)
{
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, textureSize(standing, 0))))
        return BESIDE;
    return int(texelFetch(standing, pixel, 0).r);
}

vec2 spin_of(ivec2 pixel, int mover)
{
    vec3 turn = texelFetch(twists, ivec2(1, mover), 0).rgb;
    return vec2(dot(texelFetch(about_u, pixel, 0).rgb, turn),
                dot(texelFetch(about_v, pixel, 0).rgb, turn));
}

vec2 seen_by(ivec2 pixel)            // nearness in 1/m, and mover
{
    vec2 what = texelFetch(geometry, pixel, 0).rg;
    return vec2(isinf(what.r) ? 0.0 : 1.0 / what.r, what.g);
}

// The flow at a pixel of what another one shows.
vec2 flow_at(ivec2 pixel, ivec2 shown)
{
    vec2 what = seen_by(shown);
    vec3 move = texelFetch(twists, ivec2(0, int(what.y)), 0).rgb;
    vec2 slide = vec2(dot(texelFetch(to_u, pixel, 0).rgb, move),
                      dot(texelFetch(to_v, pixel, 0).rgb, move));
    return slide * what.x + spin_of(pixel, int(what.y));
}

ivec2 shown_at(ivec2 pixel, vec2 aside)
{
    ivec2 there = pixel + ivec2(floor(aside + 0.5));
    return standing_of(there) > BESIDE ? there : pixel;
}

vec2 bend_of(ivec2 pixel)
{
    int mover = int(seen_by(pixel).y);
    vec2 way = spin_of(pixel, mover) * (0.25 * duration_s);
    vec2 before = spin_of(shown_at(pixel, way), mover);
    vec2 after = spin_of(shown_at(pixel, -way), mover);
    return (before - after) / duration_s;
}

// What does not depend on the time: front is the pixel whose body may come over this one.
struct Ways {
    ivec2 pixel, front;
    vec2 flow, bend, front_flow;
};

const int REACH_PX[5] = int[5](1, 2, 4, 7, 11);

ivec2 front_of(ivec2 pixel)
{
    ivec2 front = pixel, last = textureSize(geometry, 0) - 1;
    vec2 own = seen_by(pixel);
    float nearest = own.x;
    for (int k = 0; k < 5; ++k)
        for (int n = 0; n < 9; ++n) {
            ivec2 there = clamp(pixel + REACH_PX[k] * ivec2(n % 3 - 1, n / 3 - 1), ivec2(0), last);
            vec2 what = seen_by(there);
            if (what.y > 0.0 && what.y != own.y && what.x > nearest) {
                front = there;
                nearest = what.x;
            }
        }
    return front;
}

Ways ways_to(ivec2 pixel)
{
    bool has_bodies = textureSize(twists, 0).y > 1;
    ivec2 front = has_bodies ? front_of(pixel) : pixel;
    vec2 flow = flow_at(pixel, pixel);
    return Ways(pixel, front, flow, bend_of(pixel),
                front == pixel ? flow : flow_at(pixel, front));
}

// None where the rim goes through a pixel, which keeps its light.
float speed_px_s(Ways ways)
{
    if (standing_of(ways.pixel) < WHOLE)
        return 0.0;
    return max(length(ways.flow), length(ways.front_flow));
}

// How far aside of a pixel its content was at tau = 0.
vec2 way(Ways ways, float tau)
{
    ivec2 pixel = ways.pixel;
    vec2 curve = ways.bend * (tau * tau);
    vec2 guess = curve - ways.flow * tau;
    ivec2 shown = shown_at(pixel, guess);
    vec2 aside = curve - flow_at(pixel, shown) * tau;
    vec2 own = seen_by(pixel), other = seen_by(shown);
    if (other.y != own.y && seen_by(shown_at(pixel, aside)).y != other.y)
        aside = other.x < own.x ? guess : vec2(0.0);   // hidden when the picture was taken
    if (ways.front == pixel)
        return aside;
    ivec2 body = shown_at(pixel, -ways.front_flow * tau);
    vec2 coming = -flow_at(pixel, body) * tau;
    vec2 what = seen_by(body);
    bool comes = what.y == seen_by(ways.front).y
              && seen_by(shown_at(pixel, coming)).y == what.y
              && what.x > seen_by(shown_at(pixel, aside)).x;
    return comes ? coming : aside;
}

// The light so far aside. At the rim, where interpolation would take in what is beside the mirror,
// that of the next pixel; what would come from beyond the rim is unknown: a pixel keeps its own.
vec3 moved_light(sampler2D picture, ivec2 pixel, vec2 aside)
{
    ivec2 there = pixel + ivec2(floor(aside + 0.5));
    int standing = standing_of(there);
    if (standing == INNER)
        return cubic_aside(picture, pixel, aside);
    return texelFetch(picture, standing == WHOLE ? there : pixel, 0).rgb;
}
