/* What one frame's threads share, and the poses of its camera and objects at a time. */
#ifndef CATOPTRA_FRAME_STATE_H
#define CATOPTRA_FRAME_STATE_H

#include "device.h"
#include "packets.h"
#include "vectors.h"

typedef struct {
    const Device *device;
    const Scene *scene;
    const RayTable *rays;
    const Frame *frame;
    RTCScene objects; /* the dynamic objects as instances; NULL for none */
    const float *object_heights; /* light_map.h; NULL without objects or shadows */
    struct Measures *measures;   /* measures.h */
    const Vec3 **object_radiance; /* (o,) of each object's facets; NULL: by ray */
    int has_one_origin; /* all rays start at the camera's first pose */
    int has_point_lights;
    int is_constant; /* the static scene has one radiance a facet: no texture, no point light */
} FrameState;

/* Triangles of the static scene, or of a dynamic object by its number in hits. */
static inline const MeshArrays *mesh_of(const FrameState *state, int object) {
    return object == OBJECT_STATIC ? &state->scene->mesh->arrays
                                   : &state->frame->objects[object - 1]->arrays;
}

/* Pose between the two nearest of `count` poses, `stride` apart, at a time from 0 to 1. */
void pose_at(const Pose *poses, int count, int stride, float time, Pose *pose);

/* Scene of the frame's objects as instances, moving if the frame has several poses; NULL without
 * objects or on failure. */
RTCScene commit_objects(const Device *device, const Frame *frame);

#endif
