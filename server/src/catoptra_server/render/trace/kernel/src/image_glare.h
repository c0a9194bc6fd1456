/* Light that a lens scatters over the whole image: by cells, then pixel by pixel. */
#ifndef CATOPTRA_IMAGE_GLARE_H
#define CATOPTRA_IMAGE_GLARE_H

#include "image_planes.h"

/* Bytes that the largest glare works in; 0 without one. */
size_t glare_bytes(const ImageJob *job);

/* Scattered light at the cells' centres, before `change_glare`. */
void scatter(Pass *pass);

void change_glare(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                  float *values, int count);

#endif
