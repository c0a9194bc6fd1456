/* Facets whose radiance is one constant over a part of the image, by what is proven of lights. */
#ifndef CATOPTRA_PLANE_LIGHT_H
#define CATOPTRA_PLANE_LIGHT_H

#include "light_map.h"

typedef struct {
    Vec3 radiance; /* before the facet's texture */
    Vec3 lost;     /* by shadows */
    int is_table;  /* the radiance is that of the table of frames without shadows */
} PlaneLight;

/* Whether a static facet's radiance is a constant times its texture, and that constant. */
int find_plane_light(const FrameState *state, int32_t triangle, LightProof proof,
                     PlaneLight *found);

/* The same but for the light of point lights that nothing occludes: bit mask of those, of the
 * first 32. Nothing is said of what is lost of others. */
int find_light_beside_lamps(const FrameState *state, int32_t triangle, LightProof proof,
                            PlaneLight *found, uint32_t *lamps);

/* Whether every light that reaches a facet is proven to be seen, or to be hidden. */
int is_light_proven(const FrameState *state, int32_t triangle, LightProof proof);

#endif
