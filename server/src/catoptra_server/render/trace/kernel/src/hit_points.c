/* Provides hit_points.h: points and distances of hits from ray and triangle alone.
 * Float64 twin: reference/triangle_search.py. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "hit_points.h"

#include <math.h>
#include <string.h>

/* A ray and its triangle for each lane, in the frame of the triangle's mesh. */
typedef struct {
    _Alignas(64) float origin[3][BLOCK_RAYS];
    float direction[3][BLOCK_RAYS];
    float first[3][BLOCK_RAYS]; /* corner 0 */
    float edge_u[3][BLOCK_RAYS];
    float edge_v[3][BLOCK_RAYS];
} PlaneQueries;

static void set_triangle(PlaneQueries *queries, uint32_t lanes, Vec3 first, Vec3 second,
                         Vec3 third) {
    set_lanes(queries->first, lanes, first);
    set_lanes(queries->edge_u, lanes, subtract(second, first));
    set_lanes(queries->edge_v, lanes, subtract(third, first));
}

/* A facet's normal where its object is. */
static Vec3 place_normal(const Frame *frame, const Placement *placement, Vec3 normal) {
    Vec3 turned = rotate(placement->inverse_transposed, normal);
    float length = frame->num_poses > 1 ? sqrtf(dot(turned, turned)) : 0.0f;
    return length > 0.0f ? scale(1.0f / length, turned) : turned;
}

/* Set the queries of some rays that meet one facet. */
static void gather_rays(const FrameState *state, const RayBlock *rays, int object, int32_t triangle,
                        uint32_t lanes, PlaneQueries *queries, HitPoints *points) {
    const MeshArrays *mesh = mesh_of(state, object);
    const float *normal = mesh->normals + 3 * (size_t)triangle;
    if (object == OBJECT_STATIC) {
        set_triangle(queries, lanes, scene_corner(state, triangle, 0),
                     scene_corner(state, triangle, 1), scene_corner(state, triangle, 2));
        set_lanes(points->normal, lanes, vec3(normal));
        return;
    }
    const float *corners = mesh->corners + 9 * (size_t)triangle;
    set_triangle(queries, lanes, vec3(corners), vec3(corners + 3), vec3(corners + 6));
    /* A dynamic object's mesh is committed in a frame of its own: rays are moved, not the mesh. */
    Placement placement;
    Vec3 turned = {0, 0, 0};
    int lane_before = 0;
    for (uint32_t left = lanes; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        if (left == lanes || rays->time[lane] != rays->time[lane_before]) {
            placement = place_object(state->frame, object - 1, rays->time[lane]);
            turned = place_normal(state->frame, &placement, vec3(normal));
        }
        lane_before = lane;
        Vec3 from_object = subtract(get_lane(queries->origin, lane), vec3(placement.offset));
        Vec3 direction = get_lane(queries->direction, lane);
        set_lane(queries->origin, lane, rotate_back(placement.inverse_transposed, from_object));
        set_lane(queries->direction, lane, rotate_back(placement.inverse_transposed, direction));
        set_lane(points->normal, lane, turned);
    }
}

/* Weights and distances of rays on their triangles' planes (Moeller and Trumbore 1997). */
static void intersect_planes(const PlaneQueries *q, HitPoints *points) {
    for (int i = 0; i < BLOCK_RAYS; i++) {
        Vec3 direction = get_lane(q->direction, i), edge_v = get_lane(q->edge_v, i);
        Vec3 edge_u = get_lane(q->edge_u, i);
        Vec3 from_first = subtract(get_lane(q->origin, i), get_lane(q->first, i));
        Vec3 p = cross(direction, edge_v), s = cross(from_first, edge_u);
        float determinant = dot(edge_u, p);
        /* A ray within the plane meets it nowhere: the first corner is as good an answer as any. */
        float inverse = determinant != 0.0f ? 1.0f / determinant : 0.0f;
        points->u[i] = dot(from_first, p) * inverse;
        points->v[i] = dot(direction, s) * inverse;
        points->distance[i] = dot(edge_v, s) * inverse;
    }
}

/* Distances of hits with the static scene: normals and points of planes are enough. */
static void find_static_distances(const FrameState *state, const RayBlock *rays,
                                  const HitBlock *hits, uint32_t mask,
                                  float distance[BLOCK_RAYS]) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    _Alignas(64) float normal[3][BLOCK_RAYS] = {{0}}, first[3][BLOCK_RAYS] = {{0}};
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(mask >> lane & 1))
            continue;
        set_lane(normal, lane, vec3(mesh->normals + 3 * (size_t)hits->triangle[lane]));
        set_lane(first, lane, plane_point(state, hits->triangle[lane]));
    }
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float height = 0.0f, cosine = 0.0f;
        for (int axis = 0; axis < 3; axis++) {
            height += normal[axis][i] * (first[axis][i] - rays->origin[axis][i]);
            cosine += normal[axis][i] * rays->direction[axis][i];
        }
        if (mask >> i & 1)
            distance[i] = cosine != 0.0f ? height / cosine : 0.0f;
    }
}

static uint32_t static_lanes(const HitBlock *hits, uint32_t mask) {
    uint32_t found = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        found |= (uint32_t)(hits->object[lane] == OBJECT_STATIC) << lane;
    return found & mask;
}

Vec3 turn_normal(const FrameState *state, int object, float time, Vec3 normal) {
    const Frame *frame = state->frame;
    if (object == OBJECT_STATIC)
        return normal;
    Placement placement = place_object(frame, object - 1, time);
    return place_normal(frame, &placement, normal);
}

void find_hit_points(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                     uint32_t mask, HitPoints *points) {
    PlaneQueries queries;
    memset(&queries, 0, sizeof queries);
    memcpy(queries.origin, rays->origin, sizeof queries.origin);
    memcpy(queries.direction, rays->direction, sizeof queries.direction);
    for (uint32_t left = mask, same; left; left &= ~same) {
        int lane = __builtin_ctz(left);
        same = find_same(hits, lane) & left;
        gather_rays(state, rays, hits->object[lane], hits->triangle[lane], same, &queries, points);
    }
    intersect_planes(&queries, points);
    if (state->scene->mesh->arrays.fine_corners)
        find_static_distances(state, rays, hits, static_lanes(hits, mask), points->distance);
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            points->position[axis][i] =
                rays->origin[axis][i] + points->distance[i] * rays->direction[axis][i];
}

void find_hit_distances(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                        uint32_t mask, float distance[BLOCK_RAYS]) {
    if (static_lanes(hits, mask) == mask) {
        find_static_distances(state, rays, hits, mask, distance);
        return;
    }
    HitPoints points;
    find_hit_points(state, rays, hits, mask, &points);
    memcpy(distance, points.distance, sizeof points.distance);
}
