/* Provides blur_intervals.h: a whole exposure of a few pixels by bits of time.
 * Float64 twin: reference/reference_engine.py, the mean of sharp frames. Owns nothing: sets of
 * triangles are on the stack of the tile.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "blur_intervals.h"

#include "body_shade.h"
#include "measures.h"
#include "occlusion.h"
#include "pixels.h"
#include "plane_light.h"

#include <math.h>
#include <string.h>

/* Volume of corners below which a triangle covers less than a tenth of a pixel, relative to the
 * product of their distances. */
#define MIN_VOLUME 1e-6f
/* Rays between the corners of a tile meet a plane beside the parallelogram of theirs by less. */
#define MARGIN 0.05f
/* Square of a step between two times, relative to the distance of a lamp: its light, at most
 * 12 times as curved as such steps are long, deviates from a chord by less than 0.5 %. */
#define MAX_EVEN_STEP 0.005f

typedef Floats16 Floats;
typedef Ints16 Masks; /* 0 or -1; or bits */

int collect_triangles(const FrameState *state, const CandidateList *candidates, TriangleSet *set) {
    set->count = 0;
    set->viewpoint = vec3(state->camera.translation);
    for (int i = 0; i < candidates->count; i++) {
        int32_t id = candidates->id[i];
        if (candidate_object(id) != OBJECT_STATIC)
            continue;
        if (id == CLUSTER || set->count == MAX_MOVING)
            return 0;
        if (is_filtered(&state->scene->mesh->arrays, id))
            return 0;
        for (int corner = 0; corner < 3; corner++)
            set->corners[set->count][corner] = candidate_corner(candidates, i, corner);
        set->triangle[set->count++] = id;
    }
    return 1;
}

/* A box along the world's axes. */
typedef struct {
    float low[3], high[3];
} Box;

static void enclose_point(Box *box, Vec3 point) {
    float values[3] = {point.x, point.y, point.z};
    for (int axis = 0; axis < 3; axis++) {
        box->low[axis] = fminf(box->low[axis], values[axis]);
        box->high[axis] = fmaxf(box->high[axis], values[axis]);
    }
}

/* Where the corner rays of a tile meet a plane at an instant; 0 if one does not. */
static int enclose_footprint(const FrameState *state, int tile, float time, Vec3 first, Vec3 normal,
                             Box *box) {
    int samples = state->rays->samples, last = TILE_PX - 1;
    int blocks[4] = {0, samples - 1, samples * (samples - 1), samples * samples - 1};
    int lanes[4] = {0, last, TILE_PX * last, BLOCK_RAYS - 1};
    FrameState moved = at_instant(state, time);
    Vec3 viewpoint = vec3(moved.camera.translation);
    float height = dot(normal, subtract(first, viewpoint));
    for (int i = 0; i < 4; i++) {
        size_t block = (size_t)tile * (size_t)(samples * samples) + (size_t)blocks[i];
        const float *from = state->rays->directions + block * 3 * BLOCK_RAYS + lanes[i];
        Vec3 seen = rotate(moved.camera.rotation,
                           (Vec3){from[0], from[BLOCK_RAYS], from[2 * BLOCK_RAYS]});
        float distance = height / dot(normal, seen);
        if (!(state->rays->valid[block] >> lanes[i] & 1) || !(distance > 0.0f))
            return 0;
        enclose_point(box, add(viewpoint, scale(distance, seen)));
    }
    return 1;
}

static const Box NOWHERE = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

/* What the exposure shows of a triangle's plane in a tile; 0 if some ray does not meet it. */
static int enclose_plane(const FrameState *state, int tile, int32_t triangle, Box *box) {
    Vec3 first = plane_point(state, triangle);
    Vec3 normal = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    float half = 0.5f * state->frame->exposure + 0.5f * state->frame->readout;
    *box = NOWHERE;
    for (int i = -1; i <= 1; i++)
        if (!enclose_footprint(state, tile, 0.5f + (float)i * half, first, normal, box))
            return 0;
    for (int axis = 0; axis < 3; axis++) {
        float margin = MARGIN * (box->high[axis] - box->low[axis]);
        box->low[axis] -= margin;
        box->high[axis] += margin;
    }
    return 1;
}

/* What the exposure shows of a triangle at most: what a tile sees of its plane, and itself. */
static Box enclose_visible(const FrameState *state, int tile, int32_t triangle) {
    Box whole = NOWHERE, plane;
    for (int corner = 0; corner < 3; corner++)
        enclose_point(&whole, scene_corner(state, triangle, corner));
    if (!enclose_plane(state, tile, triangle, &plane))
        return whole;
    for (int axis = 0; axis < 3; axis++) {
        whole.low[axis] = fmaxf(whole.low[axis], plane.low[axis]);
        whole.high[axis] = fminf(whole.high[axis], plane.high[axis]);
    }
    return whole;
}

/* Corners of a plane's part within a box: those of the box along the plane's steepest axis. */
static void find_corners(const Box *box, Vec3 first, Vec3 normal, Vec3 corners[4]) {
    float n[3] = {normal.x, normal.y, normal.z}, f[3] = {first.x, first.y, first.z};
    int up = 0;
    for (int axis = 1; axis < 3; axis++)
        up = fabsf(n[axis]) > fabsf(n[up]) ? axis : up;
    int across = (up + 1) % 3, down = (up + 2) % 3;
    for (int i = 0; i < 4; i++) {
        float point[3];
        point[across] = i % 2 ? box->high[across] : box->low[across];
        point[down] = i / 2 ? box->high[down] : box->low[down];
        point[up] = f[up] - (n[across] * (point[across] - f[across]) +
                             n[down] * (point[down] - f[down])) / n[up];
        corners[i] = vec3(point);
    }
}

static void find_plane_corners(const FrameState *state, const Box *box, int32_t triangle,
                               Vec3 corners[4]) {
    find_corners(box, plane_point(state, triangle),
                 vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle), corners);
}

int enclose_moving_plane(const FrameState *state, int tile, int32_t triangle, Vec3 corners[4]) {
    Box box;
    if (!enclose_plane(state, tile, triangle, &box))
        return 0;
    find_plane_corners(state, &box, triangle, corners);
    return 1;
}

/* The instants between the parts of the exposure, and the edges of a tile's beam in the world. */
typedef struct {
    int count;
    const Pose *poses;
    Vec3 edges[MAX_PARTS + 1][4];
    Vec3 mirror_edges[4];
} Instants;

static void light_triangle(int tile, MovingScene *scene, MovingTriangle *moving) {
    const FrameState *state = scene->state;
    int32_t triangle = moving->triangle;
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    moving->is_constant =
        !(mesh->flags[triangle] & (FACET_TEXTURED | FACET_COMPUTED | FACET_TWO_SIDED)) &&
        !is_glossy(state, triangle);
    int is_occluded = has_occlusion(state->scene, triangle);
    moving->is_occluded = 0;
    LightProof proof = {0, 0};
    int is_unlit = state->frame->has_shadows && !are_lights_known(state, triangle, &proof);
    int may_shade = moving->is_constant && state->frame->shades;
    if (is_unlit || may_shade || (moving->is_constant && is_occluded)) {
        Vec3 corners[4];
        Box box = enclose_visible(state, tile, triangle);
        find_plane_corners(state, &box, triangle, corners);
        if (is_unlit)
            proof = prove_lights(state, triangle, corners, 0);
        if (is_occluded)
            moving->is_occluded = find_sky_view(state->scene, triangle, corners) != SKY_OPEN;
        /* What a body takes of baked light, rays find. */
        if (may_shade && may_be_shaded(state, corners))
            moving->is_constant = 0;
    }
    PlaneLight light = {.radiance = {0, 0, 0}};
    moving->is_constant = moving->is_constant && find_light_beside_lamps(state, triangle, proof,
                                                                         &light, &moving->lamps);
    /* Rays measure what shadows take where the sharp frame shows none. */
    if (state->measures->blurs_unseen_shadows && (proof.hidden || max_abs(light.lost) > 0.0f))
        moving->is_constant = 0;
    moving->radiance = light.radiance;
    if (state->frame->has_shadows && scene->proofs.count < MAX_PROVEN) {
        scene->proofs.triangle[scene->proofs.count] = triangle;
        scene->proofs.proof[scene->proofs.count++] = proof;
    }
    if (!moving->is_constant)
        return;
    for (int i = 0; moving->lamps && i <= scene->parts; i++)
        moving->normal[i] = rotate_back(scene->poses[i].rotation,
                                        vec3(mesh->normals + 3 * (size_t)triangle));
    if (!moving->is_occluded)
        return;
    moving->light = light.radiance;
    moving->ambient = vec3(state->scene->ambient_radiance + 3 * (size_t)triangle);
    for (int i = 0; i <= scene->parts; i++)
        moving->atlas[i] = find_atlas_rays(state->scene, triangle, &scene->poses[i]);
}

static int find_instants(const FrameState *state, int tile, float centre, int parts, Pose *poses,
                         Instants *instants) {
    const Beam *beam = &state->view->levels[0].beams[state->rays->tiles[tile]];
    if (!list_beam_edges(beam, instants->mirror_edges))
        return 0;
    instants->count = parts + 1;
    instants->poses = poses;
    for (int i = 0; i <= parts; i++) {
        Pose *pose = &poses[i];
        float phase = (float)i / (float)parts - 0.5f;
        rigid_pose_at(state->frame->camera, state->frame->num_poses, 1,
                      centre + phase * state->frame->exposure, pose);
        for (int ray = 0; ray < 4; ray++)
            instants->edges[i][ray] = rotate(pose->rotation, instants->mirror_edges[ray]);
    }
    return 1;
}

/* A triangle from the viewpoints of some instants. */
typedef struct {
    Vec3 normals[MAX_PARTS + 1][3]; /* of the planes through its edges, as long as these planes */
    float volumes[MAX_PARTS + 1];   /* of its corners, above zero if the normals point inwards */
} Planes;

/* Where the rays of a tile lie during the exposure: beside the triangle, or one that is seen as a
 * line; across an edge; within it. Where its plane passes the viewpoint nothing is known. */
typedef enum { BESIDE, ACROSS, WITHIN, UNKNOWN } Place;

static void find_planes(const TriangleSet *set, int at, const Instants *instants, Planes *planes) {
    for (int i = 0; i < instants->count; i++) {
        Vec3 offset = subtract(set->viewpoint, vec3(instants->poses[i].translation)), corners[3];
        for (int corner = 0; corner < 3; corner++)
            corners[corner] = add(set->corners[at][corner], offset);
        for (int side = 0; side < 3; side++)
            planes->normals[i][side] =
                cross(corners[(side + 1) % 3], corners[(side + 2) % 3]);
        planes->volumes[i] = dot(corners[0], planes->normals[i][0]);
    }
}

static Place find_place(const Planes *planes, const Instants *instants, uint8_t *across) {
    int count = instants->count, front = 0;
    for (int i = 0; i < count; i++)
        front += planes->volumes[i] > 0.0f;
    if (front && front < count)
        return UNKNOWN;
    *across = 0;
    for (int side = 0; side < 3; side++) {
        int inside = 0;
        for (int i = 0; i < count; i++)
            for (int ray = 0; ray < 4; ray++)
                inside += (dot(planes->normals[i][side], instants->edges[i][ray]) > 0.0f) ==
                          (front > 0);
        if (!inside)
            return BESIDE;
        *across |= (uint8_t)((inside < 4 * count) << side);
    }
    return *across ? ACROSS : WITHIN;
}

/* Whether the triangle covers less than a tenth of a pixel at some instant. */
static int is_line(const TriangleSet *set, int at, const Planes *planes, int count) {
    float product = 1.0f, least = INFINITY;
    for (int corner = 0; corner < 3; corner++)
        product *= dot(set->corners[at][corner], set->corners[at][corner]);
    for (int i = 0; i < count; i++)
        least = fminf(least, fabsf(planes->volumes[i]));
    return !(least > MIN_VOLUME * sqrtf(product));
}

/* Whether a triangle is farther than another along all rays of a tile. */
static int is_farther(const MovingTriangle *moving, const MovingTriangle *other, int parts,
                      const Vec3 edges[4]) {
    for (int i = 0; i <= parts; i++) {
        Vec3 difference = subtract(other->sum[i], moving->sum[i]);
        for (int ray = 0; ray < 4; ray++)
            if (!(dot(difference, edges[ray]) > 0.0f))
                return 0;
    }
    return 1;
}

/* Drop what a triangle that fills the tile hides. */
static void drop_hidden(MovingScene *scene, const MovingTriangle *cover, const Vec3 edges[4]) {
    MovingTriangle kept = *cover; /* it moves to another place of the list */
    int count = scene->count;
    scene->count = 0;
    for (int i = 0; i < count; i++) {
        if (is_farther(&scene->triangles[i], &kept, scene->parts, edges))
            continue;
        if (scene->count < i)
            scene->triangles[scene->count] = scene->triangles[i];
        scene->count++;
    }
}

/* A triangle at the end of a list; 0 if it passes through the viewpoint. */
static int move_triangle(const TriangleSet *set, int at, const Instants *instants,
                         MovingScene *scene) {
    Planes planes;
    uint8_t across;
    find_planes(set, at, instants, &planes);
    Place place = find_place(&planes, instants, &across);
    if (place == UNKNOWN)
        return 0;
    if (place == BESIDE || is_line(set, at, &planes, instants->count))
        return 1;
    MovingTriangle *moving = &scene->triangles[scene->count++];
    moving->triangle = set->triangle[at];
    moving->source = at;
    moving->across = across;
    for (int i = 0; i < instants->count; i++) {
        Vec3 *dual = moving->dual[i];
        for (int side = 0; side < 3; side++)
            dual[side] = rotate_back(instants->poses[i].rotation,
                                     scale(1.0f / planes.volumes[i], planes.normals[i][side]));
        moving->sum[i] = add(add(dual[0], dual[1]), dual[2]);
    }
    if (place == WITHIN)
        drop_hidden(scene, moving, instants->mirror_edges);
    return 1;
}

/* Parts in which edges may be taken to move evenly: at most 8 px long, whose arcs of a hundred
 * pixels' radius are 0.08 px off their chords. */
static int count_parts(int steps) { return steps / 4 > 2 ? steps / 4 : 2; }

/* Times of a block's rays within the bins: those of the four samples of a pixel differ, so that
 * together they have 64 about the middle. In the order of ray_order.c: 4 x 4 samples of 2 x 2
 * pixels, or four pixels in turns. */
static const Floats BY_CELL = {0.125f, 0.625f, 0.125f, 0.625f, 0.375f, 0.875f, 0.375f, 0.875f,
                               0.125f, 0.625f, 0.125f, 0.625f, 0.375f, 0.875f, 0.375f, 0.875f};
static const Floats IN_TURNS = {0.125f, 0.125f, 0.125f, 0.125f, 0.625f, 0.625f, 0.625f, 0.625f,
                                0.375f, 0.375f, 0.375f, 0.375f, 0.875f, 0.875f, 0.875f, 0.875f};

static Floats find_phases(const FrameState *state) {
    if (state->rays->samples == 1)
        return (Floats){0} + 0.5f;
    return state->is_rolling || !state->view->by_cell.is_table ? IN_TURNS : BY_CELL;
}

int move_triangles(const FrameState *state, int tile, const TriangleSet *set, float centre,
                   int steps, MovingScene *scene) {
    int parts = count_parts(steps);
    Instants instants;
    if (parts > MAX_PARTS || !find_instants(state, tile, centre, parts, scene->poses, &instants))
        return 0;
    scene->parts = parts;
    scene->bins = (steps > 2 ? 32 : 16) / parts;
    scene->phases = find_phases(state);
    scene->centre = centre;
    scene->state = state;
    scene->count = scene->proofs.count = 0;
    for (int at = 0; at < set->count; at++)
        if (!move_triangle(set, at, &instants, scene))
            return 0;
    for (int i = 0; i < scene->count; i++)
        light_triangle(tile, scene, &scene->triangles[i]);
    scene->background = vec3(state->scene->sharp_radiance +
                             3 * (size_t)state->scene->mesh->arrays.num_triangles);
    return 1;
}

int list_moving(const TriangleSet *set, const MovingScene *scene, ShortList *list) {
    list->count = 0;
    list->viewpoint = set->viewpoint;
    list->middle = (Vec3){0, 0, 0};
    list->radius = 0.0f;
    for (int i = 0; i < scene->count; i++) {
        if (list->count == MAX_SHORT)
            return 0;
        memcpy(list->corners[list->count], set->corners[scene->triangles[i].source],
               sizeof list->corners[0]);
        list->triangles[list->count++].triangle = scene->triangles[i].triangle;
    }
    return 1;
}

static inline int any(Masks masks) { return bits16(masks != 0) != 0; }

/* Bits of the times at which values, linear between those at the ends of the parts, are below
 * zero. */
static inline Masks find_below(const MovingScene *scene, const Floats *values) {
    int parts = scene->parts, bins = scene->bins;
    Masks bits = {0};
    for (int part = 0; part < parts; part++) {
        Masks begin = values[part] < 0.0f, end = values[part + 1] < 0.0f;
        if (!any(begin | end))
            continue;
        if (!any(~(begin & end))) {
            bits |= (int32_t)((0xffffffffu >> (32 - bins)) << (part * bins));
            continue;
        }
        Floats step = (values[part + 1] - values[part]) * (1.0f / (float)bins);
        Floats value = values[part] + scene->phases * step;
        Masks bit = (Masks){0} + (int32_t)(1u << (part * bins));
        for (int bin = 0; bin < bins; bin++, value += step, bit += bit)
            bits |= (value < 0.0f) & bit;
    }
    return bits;
}

/* The directions of a block, and its times: all, of the rays that are there. */
typedef struct {
    Floats x, y, z;
    Masks times;
} Directions;

static inline Floats project(const Directions *rays, Vec3 a) {
    return a.x * rays->x + a.y * rays->y + a.z * rays->z;
}

/* A triangle that the rays of a block meet at some time. */
typedef struct {
    Masks met, seen; /* bits of the times */
    const MovingTriangle *triangle;
} Visible;

/* Whether any of the rays meets a triangle, and when. */
static inline int meet_triangle(const MovingScene *scene, const MovingTriangle *triangle,
                                const Directions *rays, Visible *found) {
    Masks met = rays->times;
    for (int side = 0; side < 3; side++) {
        Floats sides[MAX_PARTS + 1];
        if (!(triangle->across >> side & 1))
            continue;
        for (int i = 0; i <= scene->parts; i++)
            sides[i] = project(rays, triangle->dual[i][side]);
        met &= ~find_below(scene, sides);
        if (!any(met))
            return 0;
    }
    found->met = found->seen = met;
    found->triangle = triangle;
    return 1;
}

/* Take from two triangles what one hides of the other. */
static void hide_farther(Visible *one, Visible *other, const MovingScene *scene,
                         const Directions *rays) {
    Masks both = one->met & other->met;
    if (!any(both))
        return;
    Floats nearer[MAX_PARTS + 1];
    for (int i = 0; i <= scene->parts; i++)
        nearer[i] = project(rays, subtract(one->triangle->sum[i], other->triangle->sum[i]));
    Masks is_farther = find_below(scene, nearer);
    one->seen &= ~(other->met & is_farther);
    other->seen &= ~(one->met & ~is_farther);
}

/* Fractions of the exposure. */
static Floats count_bits(Masks bits, float weight) {
    Floats counts;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        counts[lane] = weight * (float)__builtin_popcount((unsigned)bits[lane]);
    return counts;
}

/* Add a radiance for some of the times. */
static void add_times(Vec3 light, Floats weights, float radiance[3][BLOCK_RAYS]) {
    float parts[3] = {light.x, light.y, light.z};
    for (int channel = 0; channel < 3; channel++)
        store16(load16(radiance[channel]) + parts[channel] * weights, radiance[channel]);
}

/* The same of a triangle from which a part of the sky is hidden. */
static void add_occluded_times(const MovingScene *scene, const Visible *visible,
                               const RayBlock *rays, const Directions *directions, Floats weights,
                               float radiance[3][BLOCK_RAYS]) {
    const MovingTriangle *triangle = visible->triangle;
    _Alignas(64) float inverse[MAX_PARTS + 1][BLOCK_RAYS], factors[3][BLOCK_RAYS];
    _Alignas(64) int32_t seen[BLOCK_RAYS];
    for (int i = 0; i <= scene->parts; i++)
        store16(project(directions, triangle->sum[i]), inverse[i]);
    store_ints16(visible->seen, seen);
    OcclusionTimes times = {scene->parts, scene->bins, triangle->atlas,
                            (const float(*)[BLOCK_RAYS])inverse};
    find_mean_factors(scene->state->scene, triangle->triangle, &times, rays, seen, factors);
    float light[3] = {triangle->light.x, triangle->light.y, triangle->light.z};
    float ambient[3] = {triangle->ambient.x, triangle->ambient.y, triangle->ambient.z};
    for (int channel = 0; channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            radiance[channel][i] +=
                weights[i] * (light[channel] - (1.0f - factors[channel][i]) * ambient[channel]);
}

/* Where the rays of a block meet a triangle's plane at the ends of the parts, and for how long they
 * see it about each. */
typedef struct {
    Floats x, y, z, share;
} Meeting;

static void find_meetings(const MovingScene *scene, const Visible *visible,
                          const Directions *rays, Meeting meetings[MAX_PARTS + 1]) {
    float step = 1.0f / (float)scene->bins, weight = step / (float)scene->parts;
    for (int i = 0; i <= scene->parts; i++) {
        Floats distance = 1.0f / project(rays, visible->triangle->sum[i]);
        meetings[i] = (Meeting){rays->x * distance, rays->y * distance, rays->z * distance, {0}};
    }
    for (int bin = 0; bin < scene->parts * scene->bins; bin++) {
        float nearness = ((float)(bin % scene->bins) + 0.5f) * step;
        Masks is_seen = -(visible->seen >> bin & 1);
        Floats share = (Floats)(is_seen & (Masks)(weight - (Floats){0}));
        meetings[bin / scene->bins].share += (1.0f - nearness) * share;
        meetings[bin / scene->bins + 1].share += nearness * share;
    }
}

/* Add the light of a lamp over those times; 0 where it does not change evenly. */
static int add_lamp(const MovingScene *scene, const MovingTriangle *triangle, const Light *light,
                    const Meeting meetings[MAX_PARTS + 1], float radiance[3][BLOCK_RAYS]) {
    Floats sum = {0}, x = {0}, y = {0}, z = {0}, last_share = {0};
    Masks is_uneven = {0};
    for (int i = 0; i <= scene->parts; i++) {
        const Pose *pose = &scene->poses[i];
        Vec3 n = triangle->normal[i];
        Vec3 lamp = rotate_back(pose->rotation,
                                subtract(vec3(light->vector), vec3(pose->translation)));
        Floats last_x = x, last_y = y, last_z = z;
        x = lamp.x - meetings[i].x;
        y = lamp.y - meetings[i].y;
        z = lamp.z - meetings[i].z;
        Floats squared = x * x + y * y + z * z;
        squared = select16(squared > MIN_SQUARED_DISTANCE, squared, splat16(MIN_SQUARED_DISTANCE));
        Floats cosine = n.x * x + n.y * y + n.z * z, length;
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            length[lane] = __builtin_sqrtf(squared[lane]);
        cosine = select16(cosine > 0.0f, cosine, splat16(0.0f));
        /* A plane need not be met at a time at which no ray sees the triangle. */
        Floats factor = meetings[i].share * cosine / (squared * length);
        sum += select16(meetings[i].share > 0.0f, factor, splat16(0.0f));
        last_x -= x;
        last_y -= y;
        last_z -= z;
        Floats moved = last_x * last_x + last_y * last_y + last_z * last_z;
        is_uneven |= (last_share > 0.0f) & (meetings[i].share > 0.0f) &
                     ~(moved < MAX_EVEN_STEP * squared);
        last_share = meetings[i].share;
    }
    if (any(is_uneven))
        return 0;
    Vec3 albedo =
        vec3(scene->state->scene->mesh->arrays.albedo + 3 * (size_t)triangle->triangle);
    add_times(multiply(albedo, vec3(light->intensity)), sum, radiance);
    return 1;
}

/* Add the light of the lamps that a triangle sees; 0 where one does not change evenly. */
static int add_lamps(const MovingScene *scene, const Visible *visible, const Directions *rays,
                     float radiance[3][BLOCK_RAYS]) {
    const Scene *lit = scene->state->scene;
    Meeting meetings[MAX_PARTS + 1];
    find_meetings(scene, visible, rays, meetings);
    for (int light = 0; visible->triangle->lamps >> light && light < lit->num_lights; light++)
        if (visible->triangle->lamps >> light & 1 &&
            !add_lamp(scene, visible->triangle, &lit->lights[light], meetings, radiance))
            return 0;
    return 1;
}

int integrate_block(const MovingScene *scene, const RayBlock *rays, float radiance[3][BLOCK_RAYS]) {
    Visible visible[MAX_MOVING]; /* not initialized: mostly two or three are used */
    int32_t all = (int32_t)(0xffffffffu >> (32 - scene->parts * scene->bins));
    Directions directions = {load16(rays->direction[0]), load16(rays->direction[1]),
                             load16(rays->direction[2]), {0}};
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        directions.times[lane] = rays->active >> lane & 1 ? all : 0;
    int count = 0;
    for (int i = 0; i < scene->count; i++)
        count += meet_triangle(scene, &scene->triangles[i], &directions, &visible[count]);
    for (int i = 1; i < count; i++)
        for (int k = 0; k < i; k++)
            hide_farther(&visible[k], &visible[i], scene, &directions);
    for (int i = 0; i < count; i++)
        if (!visible[i].triangle->is_constant && any(visible[i].seen))
            return 0;
    Masks left = directions.times;
    float weight = 1.0f / (float)(scene->parts * scene->bins);
    for (int i = 0; i < count; i++) {
        if (!any(visible[i].seen))
            continue;
        Floats weights = count_bits(visible[i].seen, weight);
        if (visible[i].triangle->is_occluded)
            add_occluded_times(scene, &visible[i], rays, &directions, weights, radiance);
        else
            add_times(visible[i].triangle->radiance, weights, radiance);
        if (visible[i].triangle->lamps &&
            !add_lamps(scene, &visible[i], &directions, radiance))
            return 0;
        left &= ~visible[i].seen;
    }
    /* What changes with the direction is sampled at instants. */
    if (any(left) && scene->state->scene->sky)
        return 0;
    if (any(left))
        add_times(scene->background, count_bits(left, weight), radiance);
    return 1;
}
