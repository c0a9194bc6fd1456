/* Provides frame_state.h: poses at a time, and the frame's objects in Embree.
 * Float64 twin: reference/meshes.py:interpolate_poses. render.c releases the scene that
 * commit_objects returns.
 * Threads: commit_objects: the calling thread. Poses: any. */
#include "frame_state.h"

#include <math.h>
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
    /* Entry by entry, as Embree interpolates the transforms of moving instances. */
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

static void set_transform(const Embree *embree, RTCGeometry instance, int step, const Pose *pose) {
    float columns[12];
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 3; column++)
            columns[3 * column + row] = pose->rotation[3 * row + column];
        columns[9 + row] = pose->translation[row];
    }
    embree->set_transform(instance, (unsigned)step, RTC_FORMAT_FLOAT3X4_COLUMN, columns);
}

RTCScene commit_objects(const Device *device, const Frame *frame) {
    const Embree *embree = &device->embree;
    if (!frame->num_objects)
        return NULL;
    RTCScene scene = embree->new_scene(device->rtc);
    /* A handful of boxes: building a better hierarchy takes longer than it saves. */
    embree->set_scene_build_quality(scene, RTC_BUILD_QUALITY_LOW);
    for (int object = 0; object < frame->num_objects; object++) {
        RTCScene mesh = frame->objects[object]->scene;
        if (!mesh)
            continue;
        RTCGeometry instance = embree->new_geometry(device->rtc, RTC_GEOMETRY_TYPE_INSTANCE);
        embree->set_instanced_scene(instance, mesh);
        if (frame->num_poses > 1)
            embree->set_time_step_count(instance, (unsigned)frame->num_poses);
        for (int step = 0; step < frame->num_poses; step++)
            set_transform(embree, instance, step,
                          frame->object_poses + step * frame->num_objects + object);
        embree->commit_geometry(instance);
        /* The number of the instance in hits is the index of the object. */
        embree->attach_geometry_by_id(scene, instance, (unsigned)object);
        embree->release_geometry(instance);
    }
    embree->commit_scene(scene);
    return scene;
}
