/* Provides flow.h: displacement of the points that pixels show.
 * Float64 twin: frames/labels/label_renderer.py. Owns nothing: tables and the flow are Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "flow.h"

#include "instances.h"
#include "ray_block.h"
#include "tile_place.h"

#include <math.h>

/* Steps for the ray's origin, of a mirror without a viewpoint: each leaves a sixth of the error
 * 0.2 m from a mirror of 3 cm. */
enum { AIM_STEPS = 9 };
enum { AT_REST = -1 };
/* What is nearer to the point than this may be the point's own facet. */
#define SAME_RANGE 2e-3f
#define SAME_RANGE_M 2e-3f
/* Rounding of a position in the tables. */
#define NODE_ROUNDING 1e-6f

/* By component, for vector code: all loops over pixels are loops over lanes. */
typedef float Lanes[TILE_PIXELS];

/* Points in the other image. */
typedef struct {
    _Alignas(64) Lanes u, v;
    float origin[3][TILE_PIXELS]; /* of the rays that meet them, mirror frame */
    int is_shown[TILE_PIXELS];
} Projections;

/* Comparisons that are false of what is not a number keep positions within the tables. */
static inline float limit(float value, float low, float high) {
    float above = value > low ? value : low;
    return above < high ? above : high;
}

/* t / (1 + t) of the angle from the axis, of t = tan(angle / 2): from 0 ahead to 1 behind, where
 * all is smooth, by two quotients of sums that lose no digit. */
static inline float place_on_axis(float rho, float z) {
    float range = sqrtf(rho * rho + z * z);
    return z > 0.0f ? rho / (rho + z + range) : (range - z) / (rho + range - z);
}

static inline float look_up(const Flow *flow, const float *table, float place) {
    float position = (place - flow->first) * flow->nodes_per_unit;
    int node = (int)limit(position, 0.0f, (float)(flow->num_nodes - 2));
    return table[node] + (position - (float)node) * (table[node + 1] - table[node]);
}

/* Where the rays that meet points begin, and the places of their directions. */
static void find_origins(const Flow *flow, const Lanes rho, const Lanes z, Lanes place,
                         Lanes origin_r, Lanes origin_z) {
    float change = INFINITY;
    for (int step = 0; step < AIM_STEPS && change > NODE_ROUNDING; step++) {
        change = 0.0f;
        for (int lane = 0; lane < TILE_PIXELS; lane++) {
            float inside = limit(place[lane], flow->first, flow->last), before = place[lane];
            origin_r[lane] = look_up(flow, flow->origin_r, inside);
            origin_z[lane] = look_up(flow, flow->origin_z, inside);
            place[lane] = place_on_axis(rho[lane] - origin_r[lane], z[lane] - origin_z[lane]);
            float moved = fabsf(place[lane] - before);
            change = moved > change ? moved : change;
        }
    }
}

/* Pixels of points in the mirror frame. */
static void project(const Flow *flow, const RayTable *table, const float points[3][TILE_PIXELS],
                    Projections *found) {
    _Alignas(64) Lanes rho, place, r = {0}, z = {0};
    const float *a = flow->axes;
    for (int lane = 0; lane < TILE_PIXELS; lane++) {
        float x = points[0][lane], y = points[1][lane];
        rho[lane] = sqrtf(x * x + y * y);
        place[lane] = place_on_axis(rho[lane], points[2][lane]);
    }
    if (flow->origin_r)
        find_origins(flow, rho, points[2], place, r, z);
    float width = (float)table->width_px, height = (float)table->height_px;
    for (int lane = 0; lane < TILE_PIXELS; lane++) {
        float radius = look_up(flow, flow->radius_px, place[lane]);
        float inverse = rho[lane] > 0.0f ? 1.0f / rho[lane] : 0.0f;
        float x = points[0][lane] * inverse, y = points[1][lane] * inverse;
        float u = flow->centre_px[0] + radius * (a[0] * x + a[1] * y);
        float v = flow->centre_px[1] + radius * (a[2] * x + a[3] * y);
        found->u[lane] = u;
        found->v[lane] = v;
        found->origin[0][lane] = r[lane] * x;
        found->origin[1][lane] = r[lane] * y;
        found->origin[2][lane] = z[lane];
        found->is_shown[lane] = place[lane] >= flow->first - NODE_ROUNDING &&
                                place[lane] <= flow->last + NODE_ROUNDING && u >= 0.0f &&
                                v >= 0.0f && u < width && v < height;
    }
}

static void clear_points(float points[3][TILE_PIXELS]) {
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < TILE_PIXELS; lane++)
            points[axis][lane] = NAN;
}

/* Points of the pixels where they are in the other exposure, its coordinates; not a number for
 * none. */
static void move_points(const Flow *flow, const TilePlace *place, float points[3][TILE_PIXELS]) {
    if (place->rows < TILE_PX || place->columns < TILE_PX)
        clear_points(points);
    for (int row = 0; row < place->rows; row++)
        for (int column = 0; column < place->columns; column++) {
            size_t at = place->first + (size_t)row * place->width_px + (size_t)column;
            for (int axis = 0; axis < 3; axis++)
                points[axis][row * TILE_PX + column] =
                    (float)((double)flow->points[3 * at + (size_t)axis] - flow->centre[axis]);
        }
    for (int row = 0; row < place->rows; row++)
        for (int column = 0; column < place->columns; column++) {
            size_t at = place->first + (size_t)row * place->width_px + (size_t)column;
            int32_t motion = flow->motion_of[flow->ids[at]];
            int lane = row * TILE_PX + column;
            if (motion < AT_REST)
                set_lane(points, lane, (Vec3){NAN, NAN, NAN});
            else if (motion != AT_REST)
                set_lane(points, lane,
                         add(rotate(flow->motions[motion].rotation,
                                    get_lane((const float(*)[BLOCK_RAYS])points, lane)),
                             vec3(flow->motions[motion].translation)));
        }
}

static void turn_to_mirror(const Pose *camera, float points[3][TILE_PIXELS]) {
    const float *r = camera->rotation, *t = camera->translation;
    for (int lane = 0; lane < TILE_PIXELS; lane++) {
        float x = points[0][lane] - t[0], y = points[1][lane] - t[1], z = points[2][lane] - t[2];
        points[0][lane] = r[0] * x + r[3] * y + r[6] * z;
        points[1][lane] = r[1] * x + r[4] * y + r[7] * z;
        points[2][lane] = r[2] * x + r[5] * y + r[8] * z;
    }
}

/* Rays from the mirror at points of the mirror frame, up to just before them. */
static void aim_rays(const Pose *camera, const Projections *projections,
                     const float points[3][TILE_PIXELS], RayBlock *rays) {
    const float *r = camera->rotation, *t = camera->translation;
    uint32_t active = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        float x = points[0][lane] - projections->origin[0][lane];
        float y = points[1][lane] - projections->origin[1][lane];
        float z = points[2][lane] - projections->origin[2][lane];
        float distance = sqrtf(x * x + y * y + z * z);
        int is_ray = projections->is_shown[lane] && distance > 0.0f;
        /* Rays of lanes that are not traced have a direction, too. */
        x = is_ray ? x / distance : 0.0f;
        y = is_ray ? y / distance : 0.0f;
        z = is_ray ? z / distance : 1.0f;
        for (int axis = 0; axis < 3; axis++)
            rays->direction[axis][lane] =
                r[3 * axis] * x + r[3 * axis + 1] * y + r[3 * axis + 2] * z;
        rays->limit[lane] = is_ray ? distance * (1.0f - SAME_RANGE) - SAME_RANGE_M : 0.0f;
        rays->time[lane] = 0.0f;
    }
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->origin[axis][lane] = t[axis] + r[3 * axis] * projections->origin[0][lane] +
                                       r[3 * axis + 1] * projections->origin[1][lane] +
                                       r[3 * axis + 2] * projections->origin[2][lane];
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        active |= (uint32_t)(rays->limit[lane] > 0.0f) << lane;
    rays->active = active;
    rays->has_origins = 1;
    rays->index = 0;
}

static uint32_t find_occluded(const FrameState *state, const RayBlock *rays) {
    uint32_t occluded = occlude_bvh(&state->scene->mesh->bvh, place_of(state), rays, NULL);
    return state->objects ? occluded | occlude_instances(state, rays, NULL) : occluded;
}

static void store_flow(const Flow *flow, const TilePlace *place, const Lanes u, const Lanes v,
                       uint32_t visible) {
    for (int row = 0; row < place->rows; row++)
        for (int column = 0; column < place->columns; column++) {
            int lane = row * TILE_PX + column;
            float *value = flow->flow + 2 * (place->first + (size_t)row * place->width_px +
                                             (size_t)column);
            int is_visible = visible >> lane & 1;
            value[0] = is_visible ? u[lane] - ((float)(place->left + column) + 0.5f) : NAN;
            value[1] = is_visible ? v[lane] - ((float)(place->top + row) + 0.5f) : NAN;
        }
}

void flow_tile(const FrameState *state, int tile) {
    const Flow *flow = state->frame->flow;
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    _Alignas(64) float points[3][TILE_PIXELS];
    Projections found;
    RayBlock rays;
    uint32_t shown = 0;
    move_points(flow, &place, points);
    turn_to_mirror(&state->camera, points);
    project(flow, state->rays, (const float(*)[TILE_PIXELS])points, &found);
    aim_rays(&state->camera, &found, (const float(*)[TILE_PIXELS])points, &rays);
    for (int lane = 0; lane < TILE_PIXELS; lane++)
        shown |= (uint32_t)found.is_shown[lane] << lane;
    store_flow(flow, &place, found.u, found.v, shown & ~find_occluded(state, &rays));
}

void flow_beside_view(const Flow *flow, const View *view) {
    static const Lanes unknown;
    for (int number = 0; number < view->tile_rows * view->rays.tile_columns; number++) {
        TilePlace place = place_tile(&view->rays, number);
        if (view->tile_at[number] < 0)
            store_flow(flow, &place, unknown, unknown, 0);
    }
}
