/* Provides instances.h: boxes around where objects are during a frame, and rays in their frames.
 * Float64 twin: reference/meshes.py. The frame owns its instances, from create_instances to
 * release_instances.
 * Threads: any at once, but for creation and release. */
#include "instances.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct Instances {
    int32_t count;
    ItemBox *boxes;
    BvhNode nodes[];
};

static void widen_box(ItemBox *box, const ItemBox *local, const Pose *pose, float reserve) {
    for (int row = 0; row < 3; row++) {
        float middle = pose->translation[row], half = reserve;
        for (int column = 0; column < 3; column++) {
            float entry = pose->rotation[3 * row + column];
            middle += 0.5f * (local->least[column] + local->most[column]) * entry;
            half += 0.5f * (local->most[column] - local->least[column]) * fabsf(entry);
        }
        half += 1e-6f * (fabsf(middle) + half);
        box->least[row] = fminf(box->least[row], middle - half);
        box->most[row] = fmaxf(box->most[row], middle + half);
    }
}

/* How far points of a box are from the chords between two poses, at most. */
static float find_sagitta(const ItemBox *local, const Pose *before, const Pose *after) {
    float squared_turn = 0.0f, squared_radius = 0.0f;
    for (int i = 0; i < 9; i++) {
        float turn = after->rotation[i] - before->rotation[i];
        squared_turn += turn * turn;
    }
    for (int axis = 0; axis < 3; axis++) {
        float farthest = fmaxf(fabsf(local->least[axis]), fabsf(local->most[axis]));
        squared_radius += farthest * farthest;
    }
    return squared_turn * sqrtf(squared_radius);
}

static ItemBox enclose_object(const Frame *frame, int32_t object) {
    const ItemBox *local = &frame->objects[object]->bvh.box;
    ItemBox box = {.least = {INFINITY, INFINITY, INFINITY},
               .item = object,
               .most = {-INFINITY, -INFINITY, -INFINITY}};
    for (int step = 0; step < frame->num_poses; step++) {
        const Pose *pose = frame->object_poses + step * frame->num_objects + object;
        const Pose *next = step + 1 < frame->num_poses ? pose + frame->num_objects : pose;
        const Pose *before = step ? pose - frame->num_objects : pose;
        float reserve = fmaxf(find_sagitta(local, before, pose), find_sagitta(local, pose, next));
        widen_box(&box, local, pose, reserve);
    }
    return box;
}

Instances *create_instances(const Frame *frame, int *failed) {
    int32_t count = 0;
    for (int object = 0; object < frame->num_objects; object++)
        count += frame->objects[object]->bvh.num_nodes > 0;
    if (!count)
        return NULL;
    size_t size = sizeof(Instances) + sizeof(BvhNode) * (size_t)max_nodes(count, 1);
    Instances *instances = aligned_alloc(64, (size + 63) / 64 * 64);
    ItemBox *boxes = malloc(sizeof *boxes * (size_t)count);
    if (!instances || !boxes) {
        free(instances);
        free(boxes);
        *failed = 1;
        return NULL;
    }
    instances->count = 0;
    instances->boxes = boxes;
    for (int object = 0; object < frame->num_objects; object++)
        if (frame->objects[object]->bvh.num_nodes)
            boxes[instances->count++] = enclose_object(frame, object);
    build_box_nodes(boxes, count, instances->nodes);
    return instances;
}

void release_instances(Instances *instances) {
    if (instances)
        free(instances->boxes);
    free(instances);
}

static void move_ray(const RayBlock *rays, const Pose *pose, int lane, RayBlock *moved) {
    Vec3 origin = subtract(get_lane(rays->origin, lane), vec3(pose->translation));
    set_lane(moved->origin, lane, rotate_back(pose->rotation, origin));
    set_lane(moved->direction, lane, rotate_back(pose->rotation, get_lane(rays->direction, lane)));
}

/* Rays in the frame of an object. */
static void move_rays(const FrameState *state, int32_t object, const RayBlock *rays,
                      RayBlock *moved) {
    const Frame *frame = state->frame;
    const Pose *poses = frame->object_poses + object;
    Pose pose;
    float time = rays->time[0];
    rigid_pose_at(poses, frame->num_poses, frame->num_objects, time, &pose);
    *moved = *rays;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (rays->time[lane] != time) {
            time = rays->time[lane];
            rigid_pose_at(poses, frame->num_poses, frame->num_objects, time, &pose);
        }
        move_ray(rays, &pose, lane, moved);
    }
}

void intersect_object(const FrameState *state, int32_t object, RayBlock *rays, HitBlock *hits) {
    RayBlock moved;
    move_rays(state, object - 1, rays, &moved);
    intersect_bvh(&state->frame->objects[object - 1]->bvh, object, &moved, hits);
    memcpy(rays->limit, moved.limit, sizeof rays->limit);
}

/* A node or ~object, and the rays that meet its box. */
typedef struct {
    int32_t child;
    uint32_t lanes;
} Part;

typedef int (*VisitObject)(const FrameState *state, int32_t object, uint32_t lanes, void *rays,
                           void *result);

static void walk_instances(const FrameState *state, RayBlock *rays, VisitObject visit,
                           void *result) {
    const Instances *instances = state->objects;
    Part stack[MAX_STACK];
    int height = 1;
    stack[0] = (Part){0, rays->active};
    while (height) {
        Part part = stack[--height];
        if (part.child < 0) {
            if (!visit(state, ~part.child, part.lanes, rays, result))
                return;
            continue;
        }
        const BvhNode *node = instances->nodes + part.child;
        uint32_t met[LANES];
        meet_children(node, rays, met);
        for (int slot = LANES - 1; slot >= 0; slot--)
            if (node->child[slot] != NO_CHILD && met[slot])
                stack[height++] = (Part){node->child[slot], met[slot]};
    }
}

static int visit_nearest(const FrameState *state, int32_t object, uint32_t lanes, void *rays,
                         void *result) {
    RayBlock *block = rays;
    uint32_t active = block->active;
    block->active = lanes;
    intersect_object(state, object + 1, block, result);
    block->active = active;
    return 1;
}

static int visit_any(const FrameState *state, int32_t object, uint32_t lanes, void *rays,
                     void *result) {
    RayBlock *block = rays, moved;
    uint32_t *occluded = result;
    move_rays(state, object, block, &moved);
    moved.active = lanes & ~*occluded;
    *occluded |= occlude_bvh(&state->frame->objects[object]->bvh, &moved);
    return block->active & ~*occluded ? 1 : 0;
}

void intersect_instances(const FrameState *state, RayBlock *rays, HitBlock *hits) {
    if (rays->active)
        walk_instances(state, rays, visit_nearest, hits);
}

uint32_t occlude_instances(const FrameState *state, const RayBlock *rays) {
    RayBlock block = *rays;
    uint32_t occluded = 0;
    if (rays->active)
        walk_instances(state, &block, visit_any, &occluded);
    return occluded;
}
