/* Optical flow: where the point that a pixel shows is in the image of another exposure.
 *
 * The frame is the other exposure; its view's table only says which pixels there are. NumPy's twin:
 * frames/labels/label_renderer.py.
 */
#ifndef CATOPTRA_FLOW_H
#define CATOPTRA_FLOW_H

#include "frame_state.h"

/* Flow of the pixels of a tile. */
void flow_tile(const FrameState *state, int tile);

/* Flow of the pixels that no tile of the view has: unknown. */
void flow_beside_view(const Flow *flow, const View *view);

#endif
