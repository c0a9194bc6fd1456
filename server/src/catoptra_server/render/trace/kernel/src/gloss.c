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

/* What glossy lanes have besides their hits. */
typedef struct {
    _Alignas(64) float reflectance[BLOCK_RAYS], roughness[BLOCK_RAYS];
    float normal[3][BLOCK_RAYS];
    float cosine[BLOCK_RAYS], part[BLOCK_RAYS]; /* with the normal; of the light that is mirrored */
} GlossBlock;

/* Schlick's Fresnel reflectance; rough facets mirror less at grazing angles (Lagarde 2011). */
static void find_parts(const RayBlock *rays, GlossBlock *gloss) {
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float least = gloss->reflectance[i], smooth = 1.0f - gloss->roughness[i];
        float grazing = smooth > least ? smooth : least;
        float cosine = gloss->normal[0][i] * rays->direction[0][i] +
                       gloss->normal[1][i] * rays->direction[1][i] +
                       gloss->normal[2][i] * rays->direction[2][i];
        float rest = 1.0f - fabsf(cosine);
        rest = rest > 0.0f ? rest : 0.0f;
        gloss->cosine[i] = cosine;
        gloss->part[i] = least + (grazing - least) * (rest * rest) * (rest * rest) * rest;
    }
}

static Vec3 mix(float part, Vec3 from, Vec3 to) { return add(from, scale(part, subtract(to, from))); }

/* Least slope of the sRGB curve, grey levels: at white. */
#define LEAST_SLOPE 112.0f

/* Of some lanes those of which somebody may miss the brightest light, or black, in the mirror. */
static uint32_t find_seen(const Frame *frame, const float part[BLOCK_RAYS], uint32_t lanes,
                          float own[3][BLOCK_RAYS]) {
    float limit = frame->gloss_limit, most = frame->brightest;
    if (limit < 0.0f)
        return lanes;
    /* Mostly it is plain, without the curve. */
    Floats16 room = 1.0f - frame->largest_gain * load16(own[0]);
    Floats16 rise = frame->largest_gain * load16(part) * (most - load16(own[0]));
    uint32_t seen = bits16(LEAST_SLOPE * least16(room, rise) > splat16(limit)) & lanes;
    for (uint32_t left = lanes & ~seen; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        Vec3 matt = get_lane(own, lane), brightest = {most, most, most}, black = {0, 0, 0};
        if (!(colour_change(frame, matt, mix(part[lane], matt, black)) <= limit &&
              colour_change(frame, matt, mix(part[lane], matt, brightest)) <= limit))
            seen |= 1u << lane;
    }
    return seen;
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

/* Light that some lanes mirror, all of one plane and roughness, into `mirrored`. */
static void cast_mirrored(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                          const GlossBlock *gloss, uint32_t lanes, int has_lost,
                          MirroredPixels *mirrored) {
    int first = __builtin_ctz(lanes);
    float roughness = gloss->roughness[first];
    MirrorPlane plane = {get_lane(gloss->normal, first), roughness * roughness};
    FrameState once = *state;
    once.mirror = &plane;
    RayBlock turned = *rays;
    _Alignas(64) float light[3][BLOCK_RAYS];
    LostLight lost = {.rays = 0};
    HitPoints points;
    find_hit_points(state, rays, hits, lanes, &points);
    set_mirrored(rays, &points, plane.normal, gloss->cosine, lanes, &turned);
    shade_mirrored(&once, &points, &turned, light, has_lost ? &lost : NULL);
    Ints16 cast = mask16(lanes);
    mirrored->pixels |= lanes;
    mirrored->lost.rays = (mirrored->lost.rays & ~lanes) | (lost.rays & lanes);
    store_ints16((cast & load_ints16(hits->triangle)) | (~cast & load_ints16(mirrored->triangle)),
                 mirrored->triangle);
    for (int channel = 0; channel < 3; channel++) {
        store16(select16(cast, load16(light[channel]), load16(mirrored->light[channel])),
                mirrored->light[channel]);
        store16(select16(cast, load16(lost.radiance[channel]),
                         load16(mirrored->lost.radiance[channel])),
                mirrored->lost.radiance[channel]);
    }
}

/* Mix what some lanes mirror, all of one plane and roughness, into their radiance. */
static void mix_mirrored(const FrameState *state, const GlossBlock *gloss, uint32_t lanes,
                         const MirroredPixels *mirrored, float radiance[3][BLOCK_RAYS],
                         LostLight *lost) {
    int first = __builtin_ctz(lanes);
    float roughness = gloss->roughness[first];
    /* Of a plane that is seen from both sides, which takes rays with origins of their own, each
     * has the sky's light of the other. */
    Vec3 normal = get_lane(gloss->normal, first);
    Vec3 front = ambient_irradiance(&state->scene->hemisphere, normal);
    Vec3 back = ambient_irradiance(&state->scene->hemisphere, scale(-1.0f, normal));
    float fronts[3] = {front.x, front.y, front.z}, backs[3] = {back.x, back.y, back.z};
    Ints16 chosen = mask16(lanes), is_back = load16(gloss->cosine) > splat16(0.0f);
    for (int channel = 0; channel < 3; channel++) {
        Floats16 mean = select16(is_back, splat16(backs[channel]), splat16(fronts[channel]));
        Floats16 matt = load16(radiance[channel]), seen = load16(mirrored->light[channel]);
        seen = seen + roughness * (mean - seen);
        store16(select16(chosen, matt + load16(gloss->part) * (seen - matt), matt),
                radiance[channel]);
    }
    for (uint32_t left = lost ? lanes & (lost->rays | mirrored->lost.rays) : 0; left;
         left &= left - 1) {
        int lane = __builtin_ctz(left);
        Vec3 none = {0, 0, 0};
        Vec3 before = lost->rays >> lane & 1 ? get_lane(lost->radiance, lane) : none;
        Vec3 there = mirrored->lost.rays >> lane & 1 ? get_lane(mirrored->lost.radiance, lane) : none;
        set_lane(lost->radiance, lane,
                 mix(gloss->part[lane], before, scale(1.0f - roughness, there)));
        lost->rays |= 1u << lane;
    }
}

/* Of some lanes those that meet a plane of one lane's normal and roughness. */
static uint32_t find_alike(const GlossBlock *gloss, uint32_t among, int lane) {
    Ints16 alike = load16(gloss->roughness) == splat16(gloss->roughness[lane]);
    for (int axis = 0; axis < 3; axis++)
        alike &= load16(gloss->normal[axis]) == splat16(gloss->normal[axis][lane]);
    return (bits16(alike) & among) | 1u << lane;
}

void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               MirroredPixels *shared, float radiance[3][BLOCK_RAYS], LostLight *lost) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    uint32_t lanes = 0;
    /* A mirrored ray shows facets without their gloss. */
    if (state->mirror || !state->frame->has_gloss || !mesh->gloss)
        return;
    GlossBlock gloss;
    memset(&gloss, 0, sizeof gloss);
    for (uint32_t left = rays->active & bits16(load_ints16(hits->object) == OBJECT_STATIC), same;
         left; left &= ~same) {
        int lane = __builtin_ctz(left);
        size_t triangle = (size_t)hits->triangle[lane];
        same = find_same(hits, lane) & left;
        if (mesh->gloss[2 * triangle] == 0.0f)
            continue;
        Ints16 chosen = mask16(same);
        store16(select16(chosen, splat16(mesh->gloss[2 * triangle]), load16(gloss.reflectance)),
                gloss.reflectance);
        store16(select16(chosen, splat16(mesh->gloss[2 * triangle + 1]), load16(gloss.roughness)),
                gloss.roughness);
        set_lanes(gloss.normal, same, vec3(mesh->normals + 3 * triangle));
        lanes |= same;
    }
    if (!lanes)
        return;
    find_parts(rays, &gloss);
    uint32_t seen = find_seen(state->frame, gloss.part, lanes, radiance);
    _Alignas(64) float matt[3][BLOCK_RAYS];
    memcpy(matt, radiance, sizeof matt);
    for (uint32_t left = seen, same; left; left &= ~same) {
        int lane = __builtin_ctz(left);
        MirroredPixels own = {.pixels = 0}, *mirrored = &own;
        if (shared && gloss.roughness[lane] >= SHARED_ROUGHNESS)
            mirrored = shared;
        same = find_alike(&gloss, left, lane);
        Ints16 is_known = load_ints16(mirrored->triangle) == load_ints16(hits->triangle);
        uint32_t missing = same & ~(mirrored->pixels & bits16(is_known));
        if (missing)
            cast_mirrored(state, rays, hits, &gloss, missing, lost != NULL, mirrored);
        mix_mirrored(state, &gloss, same, mirrored, radiance, lost);
    }
    if (is_noted && state->frame->measures_gloss)
        note_samples(state, &state->measures->gloss, seen, matt, radiance);
}
