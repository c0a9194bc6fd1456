/* How much of the sky's light reaches the points of a static scene: grids of factors on its
 * surfaces, interpolated bilinearly. Float64 twin: world/shading.py.
 *
 * Most facets have no grid, and most of a grid is open: whole parts of an image keep one radiance
 * where the sums of dark blocks prove that they show nothing but factors of 1.
 */
#ifndef CATOPTRA_OCCLUSION_H
#define CATOPTRA_OCCLUSION_H

#include "frame_state.h"

/* What is known of the part of a facet between four points. */
typedef enum { SKY_MIXED = 0, SKY_OPEN, SKY_HIDDEN } SkyView;

/* Whether the sky is hidden from any point of a static facet. */
static inline int has_occlusion(const Scene *scene, int32_t triangle) {
    return scene->occlusion.patch_of && scene->occlusion.patch_of[triangle] >= 0;
}

static inline const OcclusionPatch *patch_of(const Scene *scene, int32_t triangle) {
    return scene->occlusion.patches + scene->occlusion.patch_of[triangle];
}

/* Column or row of a point in the atlas. */
static inline float atlas_coordinate(const float row[4], Vec3 point) {
    return row[0] * point.x + row[1] * point.y + row[2] * point.z + row[3];
}

/* Factors of each colour at 16 positions in the atlas on a facet's grid, of some rays at least;
 * beside the grid, those of its border. */
void find_factors(const Scene *scene, int32_t triangle, uint32_t lanes,
                  const float columns[BLOCK_RAYS], const float rows[BLOCK_RAYS],
                  float factors[3][BLOCK_RAYS]);

/* Open: all points have the factor 1. Hidden: no part of it is open. */
SkyView find_sky_view(const Scene *scene, int32_t triangle, const Vec3 corners[4]);

/* Whether all that a tile shows of one facet's grid has the factor 1; positions of the centres of
 * its pixels. */
int is_sky_open(const Scene *scene, int32_t triangle, const float columns[BLOCK_RAYS],
                const float rows[BLOCK_RAYS]);

/* Take from the (3, 16) radiance of a mask of rays what scene and bodies hide of the sky where they
 * meet static facets: before textures, and before lights are added one by one. The rays'
 * limits are the distances of their hits. */
void hide_sky(const FrameState *state, uint32_t mask, uint32_t all_sky, const RayBlock *rays,
              const HitBlock *hits, float radiance[3][BLOCK_RAYS]);

/* Note what (3, 16) factors of the sky's light, instead of their grid's means, change of radiance on
 * a facet, by lanes; `sky`: the part that factors scale. Whatever light and textures follow. */
void note_light(const FrameState *state, int32_t triangle, uint32_t lanes,
                const float radiance[3][BLOCK_RAYS], const float sky[3][BLOCK_RAYS],
                const float factors[3][BLOCK_RAYS]);

/* Scale the (3, 16) radiance of rays that all meet a facet's plane; `light`: the
 * facet's radiance with factor 1, before its texture; `known`: the factors, or NULL. */
void hide_sky_in_block(const FrameState *state, int32_t triangle, const RayBlock *rays, Vec3 light,
                       const float (*known)[BLOCK_RAYS], float radiance[3][BLOCK_RAYS]);

#endif
