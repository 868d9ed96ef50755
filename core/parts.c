#include "parts.h"

static dfcgs_stream stream_of(dfcgs_decoder *d) {
    return (dfcgs_stream){.arena = &d->arena, .models = &d->models, .error = &d->error};
}

dfcgs_status dfcgs_open_part(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                             dfcgs_streams *streams) {
    DFCGS_TRY(dfcgs_read_lengths(r, count, lengths));
    return dfcgs_open_streams(streams, r, lengths, count, stream_of(d));
}

static dfcgs_status charge_symbols(void *whom, uint64_t num_symbols) {
    dfcgs_decoder *d = whom;
    return dfcgs_charge_symbols(&d->budget, d->frame.index, d->frame.num_gaussians, num_symbols);
}

dfcgs_status dfcgs_open_charged(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                                dfcgs_streams *streams) {
    DFCGS_TRY(dfcgs_open_part(d, r, count, lengths, streams));
    streams->charge = charge_symbols;
    streams->whom = d;
    return DFCGS_OK;
}
