/* Which level of a texture a sample reads. Float64 twin: world/textures.py.
 *
 * The steps of rays to their neighbours, on the plane of a facet and in texels, span the footprint
 * of a sample. A block has one pair of steps in space; on the plane each ray has its own. In a
 * header, for it is a part of the loops over a textured frame's rays.
 */
#ifndef CATOPTRA_TEXTURE_LEVELS_H
#define CATOPTRA_TEXTURE_LEVELS_H

#include "camera_rays.h"
#include "facet_plane.h"
#include "textures.h"

/* Twin: world/textures.py:MAX_STRETCH. */
#define MAX_STRETCH 3.0f

/* A block's steps to the right and down, along a facet's normal and texture coordinates. */
typedef struct {
    float normal[2];
    float u[2], v[2]; /* in texels of the image */
} PlaneSteps;

static inline PlaneSteps find_plane_steps(const FacetPlane *plane, const RaySteps *steps,
                                          const TextureLevel *image) {
    PlaneSteps on_plane;
    for (int i = 0; i < 2; i++) {
        on_plane.normal[i] = dot(plane->normal, steps->step[i]);
        on_plane.u[i] = (float)image->width * dot(plane->u_gradient, steps->step[i]);
        on_plane.v[i] = (float)image->height * dot(plane->v_gradient, steps->step[i]);
    }
    return on_plane;
}

/* A footprint in texels: sum of the squares of its axes, and their product. */
typedef struct {
    float squares, area;
} Footprint;

/* Footprint of a ray at a distance along its direction; `inverse_cosine` is one over normal . ray,
 * `u` and `v` are the direction's texels of the image a metre. */
static inline Footprint find_footprint(const PlaneSteps *steps, float distance,
                                       float inverse_cosine, float u, float v) {
    float right = steps->normal[0] * inverse_cosine, down = steps->normal[1] * inverse_cosine;
    float u0 = distance * (steps->u[0] - right * u), u1 = distance * (steps->u[1] - down * u);
    float v0 = distance * (steps->v[0] - right * v), v1 = distance * (steps->v[1] - down * v);
    float area = u0 * v1 - u1 * v0;
    return (Footprint){u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1, __builtin_fabsf(area)};
}

/* Texels across a footprint. */
static inline float footprint_texels(Footprint footprint) {
    float squares = footprint.squares, twice = 2.0f * footprint.area;
    float difference = squares > twice ? squares - twice : 0.0f;
    float root = __builtin_sqrtf(difference * (squares + twice));
    float longer = __builtin_sqrtf(0.5f * (squares + root));
    float limit = longer > 0.0f ? MAX_STRETCH * footprint.area / longer : 0.0f;
    return longer < limit ? longer : limit;
}

/* Where the rays of a block meet textures. */
typedef struct {
    _Alignas(64) float u[BLOCK_RAYS], v[BLOCK_RAYS];
    float squares[BLOCK_RAYS], area[BLOCK_RAYS]; /* of their footprints */
    float texels[BLOCK_RAYS];                    /* across their footprints */
    int32_t width[BLOCK_RAYS], height[BLOCK_RAYS]; /* of the images */
    int32_t coarsest[BLOCK_RAYS];                  /* of their levels */
    int32_t size[BLOCK_RAYS];                      /* bytes of a texel of 16-bit light */
} TexturePoints;

/* Note the image that some rays meet. */
static inline void set_images(const Texture *texture, Ints16 lanes, TexturePoints *points) {
    int32_t values[4] = {texture->levels->width, texture->levels->height, texture->num_levels - 1,
                         texture->channels * (int32_t)sizeof(uint16_t)};
    int32_t *targets[4] = {points->width, points->height, points->coarsest, points->size};
    for (int i = 0; i < 4; i++)
        store_ints16((lanes & values[i]) | (~lanes & load_ints16(targets[i])), targets[i]);
}

/* Texels across all footprints; whether any is more than one. */
static inline int measure_footprints(TexturePoints *points) {
    int is_any_large = 0;
    for (int i = 0; i < BLOCK_RAYS; i++)
        is_any_large |= !(points->squares[i] <= 1.0f);
    if (is_any_large)
        for (int i = 0; i < BLOCK_RAYS; i++)
            points->texels[i] = footprint_texels((Footprint){points->squares[i], points->area[i]});
    else
        __builtin_memset(points->texels, 0, sizeof points->texels);
    return is_any_large;
}

#endif
