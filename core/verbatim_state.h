/* A.3 What P-frames after a verbatim I-frame refer to. */
#ifndef DFCGS_VERBATIM_STATE_H
#define DFCGS_VERBATIM_STATE_H

#include "sequence.h"

/* Planes of `state` from float32 `patterns` [count][columns] of each attribute. */
void dfcgs_verbatim_state(const dfcgs_sequence *sequence, uint32_t *const *patterns, dfcgs_state *state);

#endif
