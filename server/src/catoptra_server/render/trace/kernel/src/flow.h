/* Optical flow: where the point that a pixel shows is in the image of another exposure.
 *
 * The frame is the other exposure; its view's table only says which pixels there are. NumPy's twin:
 * ground_truth/flow.py.
 */
#ifndef CATOPTRA_FLOW_H
#define CATOPTRA_FLOW_H

#include "frame_state.h"

void flow_tile(const FrameState *state, int tile);

#endif
