/* Bounding volume hierarchies of eight children a node, and the queries of rays.
 *
 * A block of coherent rays descends as one beam: four planes against eight boxes at once. Where at
 * most SINGLE_RAYS of them meet a box they go on one by one: packets share nothing in the last
 * levels, single rays nothing in the first.
 *
 * No ray slips between triangles that share an edge (Woop, Benthin, Wald, "Watertight Ray/Triangle
 * Intersection", JCGT 2, 2013): each ray has a frame of its own, in which it is an axis, and the
 * side on which it passes an edge is computed alike for both triangles of the edge. What is
 * rounding off counts as inside for both. A hit follows from the ray and the triangle alone, and of
 * two at one distance the triangle of the lower number is met: neither the hierarchy, nor the block
 * that a ray belongs to, nor the processor changes what is seen.
 *
 * Boxes are of floats in the mesh's coordinates, and have a reserve for their rounding. Corners of
 * a mesh that is large for floats are doubles: relative to the rays' own coordinates, whose origin
 * is near, they are exact at any distance, and so are the planes of large triangles close by.
 */
#ifndef CATOPTRA_BVH_H
#define CATOPTRA_BVH_H

#include "kernel.h"
#include "lanes.h"
#include "ray_block.h"
#include "workers.h"

/* Children of a node, and triangles of a leaf. */
enum { LANES = 8 };

enum { LEAF_TRIANGLES = LANES, NO_TRIANGLE = -1, NO_CHILD = INT32_MIN };

/* Products of three coordinates stay finite below it. */
#define MOST_COORDINATE 1e12f

/* Depth of the deepest node, and what a descent keeps on its stack at most. */
enum { MAX_DEPTH = 40, MAX_STACK = MAX_DEPTH * (LANES - 1) + 1 };

typedef struct {
    float least[3];
    int32_t item; /* what the box encloses */
    float most[3];
    int32_t spare;
} ItemBox;

/* Children lie at the front. Boxes of missing ones are turned inside out: nothing meets them. */
typedef struct {
    _Alignas(64) Floats8 bounds[6]; /* least x, y, z, most x, y, z */
    int32_t child[LANES]; /* a node, ~leaf, or NO_CHILD */
} BvhNode;

typedef struct {
    Floats8 corner[9];   /* x, y, z of the first corner, of the second, of the third */
    int32_t triangle[LANES]; /* NO_TRIANGLE for unused lanes, whose corners are not numbers */
} BvhLeaf;

/* The same of a mesh that is large for float32, whose corners are met in double precision. */
typedef struct {
    Doubles8 corner[9];
    int32_t triangle[LANES];
} FineLeaf;

typedef struct {
    ItemBox box;       /* of all; inside out without triangles */
    BvhNode *nodes; /* the first is the root */
    BvhLeaf *leaves;       /* NULL for a large mesh */
    FineLeaf *fine_leaves; /* of a large mesh; else NULL */
    int32_t num_nodes, num_leaves;
    float largest; /* coordinate of the box, 0 without */
    /* Of a mesh with facets that have holes, or are none from behind; else NULL. */
    const MeshArrays *filter;
} Bvh;

/* The triangles of a leaf, NO_TRIANGLE for unused lanes. */
static inline const int32_t *leaf_triangles(const Bvh *bvh, int32_t leaf) {
    return bvh->fine_leaves ? bvh->fine_leaves[leaf].triangle : bvh->leaves[leaf].triangle;
}

/* Hierarchy of (count, 3, 3) corners; triangles that are not finite are left out. A large mesh has
 * fine corners besides, which the others round. 0 if memory is short. */
int build_bvh(Bvh *bvh, Workers *workers, const float *corners, const double *fine_corners,
              int32_t count);

void free_bvh(Bvh *bvh);

/* Hierarchy of boxes, reordered, whose leaves are the boxes' items; its nodes go to `nodes`, with
 * room for max_nodes(count, 1). */
void build_box_nodes(ItemBox *boxes, int32_t count, BvhNode *nodes);

int32_t max_nodes(int32_t count, int32_t leaf_size);

/* Coverage where a ray meets a triangle of a filtered mesh: below 1 in holes, below 0 on backs that
 * are not seen, infinite on facets without either. `place` as below. */
double find_coverage(const MeshArrays *mesh, const double *place, const RayBlock *rays, int lane,
                     int32_t triangle, int sees_backs);

/* Closest hits of the active rays nearer than their limits; a hit becomes its ray's limit, `object`
 * the object that it belongs to. `place` is that of the rays' coordinates in the mesh's; NULL: they
 * are the same. */
void intersect_bvh(const Bvh *bvh, const double place[3], int32_t object, RayBlock *rays,
                   HitBlock *hits);

/* The same of the static scene, beyond (16,) distances, if it has filtered facets; and blended
 * facets are met from another coverage than 1 on. */
void intersect_layer(const Bvh *bvh, const double place[3], const float begin[BLOCK_RAYS],
                     float least_coverage, RayBlock *rays, HitBlock *hits);

/* The facets on which rays begin. They are flat, so no ray meets its own, whatever is rounded: the
 * plane of a sliver can be off by more than a ray begins in front of it. */
typedef struct {
    _Alignas(64) int32_t triangle[BLOCK_RAYS]; /* NO_TRIANGLE for rays that begin elsewhere */
    const int32_t *numbers; /* of a hierarchy's triangles as those are counted; NULL: alike */
} StartFacets;

/* Bit mask of the active rays that meet something nearer than their limits, but where they begin;
 * NULL: they begin on no facet. */
uint32_t occlude_bvh(const Bvh *bvh, const double place[3], const RayBlock *rays,
                     const StartFacets *starts);

/* Where rays begin that meet an object, OBJECT_STATIC for the static scene; NO_TRIANGLE for the
 * other rays. */
static inline void find_starts(const HitBlock *hits, int32_t object, StartFacets *starts) {
    Ints16 is_there = load_ints16(hits->object) == object;
    store_ints16((is_there & load_ints16(hits->triangle)) | (~is_there & NO_TRIANGLE),
                 starts->triangle);
    starts->numbers = NULL;
}

/* Bit masks of the active rays that meet the boxes of a node's children before their limits. */
void meet_children(const BvhNode *node, const RayBlock *rays, uint32_t met[LANES]);

#endif
