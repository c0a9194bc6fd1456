#include "flow.h"

#include "packets.h"

#include <math.h>

/* Steps for the ray's origin, of a mirror without a viewpoint: each leaves a sixth of the error
 * 0.2 m from a mirror of 3 cm. */
enum { AIM_STEPS = 9 };
enum { AT_REST = -1 };
/* What is nearer to the point than this may be the point's own facet. */
#define SAME_RANGE 2e-3f
#define SAME_RANGE_M 2e-3f
#define ANGLE_ROUNDING 1e-6f
#define AIM_ROUNDING 1e-6f

/* A point in the other image. */
typedef struct {
    float u, v;
    Vec3 origin; /* of the ray that meets it, mirror frame */
} Projection;

static float look_up(const Flow *flow, const float *table, float angle) {
    float position = (angle - flow->first_rad) / flow->step_rad;
    float last = (float)(flow->num_nodes - 2);
    float node = floorf(fminf(fmaxf(position, 0.0f), last));
    const float *values = table + (int)node;
    return values[0] + (position - node) * (values[1] - values[0]);
}

static int project(const Flow *flow, Vec3 point, Projection *result) {
    float rho = sqrtf(point.x * point.x + point.y * point.y), r = 0.0f, z = 0.0f;
    float angle = atan2f(rho, point.z), end = flow->last_rad;
    for (int step = 0; flow->origin_r && step < AIM_STEPS; step++) {
        float inside = fminf(fmaxf(angle, flow->first_rad), end);
        r = look_up(flow, flow->origin_r, inside);
        z = look_up(flow, flow->origin_z, inside);
        float before = angle;
        angle = atan2f(rho - r, point.z - z);
        if (fabsf(angle - before) < AIM_ROUNDING)
            break;
    }
    if (!(angle >= flow->first_rad - ANGLE_ROUNDING && angle <= end + ANGLE_ROUNDING))
        return 0;
    float radius = look_up(flow, flow->radius_px, angle);
    float x = rho > 0.0f ? point.x / rho : 0.0f, y = rho > 0.0f ? point.y / rho : 0.0f;
    result->u = flow->centre_px[0] + radius * (flow->axes[0] * x + flow->axes[1] * y);
    result->v = flow->centre_px[1] + radius * (flow->axes[2] * x + flow->axes[3] * y);
    result->origin = (Vec3){r * x, r * y, z};
    return 1;
}

/* The point of a pixel where it is in the other exposure, in Embree's coordinates; 0 for none. */
static int find_point(const Flow *flow, size_t at, Vec3 *point) {
    const float *here = flow->points + 3 * at;
    int32_t motion = flow->motion_of[flow->ids[at]];
    if (isnan(here[0]) || motion < AT_REST)
        return 0;
    *point = (Vec3){(float)((double)here[0] - flow->centre[0]),
                    (float)((double)here[1] - flow->centre[1]),
                    (float)((double)here[2] - flow->centre[2])};
    if (motion != AT_REST)
        *point = add(rotate(flow->motions[motion].rotation, *point),
                     vec3(flow->motions[motion].translation));
    return 1;
}

/* Aim a lane's ray from the mirror at a point, up to just before it. */
static void aim_lane(const FrameState *state, const Projection *projection, Vec3 point, int lane,
                     RayBlock *rays) {
    Vec3 from_origin = subtract(point, projection->origin);
    float distance = sqrtf(dot(from_origin, from_origin));
    const float *rotation = state->camera.rotation;
    set_lane(rays->direction, lane, rotate(rotation, scale(1.0f / distance, from_origin)));
    set_lane(rays->origin, lane,
             add(rotate(rotation, projection->origin), vec3(state->camera.translation)));
    rays->limit[lane] = distance * (1.0f - SAME_RANGE) - SAME_RANGE_M;
    if (rays->limit[lane] > 0.0f)
        rays->active |= 1u << lane;
}

void flow_tile(const FrameState *state, int tile) {
    const Flow *flow = state->frame->flow;
    const RayTable *table = state->rays;
    int32_t number = table->tiles[tile];
    int top = number / table->tile_columns * TILE_PX;
    int left = number % table->tile_columns * TILE_PX;
    Projection projections[BLOCK_RAYS];
    RayBlock rays = {.has_origins = 1};
    uint32_t shown = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int row = top + lane / TILE_PX, column = left + lane % TILE_PX;
        Vec3 point;
        /* Rays of lanes that are not traced have a direction, too. */
        rays.direction[2][lane] = 1.0f;
        if (row >= table->height_px || column >= table->width_px ||
            !find_point(flow, (size_t)row * (size_t)table->width_px + (size_t)column, &point))
            continue;
        Vec3 in_mirror = rotate_back(state->camera.rotation,
                                     subtract(point, vec3(state->camera.translation)));
        Projection *found = &projections[lane];
        if (!project(flow, in_mirror, found) || !(found->u >= 0.0f) || !(found->v >= 0.0f) ||
            !(found->u < (float)table->width_px) || !(found->v < (float)table->height_px))
            continue;
        shown |= 1u << lane;
        aim_lane(state, found, in_mirror, lane, &rays);
    }
    uint32_t hidden = 0;
    if (rays.active && state->scene->mesh->scene)
        hidden |= occlude_block(state->device, state->scene->mesh->scene, &rays, 1);
    if (rays.active && state->objects)
        hidden |= occlude_block(state->device, state->objects, &rays, 1);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(shown >> lane & 1) || hidden >> lane & 1)
            continue;
        int row = top + lane / TILE_PX, column = left + lane % TILE_PX;
        float *value = flow->flow + 2 * ((size_t)row * (size_t)table->width_px + (size_t)column);
        value[0] = projections[lane].u - ((float)column + 0.5f);
        value[1] = projections[lane].v - ((float)row + 0.5f);
    }
}
