/* Provides gloss.h: mirrored rays, of planes of one normal and gloss together.
 * Float64 twin: reference/pixels.py. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "gloss.h"

#include "bvh.h"
#include "fog.h"
#include "hit_points.h"
#include "instances.h"
#include "measures.h"
#include "shading.h"

#include <math.h>
#include <string.h>

/* Schlick's Fresnel reflectance at 16 cosines; rough facets mirror less at grazing angles
 * (Lagarde 2011). */
static void find_fresnel(const float gloss[2], const float cosine[BLOCK_RAYS],
                         float part[BLOCK_RAYS]) {
    float smooth = 1.0f - gloss[1], grazing = smooth > gloss[0] ? smooth : gloss[0];
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float rest = 1.0f - fabsf(cosine[i]);
        rest = rest > 0.0f ? rest : 0.0f;
        part[i] = gloss[0] + (grazing - gloss[0]) * (rest * rest) * (rest * rest) * rest;
    }
}

static Vec3 mix(float part, Vec3 from, Vec3 to) { return add(from, scale(part, subtract(to, from))); }

/* Least slope of the sRGB curve, grey levels: at white. */
#define LEAST_SLOPE 112.0f

/* Whether nobody misses what a facet mirrors: neither the brightest light nor black. */
static int is_unseen(const Frame *frame, float part, Vec3 own) {
    float limit = frame->gloss_limit, most = frame->brightest;
    Vec3 brightest = {most, most, most};
    float room = 1.0f - frame->largest_gain * own.x;
    float rise = frame->largest_gain * part * (most - own.x);
    /* Mostly it is plain, without the curve. */
    if (limit < 0.0f || LEAST_SLOPE * (room < rise ? room : rise) > limit)
        return 0;
    return colour_change(frame, own, mix(part, own, (Vec3){0, 0, 0})) <= limit &&
           colour_change(frame, own, mix(part, own, brightest)) <= limit;
}

/* Rays of some lanes that mirror one plane's light, from its points. */
static void set_mirrored(const RayBlock *rays, const HitPoints *points, Vec3 normal,
                         const float cosine[BLOCK_RAYS], uint32_t lanes, RayBlock *mirrored) {
    float unit[3] = {normal.x, normal.y, normal.z}, largest[BLOCK_RAYS] = {0};
    mirrored->active = lanes;
    mirrored->has_origins = 1;
    store16(splat16(INFINITY), mirrored->limit);
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BLOCK_RAYS; i++) {
            float here = fabsf(points->position[axis][i]), there = fabsf(rays->origin[axis][i]);
            float larger = here > there ? here : there;
            largest[i] = larger > largest[i] ? larger : largest[i];
        }
    Ints16 chosen = mask16(lanes);
    Floats16 along = load16(cosine), bias = SHADOW_BIAS * load16(largest);
    bias = select16(along > splat16(0.0f), -bias, bias);
    for (int axis = 0; axis < 3; axis++) {
        Floats16 direction = load16(rays->direction[axis]);
        Floats16 origin = load16(points->position[axis]) + bias * unit[axis];
        store16(select16(chosen, origin, load16(rays->origin[axis])), mirrored->origin[axis]);
        store16(select16(chosen, direction - (2.0f * along) * unit[axis], direction),
                mirrored->direction[axis]);
    }
}

/* Light along mirrored rays, by footprints as from the mirrored viewpoint. */
static void shade_mirrored(const FrameState *state, const HitPoints *points, RayBlock *rays,
                           float light[3][BLOCK_RAYS], LostLight *lost) {
    HitBlock hits;
    memset(hits.triangle, 0xff, sizeof hits.triangle);
    memset(hits.object, 0xff, sizeof hits.object);
    intersect_bvh(&state->scene->mesh->bvh, place_of(state), OBJECT_STATIC, rays, &hits);
    if (state->objects)
        intersect_instances(state, rays, &hits);
    RayBlock apart = *rays;
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            apart.origin[axis][i] -= points->distance[i] * apart.direction[axis][i];
    shade_block(state, &apart, &hits, NULL, NULL, 0, light, lost);
    if (has_fog(state))
        fog_block(state, rays, &hits, 0, light, lost);
}

/* The same of lanes that meet one plane of one gloss. */
static void mix_mirrored(const FrameState *state, const RayBlock *rays, const HitPoints *points,
                         const float gloss[2], uint32_t lanes, float radiance[3][BLOCK_RAYS],
                         LostLight *lost) {
    Vec3 normal = get_lane(points->normal, __builtin_ctz(lanes));
    _Alignas(64) float part[BLOCK_RAYS], cosine[BLOCK_RAYS];
    for (int i = 0; i < BLOCK_RAYS; i++)
        cosine[i] = normal.x * rays->direction[0][i] + normal.y * rays->direction[1][i] +
                    normal.z * rays->direction[2][i];
    find_fresnel(gloss, cosine, part);
    for (uint32_t left = state->frame->gloss_limit >= 0.0f ? lanes : 0; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        if (is_unseen(state->frame, part[lane], get_lane(radiance, lane)))
            lanes &= ~(1u << lane);
    }
    if (!lanes)
        return;
    MirrorPlane plane = {normal, gloss[1] * gloss[1]};
    FrameState once = *state;
    once.mirror = &plane;
    RayBlock mirrored = *rays;
    _Alignas(64) float light[3][BLOCK_RAYS];
    LostLight own = {.rays = 0};
    set_mirrored(rays, points, normal, cosine, lanes, &mirrored);
    shade_mirrored(&once, points, &mirrored, light, lost ? &own : NULL);
    /* Of a plane that is seen from both sides, which takes rays with origins of their own, each
     * has the sky's light of the other. */
    Vec3 front = ambient_irradiance(&state->scene->hemisphere, normal);
    Vec3 back = ambient_irradiance(&state->scene->hemisphere, scale(-1.0f, normal));
    float fronts[3] = {front.x, front.y, front.z}, backs[3] = {back.x, back.y, back.z};
    Ints16 chosen = mask16(lanes), is_back = load16(cosine) > splat16(0.0f);
    for (int channel = 0; channel < 3; channel++) {
        Floats16 mean = select16(is_back, splat16(backs[channel]), splat16(fronts[channel]));
        Floats16 matt = load16(radiance[channel]), seen = load16(light[channel]);
        seen = seen + gloss[1] * (mean - seen);
        store16(select16(chosen, matt + load16(part) * (seen - matt), matt), radiance[channel]);
    }
    for (uint32_t left = lost ? lanes & (lost->rays | own.rays) : 0; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        Vec3 none = {0, 0, 0};
        Vec3 before = lost->rays >> lane & 1 ? get_lane(lost->radiance, lane) : none;
        Vec3 there = own.rays >> lane & 1 ? get_lane(own.radiance, lane) : none;
        set_lane(lost->radiance, lane, mix(part[lane], before, scale(1.0f - gloss[1], there)));
        lost->rays |= 1u << lane;
    }
}

/* Of some lanes those that meet a plane of one lane's normal and gloss. */
static uint32_t find_alike(const HitPoints *points, const HitBlock *hits, const float *gloss,
                           uint32_t among, int lane) {
    uint32_t alike = 0;
    for (uint32_t left = among; left; left &= left - 1) {
        int other = __builtin_ctz(left), is_alike = 1;
        for (int axis = 0; axis < 3; axis++)
            is_alike &= points->normal[axis][other] == points->normal[axis][lane];
        is_alike &= !memcmp(gloss + 2 * (size_t)hits->triangle[other],
                            gloss + 2 * (size_t)hits->triangle[lane], 2 * sizeof *gloss);
        alike |= (uint32_t)is_alike << other;
    }
    return alike | 1u << lane;
}

void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               float radiance[3][BLOCK_RAYS], LostLight *lost) {
    const float *gloss = state->scene->mesh->arrays.gloss;
    uint32_t lanes = 0;
    /* A mirrored ray shows facets without their gloss. */
    for (int lane = 0; !state->mirror && gloss && lane < BLOCK_RAYS; lane++)
        if (rays->active >> lane & 1 && hits->object[lane] == OBJECT_STATIC)
            lanes |= (uint32_t)is_glossy(state, hits->triangle[lane]) << lane;
    if (!lanes)
        return;
    HitPoints points;
    find_hit_points(state, rays, hits, lanes, &points);
    _Alignas(64) float matt[3][BLOCK_RAYS];
    memcpy(matt, radiance, sizeof matt);
    for (uint32_t left = lanes, same; left; left &= ~same) {
        int lane = __builtin_ctz(left);
        same = find_same(hits, lane) & left;
        if (same != left)
            same = find_alike(&points, hits, gloss, left, lane);
        mix_mirrored(state, rays, &points, gloss + 2 * (size_t)hits->triangle[lane], same,
                     radiance, lost);
    }
    if (is_noted && state->frame->measures_gloss)
        note_samples(state, &state->measures->gloss, lanes, matt, radiance);
}
