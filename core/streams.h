/* The streams of a payload, opened one after the other; each must have been used up when the next is wanted.
 */
#ifndef DFCGS_STREAMS_H
#define DFCGS_STREAMS_H

#include "headers.h"
#include "stream.h"

/* Told how many symbols a stream had. */
typedef dfcgs_status (*dfcgs_charge)(void *whom, uint64_t num_symbols);

typedef struct {
    dfcgs_reader *reader;
    const uint64_t *lengths;
    int count, next, is_open;
    dfcgs_stream stream;
    dfcgs_charge charge; /* may be NULL */
    void *whom;
} dfcgs_streams;

/* `reader` stands at the first stream; refused unless the lengths fill what is left. `stream` brings arena,
   models and error. */
dfcgs_status dfcgs_open_streams(dfcgs_streams *streams, dfcgs_reader *reader, const uint64_t *lengths,
                                int count, dfcgs_stream stream);
/* `*stream` is the next one, in the place of the last. */
dfcgs_status dfcgs_next_stream(dfcgs_streams *streams, dfcgs_stream **stream);
dfcgs_status dfcgs_close_streams(dfcgs_streams *streams);

#endif
