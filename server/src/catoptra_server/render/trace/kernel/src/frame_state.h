/* What one frame's threads share, and the poses of its camera and objects at a time. */
#ifndef CATOPTRA_FRAME_STATE_H
#define CATOPTRA_FRAME_STATE_H

#include "beams.h"
#include "device.h"
#include "ray_block.h"
#include "vectors.h"

/* The plane whose mirrored light rays show, and the angle by which its roughness spreads them. */
typedef struct {
    Vec3 normal;
    float spread;
} MirrorPlane;

/* Lights by their numbers, of the first 32: those that nothing occludes, and those that are
 * occluded, everywhere on a part of a facet. */
typedef struct {
    uint32_t seen, hidden;
} LightProof;

typedef struct {
    const Device *device;
    const Scene *scene;          /* lights, grids and maps in the frame's coordinates */
    Scene *placed;               /* the same, of a frame with an origin */
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
    int is_rolling;     /* each row of pixels has a time of its own */
    int plan_wanted;    /* the camera or objects move during the exposure */
    /* Largest displacement of the viewpoint, and of a point a metre away by turns, while a proof
     * has to hold. */
    float shift, turn;
    struct BlurPlan *plan; /* blur_plan.h; NULL where nothing moves */
    int32_t unseen_object; /* number in hits of an object that rays of the camera pass; 0: none */
    const MirrorPlane *mirror; /* of rays that a facet mirrors; NULL: of the camera's */
    int has_point_lights;
    LightProof known; /* lights that all rays meet alike: of a tile's other instants */
    int is_constant; /* light is constant over each facet: no shadow, no point light */
} FrameState;

/* Triangles of the static scene, or of a dynamic object by its number in hits. */
static inline const MeshArrays *mesh_of(const FrameState *state, int object) {
    return object == OBJECT_STATIC ? &state->scene->mesh->arrays
                                   : &state->frame->objects[object - 1]->arrays;
}

/* Whether a facet of the static scene shows what it mirrors. */
static inline int is_glossy(const FrameState *state, int32_t triangle) {
    return state->frame->has_gloss && state->scene->mesh->arrays.flags[triangle] & FACET_GLOSSY;
}

/* Whether the frame has coordinates of its own, because the scene's are too large for floats. */
static inline int has_origin(const FrameState *state) {
    const double *origin = state->frame->origin;
    return origin[0] != 0.0 || origin[1] != 0.0 || origin[2] != 0.0;
}

/* Place of the frame's coordinates in the scene's, for searches in its meshes; NULL: the same. */
static inline const double *place_of(const FrameState *state) {
    return has_origin(state) ? state->frame->origin : NULL;
}

/* Corner of a triangle of the static scene. */
Vec3 scene_corner(const FrameState *state, int32_t triangle, int corner);

/* A point of a static triangle's plane: its first corner, or of a mesh that is large for floats the
 * point nearest to the frame's origin. */
Vec3 plane_point(const FrameState *state, int32_t triangle);

/* The scene with its lights, grids and maps in the coordinates of a frame that has an origin; NULL
 * if memory is short. To be freed. */
Scene *place_scene(const Scene *scene, const double origin[3]);

/* Pose between the two nearest of `count` poses, `stride` apart, at a time from 0 to 1. */
void pose_at(const Pose *poses, int count, int stride, float time, Pose *pose);

/* The same as a rotation: of rays, whose directions stay unit vectors. */
void rigid_pose_at(const Pose *poses, int count, int stride, float time, Pose *pose);

/* Where a dynamic object is: what is subtracted from points before they are turned back, and the
 * inverse of its matrix, transposed. The entries between two rotations make no rotation. */
typedef struct {
    float offset[3], inverse_transposed[9];
} Placement;

/* The placement of an object, from 0 on, at a time. */
Placement place_object(const Frame *frame, int32_t object, float time);

/* Pose of an object, from 0 on, at the state's time. */
void object_pose(const FrameState *state, int object, Pose *pose);

/* The state with its camera at a time. */
FrameState at_instant(const FrameState *state, float time);

/* Middle of the exposure of a row of pixels, which may lie between two. */
float row_time(const FrameState *state, float row);

#endif
