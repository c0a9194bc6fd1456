/* Bilinear look-up in linear light. Float64 twin: scene/shading.sample_texture. */
#ifndef CATOPTRA_TEXTURES_H
#define CATOPTRA_TEXTURES_H

#include "kernel.h"
#include "vectors.h"

/* Linear colour at texture coordinates; the texture repeats. */
Vec3 sample_texture(const Texture *texture, float u, float v);

#endif
