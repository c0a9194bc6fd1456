/* Lists of what a part of the image may show: triangles and spheres, relative to the viewpoint.
 *
 * The static scene's are found by its hierarchy: the work follows what is in view, not how many
 * triangles there are. A node that is seen as small as a few tiles is one sphere, which can only
 * prevent a proof. Coordinates are stored by component: the tests of whole lists against a beam
 * are vector code.
 */
#ifndef CATOPTRA_CANDIDATES_H
#define CATOPTRA_CANDIDATES_H

#include "beams.h"
#include "frame_state.h"

/* Candidates that are no surfaces: a sphere around small triangles, a side of a box around a part
 * of a dynamic object, of which the first has the identifier OBJECT_BOX, the next one less. */
enum { CLUSTER = -1, OBJECT_BOX = -2 };

typedef struct {
    int count;
    float *corner[9]; /* a sphere is a triangle of one point */
    float *radius;    /* 0 for triangles; of those of moving objects, their displacement */
    float *reach;     /* radius, and displacement seen from the viewpoint while it moves */
    int32_t *id;      /* triangle of the static scene, or one of the above */
} CandidateList;

/* Object number of a candidate. */
/* Whether rays may pass a triangle of the static scene that they meet. */
static inline int is_filtered(const MeshArrays *mesh, int32_t triangle) {
    return (mesh->flags[triangle] & FACET_FILTERED) != 0;
}

static inline int32_t candidate_object(int32_t id) {
    return id > OBJECT_BOX ? OBJECT_STATIC : 1 + OBJECT_BOX - id;
}

/* Sides of a beam in the world. */
typedef struct {
    Vec3 normal[4]; /* inward, unit */
    Vec3 edge[4];   /* between neighbouring sides */
    Vec3 axis;
    Vec3 apex;    /* relative to the viewpoint */
    Vec3 centre;  /* likewise: of a sphere that holds the origins of the rays */
    float radius; /* of it; 0: all rays begin at the viewpoint */
    float tile;   /* width of a tile's beam, a metre away */
} BeamSides;

/* Length of arrays by candidate of a list of at most `count`, such as marks and distances. */
size_t whole_blocks(int count);

int candidates_allocate(CandidateList *list, int capacity);
void candidates_free(CandidateList *list);

/* Boxes of a frame's dynamic objects; 0 if memory is short. */
int candidates_collect(CandidateList *list, const FrameState *state);

/* Add what of the static scene may reach into a beam, up to a length of the list; 0 if there is
 * more. */
int add_scene(const FrameState *state, const BeamSides *sides, int max_count, CandidateList *list);

Vec3 candidate_corner(const CandidateList *list, int at, int corner);
void candidate_copy(const CandidateList *from, int at, CandidateList *to);

/* Corner of a candidate relative to the apex of a beam. */
Vec3 corner_from_apex(const CandidateList *list, int at, int corner, const BeamSides *sides);

/* Sides of a part's narrow beam. */
void find_sides(const FrameState *state, const BeamLevel *parts, int part, BeamSides *sides);

/* Candidates of `from` that reach into a beam; `marks` has room for a byte each. */
void keep_inside(const CandidateList *from, const BeamSides *sides, uint8_t *marks,
                 CandidateList *kept);

/* Whether the beam lies wholly on one side of the plane through its apex and two points relative to
 * it, which may move by `reach`. */
int is_beam_beside(const BeamSides *sides, Vec3 from, Vec3 to, float reach);

/* Distances along a beam's axis from its apex to each candidate's triangle, INFINITY where not
 * met. */
void measure_distances(const CandidateList *list, const BeamSides *sides, float *distances);

#endif
