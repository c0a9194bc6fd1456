/* Rays that all meet one facet's plane: the radiance of whole blocks at once. */
#ifndef CATOPTRA_FACET_PLANE_H
#define CATOPTRA_FACET_PLANE_H

#include "frame_state.h"

struct PlacedTexels; /* hit_textures.h */

/* Plane n.(p - first) = 0 with coordinates gradient.(p - first) + offset. */
typedef struct FacetPlane {
    Vec3 first, normal;
    Vec3 u_gradient, v_gradient; /* of texture coordinates, per metre */
    float u_offset, v_offset;
} FacetPlane;

FacetPlane find_facet_plane(const FrameState *state, int32_t triangle);

/* Plane of corners in the frame's coordinates with their (3, 2) texture coordinates. */
FacetPlane span_plane(Vec3 first, Vec3 second, Vec3 third, const double *uv);

/* Distances at which rays meet the plane. */
void find_distances(const FacetPlane *plane, const RayBlock *rays, float distances[BLOCK_RAYS]);

/* Texels of the facet's texture where the rays meet its plane, requested from memory. */
void place_plane_texels(const FrameState *state, int32_t triangle, const FacetPlane *plane,
                        const RayBlock *rays, struct PlacedTexels *placed);

/* One radiance times the facet's texture where the rays meet its plane, (3, 16). */
void texture_block(const FrameState *state, int32_t triangle, const FacetPlane *plane,
                   const RayBlock *rays, Vec3 radiance, float result[3][BLOCK_RAYS]);

#endif
