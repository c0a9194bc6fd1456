/* Provides frame_state.h: poses at a time.
 * Float64 twin: reference/meshes.py:interpolate_poses. Owns nothing.
 * Threads: any. */
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
