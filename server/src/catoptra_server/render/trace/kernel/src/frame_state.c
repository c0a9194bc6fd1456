/* Provides frame_state.h: poses at a time, and the scene in the frame's coordinates.
 * Float64 twin: reference/meshes.py:interpolate_poses. A placed scene is one block, its caller's.
 * Threads: any; place_scene: the calling thread. */
#include "frame_state.h"

#include "height_map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void pose_at(const Pose *poses, int count, int stride, float time, Pose *pose) {
    if (count == 1) {
        *pose = poses[0];
        return;
    }
    float position = time * (float)(count - 1);
    int first = (int)position;
    first = first < 0 ? 0 : first > count - 2 ? count - 2 : first;
    float weight = position - (float)first;
    const Pose *before = poses + first * stride, *after = before + stride;
    for (int i = 0; i < 9; i++)
        pose->rotation[i] =
            before->rotation[i] + weight * (after->rotation[i] - before->rotation[i]);
    for (int i = 0; i < 3; i++)
        pose->translation[i] =
            before->translation[i] + weight * (after->translation[i] - before->translation[i]);
}

void rigid_pose_at(const Pose *poses, int count, int stride, float time, Pose *pose) {
    pose_at(poses, count, stride, time, pose);
    if (count == 1)
        return;
    Vec3 x = vec3(pose->rotation), y = vec3(pose->rotation + 3);
    x = scale(1.0f / sqrtf(dot(x, x)), x);
    y = subtract(y, scale(dot(x, y), x));
    y = scale(1.0f / sqrtf(dot(y, y)), y);
    Vec3 rows[3] = {x, y, cross(x, y)};
    memcpy(pose->rotation, rows, sizeof rows);
}

Placement place_object(const Frame *frame, int32_t object, float time) {
    Placement placement;
    Pose pose;
    pose_at(frame->object_poses + object, frame->num_poses, frame->num_objects, time, &pose);
    memcpy(placement.offset, pose.translation, sizeof placement.offset);
    /* A rotation's inverse is its transpose, and keeps lengths. */
    if (frame->num_poses > 1)
        invert_transposed(pose.rotation, placement.inverse_transposed);
    else
        memcpy(placement.inverse_transposed, pose.rotation, sizeof pose.rotation);
    return placement;
}

void object_pose(const FrameState *state, int object, Pose *pose) {
    const Frame *frame = state->frame;
    rigid_pose_at(frame->object_poses + object, frame->num_poses, frame->num_objects, state->time,
                  pose);
}

FrameState at_instant(const FrameState *state, float time) {
    FrameState moved = *state;
    moved.time = time;
    rigid_pose_at(state->frame->camera, state->frame->num_poses, 1, time, &moved.camera);
    return moved;
}

float row_time(const FrameState *state, float row) {
    return 0.5f + state->frame->readout * (row / (float)state->rays->height_px - 0.5f);
}

/* A point of the scene in the coordinates of a frame. */
static Vec3 place_point(Vec3 point, const double origin[3]) {
    return (Vec3){(float)((double)point.x - origin[0]), (float)((double)point.y - origin[1]),
                  (float)((double)point.z - origin[2])};
}

Vec3 scene_corner(const FrameState *state, int32_t triangle, int corner) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    size_t at = 9 * (size_t)triangle + 3 * (size_t)corner;
    const double *origin = state->frame->origin;
    float placed[3];
    if (!mesh->fine_corners && !has_origin(state))
        return vec3(mesh->corners + at);
    for (size_t i = 0; i < 3; i++)
        placed[i] = (float)((mesh->fine_corners ? mesh->fine_corners[at + i]
                                                : (double)mesh->corners[at + i]) - origin[i]);
    return vec3(placed);
}

Vec3 plane_point(const FrameState *state, int32_t triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (!mesh->fine_corners)
        return scene_corner(state, triangle, 0);
    const double *corners = mesh->fine_corners + 9 * (size_t)triangle;
    double first[3], second[3], normal[3], from_origin[3];
    edge_vectors(corners, first, second);
    for (int i = 0; i < 3; i++) {
        int next = (i + 1) % 3, last = (i + 2) % 3;
        normal[i] = first[next] * second[last] - first[last] * second[next];
        from_origin[i] = corners[i] - state->frame->origin[i];
    }
    /* Not a number without area. */
    double share = dot3(normal, from_origin) / dot3(normal, normal);
    return (Vec3){(float)(share * normal[0]), (float)(share * normal[1]),
                  (float)(share * normal[2])};
}

static void place_grids(Occlusion *grids, OcclusionPatch *patches, size_t count,
                        const double origin[3]) {
    const OcclusionPatch *unplaced = grids->patches;
    grids->patches = patches;
    for (size_t patch = 0; patch < count; patch++) {
        patches[patch] = unplaced[patch];
        float *rows[2] = {patches[patch].column, patches[patch].row};
        for (int row = 0; row < 2; row++) {
            double offset = patches[patch].offset[row];
            for (int i = 0; i < 3; i++)
                offset += (double)rows[row][i] * origin[i];
            rows[row][3] = (float)offset;
        }
    }
}

static void place_lights(Light *lights, LightMaps *maps, const Scene *scene,
                         const double origin[3]) {
    for (int light = 0; light < scene->num_lights; light++) {
        lights[light] = scene->lights[light];
        for (int i = 0; i < 3 && lights[light].kind == LIGHT_POINT; i++)
            lights[light].vector[i] = (float)(lights[light].position[i] - origin[i]);
    }
    for (int map = 0; maps && map < FACES * scene->num_lights; map++)
        maps->maps[map].origin = place_point(maps->maps[map].origin, origin);
}

Scene *place_scene(const Scene *scene, const double origin[3]) {
    size_t num_grids = (size_t)scene->occlusion.num_patches, num_lights = (size_t)scene->num_lights;
    size_t maps_size =
        scene->light_maps ? sizeof(LightMaps) + FACES * num_lights * sizeof(LightMap) : 0;
    size_t lights_size = sizeof(Light) * num_lights;
    Scene *placed =
        malloc(sizeof *placed + maps_size + lights_size + sizeof(OcclusionPatch) * num_grids);
    if (!placed)
        return NULL;
    char *end = (char *)(placed + 1);
    *placed = *scene;
    if (maps_size)
        placed->light_maps = memcpy(end, scene->light_maps, maps_size);
    Light *lights = (Light *)(end + maps_size);
    place_lights(lights, placed->light_maps, scene, origin);
    placed->lights = lights;
    place_grids(&placed->occlusion, (OcclusionPatch *)(end + maps_size + lights_size), num_grids,
                origin);
    return placed;
}
