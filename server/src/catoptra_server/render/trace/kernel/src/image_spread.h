/* Stages in which pixels take light from others: from `from` into a cell. */
#ifndef CATOPTRA_IMAGE_SPREAD_H
#define CATOPTRA_IMAGE_SPREAD_H

#include "image_planes.h"

void blur(const Pass *pass, const Cell *cell, CellValues *to);
void warp(const Pass *pass, const Cell *cell, CellValues *to);
void magnify(const Pass *pass, const Cell *cell, CellValues *to);
void bloom(const Pass *pass, const Cell *cell, CellValues *to);
void demosaic(const Pass *pass, const Cell *cell, CellValues *to);
void add_ghost(const Pass *pass, const Cell *cell, CellValues *to);

#endif
