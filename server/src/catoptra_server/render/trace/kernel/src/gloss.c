/* Provides gloss.h: mirrored rays, of planes of one normal and gloss together.
 * Float64 twin: reference/pixels.py. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "gloss.h"

#include "bvh.h"
#include "camera_rays.h"
#include "fog.h"
#include "hit_points.h"
#include "instances.h"
#include "measures.h"
#include "pixels.h"
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
    if (!(lanes & ~seen))
        return seen;
    float black[3][BLOCK_RAYS], brightest[3][BLOCK_RAYS], dimmed[BLOCK_RAYS], raised[BLOCK_RAYS];
    for (int channel = 0; channel < 3; channel++) {
        Floats16 matt = load16(own[channel]);
        store16(matt + load16(part) * (0.0f - matt), black[channel]);
        store16(matt + load16(part) * (most - matt), brightest[channel]);
    }
    const float(*matt)[BLOCK_RAYS] = (const float(*)[BLOCK_RAYS])own;
    find_colour_changes(frame, matt, black, dimmed);
    find_colour_changes(frame, matt, brightest, raised);
    return seen | (lanes & ~bits16(most16(load16(dimmed), load16(raised)) <= limit));
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

/* Light along mirrored rays, by footprints as from the mirrored viewpoint; whether all meet one
 * facet. */
static int shade_mirrored(const FrameState *state, const HitPoints *points, RayBlock *rays,
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
    return !(rays->active & ~find_same(&hits, __builtin_ctz(rays->active)));
}

/* Light that some lanes mirror, all of one plane and roughness; whether they meet one facet. */
static int cast_mirrored(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                         const GlossBlock *gloss, uint32_t lanes, float light[3][BLOCK_RAYS],
                         LostLight *lost) {
    int first = __builtin_ctz(lanes);
    MirrorPlane plane = {get_lane(gloss->normal, first),
                         gloss->roughness[first] * gloss->roughness[first]};
    FrameState once = *state;
    once.mirror = &plane;
    once.known = (LightProof){0, 0};
    RayBlock mirrored = *rays;
    HitPoints points;
    find_hit_points(state, rays, hits, lanes, &points);
    set_mirrored(rays, &points, plane.normal, gloss->cosine, lanes, &mirrored);
    return shade_mirrored(&once, &points, &mirrored, light, lost);
}

/* Mix what some lanes mirror, all of one plane and roughness, into their radiance. */
static void mix_mirrored(const FrameState *state, const GlossBlock *gloss, uint32_t lanes,
                         const float light[3][BLOCK_RAYS], const LostLight *own,
                         float radiance[3][BLOCK_RAYS], LostLight *lost) {
    int first = __builtin_ctz(lanes);
    float roughness = gloss->roughness[first];
    /* Of a plane that is seen from both sides, which takes rays with origins of their own, each
     * has the sky's light of the other: that of objects, since baked light has its brightest
     * node's as the scene's. */
    Vec3 normal = get_lane(gloss->normal, first);
    const Hemisphere *sky = &state->scene->object_hemisphere;
    Vec3 front = ambient_irradiance(sky, normal);
    Vec3 back = ambient_irradiance(sky, scale(-1.0f, normal));
    float fronts[3] = {front.x, front.y, front.z}, backs[3] = {back.x, back.y, back.z};
    Ints16 chosen = mask16(lanes), is_back = load16(gloss->cosine) > splat16(0.0f);
    for (int channel = 0; channel < 3; channel++) {
        Floats16 mean = select16(is_back, splat16(backs[channel]), splat16(fronts[channel]));
        Floats16 matt = load16(radiance[channel]), seen = load16(light[channel]);
        seen = seen + roughness * (mean - seen);
        store16(select16(chosen, matt + load16(gloss->part) * (seen - matt), matt),
                radiance[channel]);
    }
    for (uint32_t left = lost ? lanes & (lost->rays | own->rays) : 0; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        Vec3 none = {0, 0, 0};
        Vec3 before = lost->rays >> lane & 1 ? get_lane(lost->radiance, lane) : none;
        Vec3 there = own->rays >> lane & 1 ? get_lane(own->radiance, lane) : none;
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

/* Bit mask of the rays that meet glossy facets, and what these are. */
static uint32_t find_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                           GlossBlock *gloss) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    uint32_t lanes = 0, left = rays->active & bits16(load_ints16(hits->object) == OBJECT_STATIC);
    for (uint32_t same; left; left &= ~same) {
        int lane = __builtin_ctz(left);
        same = find_same(hits, lane) & left;
        if (!is_glossy(state, hits->triangle[lane]))
            continue;
        const float *own = mesh->gloss + 2 * (size_t)hits->triangle[lane];
        if (!lanes)
            memset(gloss, 0, sizeof *gloss);
        Ints16 chosen = mask16(same);
        store16(select16(chosen, splat16(own[0]), load16(gloss->reflectance)), gloss->reflectance);
        store16(select16(chosen, splat16(own[1]), load16(gloss->roughness)), gloss->roughness);
        set_lanes(gloss->normal, same, vec3(mesh->normals + 3 * (size_t)hits->triangle[lane]));
        lanes |= same;
    }
    if (lanes)
        find_parts(rays, gloss);
    return lanes;
}

int mirror_pixels(const FrameState *state, int tile, int32_t triangle,
                  float light[3][BLOCK_RAYS]) {
    const float *own = state->scene->mesh->arrays.gloss + 2 * (size_t)triangle;
    int samples = state->rays->samples, blocks = samples * samples;
    _Alignas(64) float sums[3][BLOCK_RAYS] = {{0}};
    RayBlock rays;
    HitBlock hits;
    GlossBlock gloss;
    if (samples == 1 || own[1] < SHARED_ROUGHNESS)
        return 0;
    for (int block = blocks - 1; block >= 0; block--) {
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        for (int axis = 0; axis < 3; axis++)
            add_lanes(samples, block, rays.direction[axis], sums[axis]);
    }
    for (int i = 0; i < BLOCK_RAYS; i++) {
        Vec3 sum = get_lane(sums, i);
        set_lane(rays.direction, i, scale(1.0f / sqrtf(dot(sum, sum)), sum));
        hits.triangle[i] = triangle;
        hits.object[i] = OBJECT_STATIC;
    }
    return !rays.has_origins && find_gloss(state, &rays, &hits, &gloss) == 0xffff &&
           cast_mirrored(state, &rays, &hits, &gloss, 0xffff, light, NULL);
}

void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               const float (*known)[BLOCK_RAYS], float radiance[3][BLOCK_RAYS], LostLight *lost) {
    GlossBlock gloss;
    /* A mirrored ray shows facets without their gloss. */
    uint32_t lanes = state->mirror || !state->frame->has_gloss ? 0 : find_gloss(state, rays, hits, &gloss);
    if (!lanes)
        return;
    uint32_t seen = find_seen(state->frame, gloss.part, lanes, radiance);
    if (!seen)
        return;
    _Alignas(64) float matt[3][BLOCK_RAYS];
    memcpy(matt, radiance, sizeof matt);
    for (uint32_t left = seen, same; left; left &= ~same) {
        same = find_alike(&gloss, left, __builtin_ctz(left));
        _Alignas(64) float light[3][BLOCK_RAYS];
        LostLight own = {.rays = 0};
        if (known)
            spread_pixels(state, rays, known, light);
        else
            cast_mirrored(state, rays, hits, &gloss, same, light, lost ? &own : NULL);
        mix_mirrored(state, &gloss, same, (const float(*)[BLOCK_RAYS])light, &own, radiance, lost);
    }
    if (is_noted && state->frame->measures_gloss)
        note_samples(state, &state->measures->gloss, seen, matt, radiance);
}
