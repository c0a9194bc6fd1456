/* Where nothing can occlude a light, or something certainly does: by conservative height maps of
 * the casters.
 *
 * Cells of a plane across the light store how far towards the light the casters above them reach:
 * the highest surface, and the highest point of all others, so that a surface does not occlude
 * itself. A point as high as all others in its cell is lit without a ray; one below a triangle that
 * covers its whole cell is hidden without a ray. Built once, at the first frame with shadows: most
 * points of a scene are lit (95 to 97 % of the soccer field's pixels). A directional light has one
 * map, each of at most 16 lamps a cube of six. Where they prove nothing a ray is cast, from a point
 * that is offset by 2^-18 of the largest coordinate.
 */
#ifndef CATOPTRA_LIGHT_MAP_H
#define CATOPTRA_LIGHT_MAP_H

#include "frame_state.h"

/* A lamp and a point of a surface may coincide: the irradiance there is that of a millimetre. */
#define MIN_SQUARED_DISTANCE 1e-6f

/* What is known of a light at a point: nothing; nothing occludes it; the static scene occludes it;
 * nothing but dynamic objects can occlude it. */
enum { LIGHT_UNKNOWN, LIGHT_SEEN, LIGHT_HIDDEN, LIGHT_BEHIND_OBJECTS };

enum { MAX_PROVEN = 16 };

/* The same on the parts of a few static facets that a part of the image shows. */
typedef struct {
    int count;
    int32_t triangle[MAX_PROVEN];
    LightProof proof[MAX_PROVEN];
} FacetProofs;

/* How high dynamic objects reach in each cell of all maps of a frame; NULL without objects, or if
 * memory is short (`*failed`). */
float *raise_objects(const FrameState *state, int *failed);

/* Rays by what may occlude a light from their points. */
typedef struct {
    uint32_t hidden, unknown, behind_objects;
} Uncertainty;

/* What is known of a light at the (3, 16) points where some rays meet the scene and objects. */
Uncertainty find_light(const FrameState *state, int light, const HitBlock *hits,
                       const float points[3][BLOCK_RAYS], uint32_t rays);

/* Cosine to a directional light, or the height of a point light above a static facet's plane: above
 * zero if the light shines on the facet. */
float find_incidence(const FrameState *state, const Light *light, int32_t triangle);

/* Whether the frame's state tells all about the lights that shine on a static facet, and what it
 * tells. */
int are_lights_known(const FrameState *state, int32_t triangle, LightProof *proof);

/* What is known of the lights, but for those of a mask, that shine on the part of a static facet
 * between four points. */
LightProof prove_lights(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                        uint32_t others);

#endif
