/* Provides direct_light.h: light of directional and point lights, with a ray to each where no
 * height map decides.
 * Float64 twin: world/shading.py:unshadowed_irradiance, reference/pixels.py. Owns nothing: writes
 * what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "direct_light.h"

#include "blur_plan.h"
#include "instances.h"
#include "lanes.h"
#include "measures.h"

#include <math.h>
#include <string.h>

#define UNLIMITED INFINITY

/* The steepest part of the sRGB curve, and the factor of x^(-7/12) in the slope of the rest. */
#define STEEPEST 12.92f
#define SLOPE 0.4396f
/* Of the light that nobody misses in what is lit by the sky alone, which no lamp may exceed that is
 * left to rays. */
#define FAINT_PART 0.5f

/* A light as 16 points see it. */
typedef struct {
    _Alignas(64) float direction[3][BLOCK_RAYS];
    float distance[BLOCK_RAYS];
    float factor[BLOCK_RAYS]; /* irradiance of the unoccluded light, of its intensity */
} Incidence;

static void find_parallel(Vec3 towards, const HitPoints *points, Incidence *found) {
    for (int i = 0; i < BLOCK_RAYS; i++) {
        found->factor[i] = towards.x * points->normal[0][i] + towards.y * points->normal[1][i] +
                           towards.z * points->normal[2][i];
        found->direction[0][i] = towards.x;
        found->direction[1][i] = towards.y;
        found->direction[2][i] = towards.z;
        found->distance[i] = UNLIMITED;
    }
}

/* Vector code: one division and one square root for 16 points. */
static void find_radial(Vec3 from, const HitPoints *points, Incidence *found) {
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float x = from.x - points->position[0][i], y = from.y - points->position[1][i];
        float z = from.z - points->position[2][i];
        float squared = x * x + y * y + z * z;
        squared = squared > MIN_SQUARED_DISTANCE ? squared : MIN_SQUARED_DISTANCE;
        float length = __builtin_sqrtf(squared), inverse = 1.0f / length;
        x *= inverse;
        y *= inverse;
        z *= inverse;
        float cosine = x * points->normal[0][i] + y * points->normal[1][i] +
                       z * points->normal[2][i];
        found->direction[0][i] = x;
        found->direction[1][i] = y;
        found->direction[2][i] = z;
        found->distance[i] = length;
        found->factor[i] = cosine * (inverse * inverse);
    }
}

/* Rays whose light is added one by one, instead of from the tables. */
static uint32_t find_added(const FrameState *state, const Light *light,
                           const SurfaceBlock *surface) {
    int is_in_table = light->kind == LIGHT_DIRECTIONAL && !state->frame->has_shadows;
    uint32_t scene = is_in_table ? surface->coloured : 0xffff;
    return surface->lit & (surface->objects | (light->lights_scene ? scene : 0));
}

/* Facets turned away from a light are dark without a ray. */
static uint32_t find_facing(const Incidence *light, uint32_t among) {
    return bits16(load16(light->factor) > splat16(0.0f)) & among;
}

static void set_shadow_rays(RayBlock *shadow, const RayBlock *rays, const HitPoints *points,
                            const Incidence *light) {
    shadow->has_origins = 1;
    memcpy(shadow->direction, light->direction, sizeof shadow->direction);
    memcpy(shadow->limit, light->distance, sizeof shadow->limit);
    memcpy(shadow->time, rays->time, sizeof shadow->time);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 position = get_lane(points->position, lane);
        float here = max_abs(position), there = max_abs(get_lane(rays->origin, lane));
        float bias = SHADOW_BIAS * (here > there ? here : there);
        set_lane(shadow->origin, lane,
                 add(position, scale(bias, get_lane(points->normal, lane))));
    }
}

/* Rays at the corners of a block. */
#define CORNER_RAYS (1u << 0 | 1u << 3 | 1u << 12 | 1u << 15)

/* Rays that meet facets of the static scene on which a light shines. */
static uint32_t find_shone_on(const FrameState *state, const Light *light, const HitBlock *hits,
                              uint32_t among) {
    uint32_t found = 0;
    for (uint32_t left = among, same; left; left &= ~same) {
        int lane = __builtin_ctz(left);
        int32_t triangle = hits->triangle[lane];
        same = find_same(hits, lane) & left;
        if (hits->object[lane] == OBJECT_STATIC &&
            !(state->scene->mesh->arrays.flags[triangle] & FACET_UNLIT) &&
            find_incidence(state, light, triangle) > 0.0f)
            found |= same;
    }
    return found;
}

int sees_all_lights(const FrameState *state, const RayBlock *rays, const HitBlock *hits) {
    _Alignas(64) float ends[3][BLOCK_RAYS];
    for (int axis = 0; axis < 3; axis++)
        store16(load16(rays->origin[axis]) + load16(rays->limit) * load16(rays->direction[axis]),
                ends[axis]);
    for (int number = 0; number < state->scene->num_lights; number++) {
        const Light *light = &state->scene->lights[number];
        uint32_t shone_on = find_shone_on(state, light, hits, rays->active);
        if (!shone_on)
            continue;
        /* Where one is not seen, mostly a corner is none. */
        uint32_t parts[2] = {shone_on & CORNER_RAYS, shone_on & ~CORNER_RAYS};
        for (int part = 0; part < 2; part++) {
            Uncertainty found =
                find_light(state, number, hits, (const float(*)[BLOCK_RAYS])ends, parts[part]);
            if (found.hidden | found.unknown | found.behind_objects)
                return 0;
        }
    }
    return 1;
}

static int may_skip_lamps(const Frame *frame) {
    return frame->has_shadows && frame->measures_shadows && frame->limits.plain_change > 0.0f;
}

/* The curve is concave: light s changes x by at most its slope there times s; x^(5/8) is less than
 * x^(7/12). What is allowed is concave in x, up to white: so it holds for means of samples, for any
 * smaller gain, and behind any texture. */
static inline float allow_light(const Frame *frame, float radiance) {
    float gain = frame->largest_gain, x = gain * radiance;
    float share = UNSEEN_PART * frame->limits.plain_change / (255.0f * gain);
    x = x > 0.0f ? x < 1.0f ? x : 1.0f : 0.0f;
    float root = __builtin_sqrtf(x), eighth = __builtin_sqrtf(__builtin_sqrtf(root));
    float curved = root * eighth * (1.0f / SLOPE);
    return share * (curved > 1.0f / STEEPEST ? curved : 1.0f / STEEPEST);
}

static void allow_unseen(const FrameState *state, SurfaceBlock *surface) {
    int is_any = may_skip_lamps(state->frame);
    surface->has_allowed = 1;
    if (!is_any)
        memset(surface->unseen, 0, sizeof surface->unseen);
    for (int channel = 0; is_any && channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            surface->unseen[channel][i] = allow_light(state->frame, surface->unseen[channel][i]);
}

/* Bound of the light of a lamp on the part of a plane between four points, by how high it is above
 * the plane and how near to the points. */
static Vec3 bound_lamp(const FrameState *state, const Light *lamp, int32_t triangle,
                       const Vec3 corners[4]) {
    Vec3 middle = scale(0.25f, add(add(corners[0], corners[1]), add(corners[2], corners[3])));
    Vec3 to_lamp = subtract(vec3(lamp->vector), middle);
    float height = find_incidence(state, lamp, triangle), radius = 0.0f;
    for (int i = 0; i < 4; i++) {
        Vec3 to_corner = subtract(corners[i], middle);
        radius = fmaxf(radius, dot(to_corner, to_corner));
    }
    float distance = fmaxf(sqrtf(dot(to_lamp, to_lamp)) - sqrtf(radius), height);
    float factor = height / (distance * distance * distance);
    Vec3 albedo = vec3(state->scene->mesh->arrays.albedo + 3 * (size_t)triangle);
    return scale(factor, multiply(albedo, vec3(lamp->intensity)));
}

uint32_t find_faint_lamps(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                          uint32_t others) {
    Vec3 ambient = vec3(state->scene->ambient_radiance + 3 * (size_t)triangle);
    uint32_t found = 0;
    if (!state->has_point_lights || !may_skip_lamps(state->frame))
        return 0;
    Vec3 limit = scale(FAINT_PART, (Vec3){allow_light(state->frame, ambient.x),
                                          allow_light(state->frame, ambient.y),
                                          allow_light(state->frame, ambient.z)});
    for (int number = 0; number < state->scene->num_lights && number < 32; number++) {
        const Light *light = &state->scene->lights[number];
        if (others >> number & 1 || light->kind != LIGHT_POINT)
            continue;
        Vec3 bound = bound_lamp(state, light, triangle, corners);
        int is_faint = bound.x <= limit.x && bound.y <= limit.y && bound.z <= limit.z;
        found |= (uint32_t)is_faint << number;
    }
    return found;
}

/* Rays whose light from a lamp nobody misses; it is taken from what they are allowed. */
static uint32_t skip_unseen(const FrameState *state, const Light *light,
                            const float factor[BLOCK_RAYS], uint32_t among,
                            SurfaceBlock *surface) {
    Floats16 left[3];
    Ints16 is_skipped = mask16(among);
    for (int channel = 0; channel < 3; channel++) {
        left[channel] = load16(surface->unseen[channel]) -
                        load16(factor) * load16(surface->albedo[channel]) *
                            light->intensity[channel];
        is_skipped &= left[channel] >= 0.0f;
    }
    if (!bits16(is_skipped))
        return 0;
    for (int channel = 0; channel < 3; channel++)
        store16(select16(is_skipped, left[channel], load16(surface->unseen[channel])),
                surface->unseen[channel]);
    atomic_store_explicit(&state->measures->skips_lamps, 1, memory_order_relaxed);
    return bits16(is_skipped);
}

/* Rays from whose points the light is occluded. */
static uint32_t find_occluded(const FrameState *state, int light, const RayBlock *rays,
                              const HitBlock *hits, SurfaceBlock *surface,
                              const Incidence *incidence, uint32_t facing) {
    const Scene *scene = state->scene;
    const Mesh *casters = scene->casters ? scene->casters : scene->mesh;
    uint32_t hidden = light < 32 && state->known.hidden >> light & 1 ? facing : 0;
    if (light < 32 && (state->known.hidden | state->known.seen) >> light & 1)
        return hidden;
    for (int i = 0; i < surface->num_proven && light < 32; i++) {
        uint32_t rays = facing & surface->proven[i].rays;
        LightProof proof = surface->proven[i].proof;
        hidden |= proof.hidden >> light & 1 ? rays : 0;
        facing &= (proof.hidden | proof.seen) >> light & 1 ? ~rays : 0xffff;
    }
    if (!facing)
        return hidden;
    /* Where maps decide, most of a frame, nobody asks. */
    if (!surface->has_allowed)
        allow_unseen(state, surface);
    facing &= ~skip_unseen(state, &scene->lights[light], incidence->factor, facing, surface);
    if (!facing)
        return hidden;
    Uncertainty found = find_light(state, light, hits, surface->points.position, facing);
    uint32_t occluded = hidden | found.hidden;
    if (!(found.unknown | found.behind_objects))
        return occluded;
    RayBlock shadow;
    set_shadow_rays(&shadow, rays, &surface->points, incidence);
    shadow.active = found.unknown;
    StartFacets starts;
    find_starts(hits, OBJECT_STATIC, &starts);
    starts.numbers = scene->caster_triangles;
    occluded |= occlude_bvh(&casters->bvh, place_of(state), &shadow, &starts);
    shadow.active = found.behind_objects & ~occluded;
    uint32_t by_objects =
        state->objects && shadow.active ? occlude_instances(state, &shadow, hits) : 0;
    /* A moving shadow is not fixed to the surface that it falls on. */
    if (by_objects && state->plan)
        note_apart(state, rays->index);
    occluded |= by_objects;
    return occluded;
}

/* Add intensity times albedo times factor to the rays of a mask. */
static void add_reflected(const Light *light, const SurfaceBlock *surface, const float *factor,
                          uint32_t mask, float radiance[3][BLOCK_RAYS]) {
    Floats16 masked = select16(mask16(mask), load16(factor), splat16(0.0f));
    for (int channel = 0; channel < 3; channel++)
        store16(load16(radiance[channel]) +
                    masked * (load16(surface->albedo[channel]) * light->intensity[channel]),
                radiance[channel]);
}

void add_light(const FrameState *state, int number, const RayBlock *rays, const HitBlock *hits,
               SurfaceBlock *surface, float radiance[3][BLOCK_RAYS], LostLight *lost) {
    const Light *light = &state->scene->lights[number];
    uint32_t added = find_added(state, light, surface);
    if (!added)
        return;
    Incidence incidence;
    if (light->kind == LIGHT_DIRECTIONAL)
        find_parallel(vec3(light->vector), &surface->points, &incidence);
    else
        find_radial(vec3(light->vector), &surface->points, &incidence);
    uint32_t facing = find_facing(&incidence, added), occluded = 0;
    if (facing && state->frame->has_shadows)
        occluded = find_occluded(state, number, rays, hits, surface, &incidence, facing);
    if (facing && state->plan && number < 32 && !state->mirror)
        note_lights(state, rays->index / ((size_t)state->rays->samples * (size_t)state->rays->samples),
                    (LightProof){.seen = (uint32_t)((facing & ~occluded) != 0) << number,
                                 .hidden = (uint32_t)(occluded != 0) << number});
    if (facing & ~occluded)
        add_reflected(light, surface, incidence.factor, facing & ~occluded, radiance);
    if (!lost || !occluded)
        return;
    if (!lost->rays)
        memset(lost->radiance, 0, sizeof lost->radiance);
    add_reflected(light, surface, incidence.factor, occluded, lost->radiance);
    lost->rays |= occluded;
}
