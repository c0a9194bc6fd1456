/* Stages in which pixels take light from others: from `from` into `to`. */
#ifndef CATOPTRA_IMAGE_SPREAD_H
#define CATOPTRA_IMAGE_SPREAD_H

#include "image_planes.h"

void blur(Pass *pass, const Cell *cell);
void warp(Pass *pass, const Cell *cell);
void magnify(Pass *pass, const Cell *cell);
void bloom(Pass *pass, const Cell *cell);
void demosaic(Pass *pass, const Cell *cell);
void add_ghost(Pass *pass, const Cell *cell);

#endif
