/* The parts of a frame that have chunks of their own: 6.2 to 6.4. */
#ifndef DFCGS_PARTS_H
#define DFCGS_PARTS_H

#include "decoder.h"
#include "streams.h"

/* Reads the lengths of the streams of a payload, and stands before the first one. */
dfcgs_status dfcgs_open_part(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                             dfcgs_streams *streams);
/* The same of streams whose symbols are charged. */
dfcgs_status dfcgs_open_charged(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                                dfcgs_streams *streams);

/* TOPOLOGY: who goes, who comes, in which order; and the end of such a frame, where births are put in. */
dfcgs_status dfcgs_put_topology(dfcgs_decoder *d, dfcgs_reader *r);
dfcgs_status dfcgs_finish_topology(dfcgs_decoder *d);

/* MOTION: carries the Gaussians that follow; and what is learnt from it when the frame is decoded. */
dfcgs_status dfcgs_put_motion(dfcgs_decoder *d, dfcgs_reader *r);
void dfcgs_learn_motion(dfcgs_decoder *d);

/* RESIDUAL: symbols of all attributes that have some, added to the planes. */
dfcgs_status dfcgs_put_residual(dfcgs_decoder *d, dfcgs_reader *r);

#endif
