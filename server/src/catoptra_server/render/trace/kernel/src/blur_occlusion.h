/* Occluded sky during an exposure: mean factors of a moving triangle.
 *
 * Where a ray meets a facet's plane moves through the facet's grid of factors. These change evenly
 * from node to node, so over a part of the exposure the mean is that of the factors at its ends,
 * weighed by the middle of the times at which the triangle is seen.
 */
#ifndef CATOPTRA_BLUR_OCCLUSION_H
#define CATOPTRA_BLUR_OCCLUSION_H

#include "frame_state.h"
#include "ray_order.h"

/* Where rays of the mirror frame meet a facet's grid at an instant: column and row are the first
 * ones, and the distance times a product with the direction. */
typedef struct {
    Vec3 to_column, to_row;
    float first_column, first_row;
} AtlasRays;

/* Of a facet that has a grid. */
AtlasRays find_atlas_rays(const Scene *scene, int32_t triangle, const Pose *pose);

/* The instants between the parts of an exposure, from its begin to its end. */
typedef struct {
    int parts, bins;                     /* times of a part, bits of a word */
    const AtlasRays *atlas;              /* at each instant */
    const float (*inverse)[BLOCK_RAYS];  /* inverse distances of the facet's plane at each */
} OcclusionTimes;

/* Mean factor of each ray over the times at which it sees a facet; 1 for those that never do. */
void find_mean_factors(const Scene *scene, int32_t triangle, const OcclusionTimes *times,
                       const RayBlock *rays, const int32_t seen[BLOCK_RAYS],
                       float factors[3][BLOCK_RAYS]);

#endif
