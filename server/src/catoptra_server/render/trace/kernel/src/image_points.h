/* Stages that change each pixel by itself. */
#ifndef CATOPTRA_IMAGE_POINTS_H
#define CATOPTRA_IMAGE_POINTS_H

#include "image_planes.h"

/* Change a cell by the stages of a pass, in place. */
void change_points(Pass *pass, const Cell *cell);

#endif
