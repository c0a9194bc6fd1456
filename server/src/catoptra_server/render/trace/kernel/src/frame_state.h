/* What one frame's threads share, and the poses of its camera and objects at a time. */
#ifndef CATOPTRA_FRAME_STATE_H
#define CATOPTRA_FRAME_STATE_H

#include "beams.h"
#include "device.h"
#include "ray_block.h"
#include "vectors.h"

typedef struct {
    const Device *device;
    const Scene *scene;
    const RayTable *rays;
    const struct View *view;
    const Frame *frame;
    struct Instances *objects; /* instances.h; NULL for none */
    const float *object_heights; /* light_map.h; NULL without objects or shadows */
    struct Measures *measures;   /* measures.h */
    const Vec3 **object_radiance; /* (o,) of each object's facets; NULL: by ray */
    Pose camera;        /* of all rays without times of their own */
    float time;         /* of these rays within the exposure */
    int has_one_pose;   /* all rays of a block start at one pose of the camera */
    int has_beams;      /* the view's beams hold the rays of this frame */
    int is_rolling;     /* each row of pixels has a time of its own */
    int plan_wanted;    /* the camera or objects move during the exposure */
    /* Largest displacement of the viewpoint, and of a point a metre away by turns, while a proof
     * has to hold. */
    float shift, turn;
    struct BlurPlan *plan; /* blur_plan.h; NULL where nothing moves */
    int has_point_lights;
    int is_constant; /* light is constant over each facet: no shadow, no point light */
} FrameState;

/* Triangles of the static scene, or of a dynamic object by its number in hits. */
static inline const MeshArrays *mesh_of(const FrameState *state, int object) {
    return object == OBJECT_STATIC ? &state->scene->mesh->arrays
                                   : &state->frame->objects[object - 1]->arrays;
}

/* Pose between the two nearest of `count` poses, `stride` apart, at a time from 0 to 1. */
void pose_at(const Pose *poses, int count, int stride, float time, Pose *pose);

/* The same as a rotation: of rays, whose directions stay unit vectors. */
void rigid_pose_at(const Pose *poses, int count, int stride, float time, Pose *pose);

/* Pose of an object, from 0 on, at the state's time. */
void object_pose(const FrameState *state, int object, Pose *pose);

/* The state with its camera at a time. */
FrameState at_instant(const FrameState *state, float time);

/* Middle of the exposure of a row of pixels, which may lie between two. */
float row_time(const FrameState *state, float row);

#endif
