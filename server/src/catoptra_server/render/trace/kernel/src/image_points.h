/* Stages that change each pixel by itself. */
#ifndef CATOPTRA_IMAGE_POINTS_H
#define CATOPTRA_IMAGE_POINTS_H

#include "image_planes.h"

/* Change a cell by the stages of a pass, one after the other, while it is in the nearest cache. */
void change_points(const Pass *pass, const Cell *cell, CellValues *values);

/* Factor of light whose mean luminance over all pixels is known. */
float find_auto_gain(const ImageStage *stage, float mean_luminance);

#endif
