/* Where a frame's motion shows, and how many instants of its exposure that takes.
 *
 * The sharp frame says by how much each tile's surfaces move, in pixels, and how much pixels differ
 * within reach of that motion, and how little light bends there. A pixel changes by no more than
 * that: most of a picture is left as it is. Where all moves as one, the samples of the sharp frame
 * tell what passes (blur_gather.h), if no gloss and no moving shadow does; elsewhere they tell which
 * lights all that passes meets alike. All decisions follow from the sharp frame alone, not from
 * threads.
 */
#ifndef CATOPTRA_BLUR_PLAN_H
#define CATOPTRA_BLUR_PLAN_H

#include "beams.h"
#include "blur_gather.h"
#include "frame_state.h"
#include "pixel_change.h"

/* Displacements of what a tile shows in the poses' whole time, px: the largest, and the least and
 * greatest by column and by row. */
typedef struct {
    float speed, least[2], most[2];
} TileMotion;

typedef struct BlurPlan {
    int is_blurred; /* rows are exposed for some time */
    float interval; /* time between the two poses below */
    Pose camera, begin, end;
    Pose related[2]; /* the camera's pose in those of both */
    Pose *objects; /* (o, 3) likewise */
    int is_gathered; /* light of cells that move as one comes from the samples */
    Frame counted; /* the frame, with a rounded gain */
    TileSamples samples;
    float *blurred; /* (t, 3, 16) of tiles with gathered cells, others as in `means` */
    float *means;  /* (t, 3, 16) of the sharp frame's pixels, linear */
    TileMotion *motions; /* (tile rows, tile columns) */
    int cell_rows, cell_columns; /* squares of 2 x 2 pixels */
    uint8_t *cells; /* (6, rows, columns) codes of the least and greatest light by channel */
    uint16_t *instants;  /* (tile rows, tile columns) at least; 0: the sharp frame is enough */
    uint8_t *thin;       /* likewise: whether something there may pass between the samples */
    uint8_t *masks;      /* likewise: bit mask of the cells that motion may change, row by row */
    uint8_t *gathered;   /* likewise of those that are drawn by the sharp frame's samples */
    LightProof *lights;  /* likewise: lights that something sees, and that are hidden from some */
    int are_lights_known; /* of all tiles */
    uint8_t *wanted[BEAM_LEVELS]; /* parts with such tiles */
    int num_tiles, max_instants;
    ChangeMeasure rolling; /* bound of the change by the rows' own times */
} BlurPlan;

/* Space for a moving frame; NULL if memory is short. */
BlurPlan *create_plan(const FrameState *state);
void release_plan(BlurPlan *plan);

/* Take down the motion of what a block of rays meets, by the distances of the hits. */
void note_hits(const FrameState *state, int tile, const RayBlock *rays, const HitBlock *hits);

/* The same of a tile that one plane fills, or the background at a `triangle` below 0. */
void note_plane(const FrameState *state, int tile, int32_t triangle);

/* Take down that light on what a block of the table shows moves otherwise than its surfaces. */
void note_apart(const FrameState *state, size_t block);

/* Take down that something in a tile sees some lights, and that others are hidden from something;
 * in the first pass. */
void note_lights(const FrameState *state, size_t tile, LightProof lights);

/* Lights that all in a tile and around it meets alike: at other instants it does so, too. */
LightProof find_known_lights(const FrameState *state, int tile);

/* Take down the linear means of a tile's pixels. */
void note_means(const FrameState *state, int tile, const float means[3][TILE_PX * TILE_PX]);

/* Take down the samples of a block of a tile, which many show one light instead. */
void note_block(const FrameState *state, int tile, int block, float radiance[3][BLOCK_RAYS]);

/* Take down that a tile shows what may pass between its samples: no sharp frame has its light. */
void note_thin(const FrameState *state, int tile);

/* Decide on the number of instants of each tile; 0 if memory is short. */
int choose_instants(const FrameState *state);

/* Drop those cells of a tile that motion does not change visibly, by single pixels; then take the
 * tiles that have any. */
void choose_cells(const FrameState *state, int tile);
void want_tiles(const FrameState *state);

/* After all instants: take the tiles with gathered cells, if nothing decides that motion is seen.
 * Between samples light is gathered as a slope, which an edge passes in a jump: instants tell. */
int reopen_gathered(const FrameState *state);

#endif
