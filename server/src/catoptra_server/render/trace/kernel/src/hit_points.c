#include "hit_points.h"

#include <math.h>
#include <string.h>

/* Weights and distance of a ray on a triangle's plane (Moeller and Trumbore 1997). */
static void intersect_plane(const float *corners, Vec3 origin, Vec3 direction, HitPoint *point) {
    Vec3 first = vec3(corners);
    Vec3 edge_u = subtract(vec3(corners + 3), first), edge_v = subtract(vec3(corners + 6), first);
    Vec3 p = cross(direction, edge_v);
    float determinant = dot(edge_u, p);
    /* A ray within the plane meets it nowhere: Embree reports none, and the first corner is as good
     * an answer as any. */
    float inverse = determinant != 0.0f ? 1.0f / determinant : 0.0f;
    Vec3 from_first = subtract(origin, first);
    Vec3 q = cross(from_first, edge_u);
    point->u = dot(from_first, p) * inverse;
    point->v = dot(direction, q) * inverse;
    point->distance = dot(edge_v, q) * inverse;
}

/* Point on a dynamic object, in the object's own frame: its mesh is committed once, not moved. */
static void find_object_point(const FrameState *state, int object, int triangle, float time,
                              Vec3 origin, Vec3 direction, HitPoint *point) {
    const Frame *frame = state->frame;
    const MeshArrays *mesh = &frame->objects[object]->arrays;
    Pose pose;
    float normals_matrix[9];
    pose_at(frame->object_poses + object, frame->num_poses, frame->num_objects, time, &pose);
    /* The entries between two rotations make no rotation: its transpose is not its inverse. */
    if (frame->num_poses > 1)
        invert_transposed(pose.rotation, normals_matrix);
    else
        memcpy(normals_matrix, pose.rotation, sizeof normals_matrix);
    Vec3 from_object = subtract(origin, vec3(pose.translation));
    intersect_plane(mesh->corners + 9 * (size_t)triangle, rotate_back(normals_matrix, from_object),
                    rotate_back(normals_matrix, direction), point);
    Vec3 normal = rotate(normals_matrix, vec3(mesh->normals + 3 * (size_t)triangle));
    float length = sqrtf(dot(normal, normal));
    point->normal = length > 0.0f ? scale(1.0f / length, normal) : normal;
}

void find_hit_point(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int lane,
                    HitPoint *point) {
    int object = hits->object[lane], triangle = hits->triangle[lane];
    Vec3 origin = {rays->origin[0][lane], rays->origin[1][lane], rays->origin[2][lane]};
    Vec3 direction = {rays->direction[0][lane], rays->direction[1][lane], rays->direction[2][lane]};
    if (object == OBJECT_STATIC) {
        const MeshArrays *mesh = &state->scene->mesh->arrays;
        intersect_plane(mesh->corners + 9 * (size_t)triangle, origin, direction, point);
        point->normal = vec3(mesh->normals + 3 * (size_t)triangle);
    } else {
        find_object_point(state, object - 1, triangle, rays->time[lane], origin, direction, point);
    }
    point->position = add(origin, scale(point->distance, direction));
}
