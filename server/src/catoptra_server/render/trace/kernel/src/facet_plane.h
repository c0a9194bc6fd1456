/* Rays that all meet one facet's plane: the radiance of whole blocks at once. */
#ifndef CATOPTRA_FACET_PLANE_H
#define CATOPTRA_FACET_PLANE_H

#include "frame_state.h"

/* Plane n.(p - first) = 0 with coordinates gradient.(p - first) + offset. */
typedef struct {
    Vec3 first, normal;
    Vec3 u_gradient, v_gradient; /* of texture coordinates, per metre */
    float u_offset, v_offset;
} FacetPlane;

FacetPlane find_facet_plane(const FrameState *state, int32_t triangle);

/* Distances at which rays meet the plane. */
void find_distances(const FacetPlane *plane, const RayBlock *rays, float distances[BLOCK_RAYS]);

/* One radiance times the facet's texture where the rays meet its plane, (3, 16). */
void texture_block(const FrameState *state, int32_t triangle, const FacetPlane *plane,
                   const RayBlock *rays, Vec3 radiance, float result[3][BLOCK_RAYS]);

#endif
