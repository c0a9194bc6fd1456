/* Texture colours of a block's hits, each on a facet of its own. */
#ifndef CATOPTRA_HIT_TEXTURES_H
#define CATOPTRA_HIT_TEXTURES_H

#include "direct_light.h"
#include "texture_levels.h"

/* Colours, (3, 16), of some rays, of a texture each, by points whose footprints are measured. */
void read_textures(const Texture *const textures[BLOCK_RAYS], const TexturePoints *points,
                   uint32_t lanes, float colours[3][BLOCK_RAYS]);

/* Colours, (3, 16), of the textured rays; white for the others. */
void read_hit_textures(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                       const SurfaceBlock *surface, float colours[3][BLOCK_RAYS]);

#endif
