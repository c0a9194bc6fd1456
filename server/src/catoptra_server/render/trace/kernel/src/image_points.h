/* Stages that change each pixel by itself. */
#ifndef CATOPTRA_IMAGE_POINTS_H
#define CATOPTRA_IMAGE_POINTS_H

#include "image_planes.h"

/* Change a cell by the stages of a pass, one after the other, while it is in the nearest cache. */
void change_points(const Pass *pass, const Cell *cell, CellValues *values);

/* Factor of light whose mean luminance over all pixels is known. */
float find_auto_gain(const ImageStage *stage, float mean_luminance);

/* Where what a stage changes is measured: of a factor behind the automatic gain that follows, which
 * takes back what the whole picture has in common; of others where they act. */
const ImageStage *find_exposure(const ImageJob *job, const ImageStage *stage);

/* A cell with and without each measured factor of its light: behind the automatic gain changes are
 * measured, by the exposure of either; in the pass before it luminances are summed. */
void visit_factors(const Pass *pass, const ImageStage *automatic, const Cell *cell,
                   const CellValues *with);

#endif
