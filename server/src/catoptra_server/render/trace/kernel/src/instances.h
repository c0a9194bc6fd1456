/* A frame's dynamic objects, which move during it, as instances of their meshes. */
#ifndef CATOPTRA_INSTANCES_H
#define CATOPTRA_INSTANCES_H

#include "bvh.h"
#include "frame_state.h"

typedef struct Instances Instances;

/* Instances of a frame's objects that have triangles and poses of finite numbers; *failed where
 * memory is short. NULL then, and without any. */
Instances *create_instances(const Frame *frame, int *failed);

void release_instances(Instances *instances);

/* Hierarchy of boxes around where the frame's objects are; NULL without any. */
const BvhNode *object_nodes(const FrameState *state);

/* Closest hits of the active rays nearer than their limits; a hit becomes its ray's limit. */
void intersect_instances(const FrameState *state, RayBlock *rays, HitBlock *hits);

/* The same with one of the objects. */
void intersect_object(const FrameState *state, int32_t object, RayBlock *rays, HitBlock *hits);

/* Bit mask of the active rays that meet something nearer than their limits, but the facets where
 * they begin; NULL: they begin on none. */
uint32_t occlude_instances(const FrameState *state, const RayBlock *rays, const HitBlock *starts);

#endif
