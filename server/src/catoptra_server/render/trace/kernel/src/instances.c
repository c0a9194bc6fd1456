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

static void widen_box(ItemBox *box, const ItemBox *local, const Pose *pose) {
    for (int row = 0; row < 3; row++) {
        float middle = pose->translation[row], half = 0.0f;
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

/* Box around where an object is during a frame: between two poses each of its points moves on a
 * straight line. */
static ItemBox enclose_object(const Frame *frame, int32_t object) {
    const ItemBox *local = &frame->objects[object]->bvh.box;
    ItemBox box = {.least = {INFINITY, INFINITY, INFINITY},
               .item = object,
               .most = {-INFINITY, -INFINITY, -INFINITY}};
    for (int step = 0; step < frame->num_poses; step++) {
        widen_box(&box, local, frame->object_poses + step * frame->num_objects + object);
    }
    return box;
}

static int has_place(const ItemBox *box) {
    for (int axis = 0; axis < 3; axis++)
        if (!(box->least[axis] >= -MOST_COORDINATE && box->most[axis] <= MOST_COORDINATE &&
              box->least[axis] <= box->most[axis]))
            return 0;
    return 1;
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
    instances->boxes = boxes;
    instances->count = 0;
    for (int object = 0; object < frame->num_objects; object++) {
        if (!frame->objects[object]->bvh.num_nodes)
            continue;
        boxes[instances->count] = enclose_object(frame, object);
        instances->count += has_place(boxes + instances->count);
    }
    if (instances->count) {
        build_box_nodes(boxes, instances->count, instances->nodes);
        return instances;
    }
    release_instances(instances);
    return NULL;
}

void release_instances(Instances *instances) {
    if (instances)
        free(instances->boxes);
    free(instances);
}

const BvhNode *object_nodes(const FrameState *state) {
    return state->objects ? state->objects->nodes : NULL;
}

/* Rays of a mask in the frame of a placed object. */
static void place_rays(const RayBlock *rays, const Placement *placement, Ints16 mask,
                       RayBlock *moved) {
    const float *inverse = placement->inverse_transposed;
    Floats16 origin[3], direction[3];
    for (int axis = 0; axis < 3; axis++) {
        origin[axis] = load16(rays->origin[axis]) - placement->offset[axis];
        direction[axis] = load16(rays->direction[axis]);
    }
    for (int axis = 0; axis < 3; axis++) {
        Floats16 x = splat16(inverse[axis]), y = splat16(inverse[3 + axis]),
                 z = splat16(inverse[6 + axis]);
        Floats16 from = x * origin[0] + y * origin[1] + z * origin[2];
        Floats16 along = x * direction[0] + y * direction[1] + z * direction[2];
        store16(select16(mask, from, load16(moved->origin[axis])), moved->origin[axis]);
        store16(select16(mask, along, load16(moved->direction[axis])), moved->direction[axis]);
    }
}

/* Rays in the frame of an object, each at its time. */
static void move_rays(const FrameState *state, int32_t object, const RayBlock *rays,
                      RayBlock *moved) {
    int is_moving = state->frame->num_poses > 1;
    *moved = *rays;
    for (uint32_t left = 0xffff, same; left; left &= ~same) {
        float time = rays->time[__builtin_ctz(left)];
        Placement placement = place_object(state->frame, object, time);
        /* Times of inactive rays may be no numbers. */
        same = is_moving ? bits16(load16(rays->time) == time) | (left & -left) : left;
        place_rays(rays, &placement, mask16(same), moved);
    }
}

static void intersect_placed(const FrameState *state, int32_t object, const RayBlock *moved,
                             RayBlock *rays, HitBlock *hits) {
    RayBlock local = *moved;
    intersect_bvh(&state->frame->objects[object]->bvh, NULL, object + 1, &local, hits);
    memcpy(rays->limit, local.limit, sizeof rays->limit);
}

void intersect_object(const FrameState *state, int32_t object, RayBlock *rays, HitBlock *hits) {
    Pose pose;
    Placement placement;
    RayBlock moved = *rays;
    object_pose(state, object - 1, &pose);
    memcpy(placement.offset, pose.translation, sizeof placement.offset);
    memcpy(placement.inverse_transposed, pose.rotation, sizeof pose.rotation);
    place_rays(rays, &placement, mask16(0xffff), &moved);
    intersect_placed(state, object - 1, &moved, rays, hits);
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
    RayBlock moved;
    if (object + 1 == state->unseen_object)
        return 1;
    move_rays(state, object, rays, &moved);
    moved.active = lanes;
    intersect_placed(state, object, &moved, rays, result);
    return 1;
}

typedef struct {
    const HitBlock *starts; /* or NULL */
    uint32_t lanes;         /* that are occluded */
} Occluded;

static int visit_any(const FrameState *state, int32_t object, uint32_t lanes, void *rays,
                     void *result) {
    RayBlock *block = rays, moved;
    Occluded *occluded = result;
    StartFacets starts;
    if (occluded->starts)
        find_starts(occluded->starts, object + 1, &starts);
    move_rays(state, object, block, &moved);
    moved.active = lanes & ~occluded->lanes;
    occluded->lanes |= occlude_bvh(&state->frame->objects[object]->bvh, NULL, &moved,
                                   occluded->starts ? &starts : NULL);
    return block->active & ~occluded->lanes ? 1 : 0;
}

void intersect_instances(const FrameState *state, RayBlock *rays, HitBlock *hits) {
    if (rays->active)
        walk_instances(state, rays, visit_nearest, hits);
}

uint32_t occlude_instances(const FrameState *state, const RayBlock *rays, const HitBlock *starts) {
    RayBlock block = *rays;
    Occluded occluded = {starts, 0};
    if (rays->active)
        walk_instances(state, &block, visit_any, &occluded);
    return occluded.lanes;
}
