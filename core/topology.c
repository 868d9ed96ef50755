#include "column.h"
#include "intra.h"
#include "parts.h"
#include "side_information.h"

/* Who survives: `kept` [count]. */
static dfcgs_status read_removals(dfcgs_decoder *d, dfcgs_streams *streams, uint32_t *kept) {
    static const uint8_t used[1] = {1};
    uint32_t count = d->gof.count, survivors = 0;
    dfcgs_stream *s;
    dfcgs_model models[1];
    uint8_t *contexts, *removed;
    DFCGS_TRY(dfcgs_next_stream(streams, &s));
    DFCGS_GET_ZEROS(contexts, &d->arena, uint8_t, count);
    DFCGS_GET(removed, &d->arena, uint8_t, count);
    DFCGS_TRY(dfcgs_read_histograms(s, used, 1, 2, models));
    DFCGS_TRY(dfcgs_grouped(s, contexts, count, models, removed));
    for (uint32_t i = 0; i < count; i++)
        if (!removed[i]) kept[survivors++] = i;
    if (survivors == count - d->frame.topology.num_removals) return DFCGS_OK;
    return dfcgs_corrupt(&d->error, DFCGS_NO_OFFSET, "removals are not as many as their number says");
}

static dfcgs_status read_births(dfcgs_decoder *d, dfcgs_streams *streams) {
    dfcgs_births *births = &d->frame.births;
    uint32_t count = d->frame.topology.num_births;
    births->state = (dfcgs_state){.count = count, .num_attributes = d->gof.num_attributes};
    for (int a = 0; a < d->gof.num_attributes; a++)
        DFCGS_GET(births->state.planes[a], &d->arena, int32_t, (size_t)count *(size_t)dfcgs_columns(a));
    DFCGS_GET(births->cover, &d->arena, uint8_t, count);
    dfcgs_intra_frame frame = {births->state, births->cover, NULL};
    return dfcgs_coded_intra(streams, &d->sequence, &d->frame.topology.coding, 0, &frame);
}

/* Places [count] that are expected of survivors and births. */
static void expect_places(const dfcgs_decoder *d, uint32_t count, int32_t *places) {
    const dfcgs_gof *gof = &d->gof;
    const uint32_t *source = d->frame.births.source;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t row = source ? source[i] : i;
        places[i] = !gof->has_order ? (int32_t)i : row < gof->count ? gof->order[row] : (int32_t)row;
    }
}

static dfcgs_status read_places(dfcgs_decoder *d, dfcgs_streams *streams) {
    dfcgs_stream *s;
    uint32_t count = d->frame.num_gaussians;
    dfcgs_column_shape shape = dfcgs_plain_column(dfcgs_order_levels(count));
    int32_t *places, *expected;
    DFCGS_GET(places, &d->arena, int32_t, count);
    DFCGS_GET(expected, &d->arena, int32_t, count);
    DFCGS_TRY(dfcgs_next_stream(streams, &s));
    DFCGS_TRY(dfcgs_column(s, &shape, places, NULL));
    expect_places(d, count, expected);
    for (uint32_t i = 0; i < count; i++) places[i] += expected[i];
    d->frame.places = places;
    return dfcgs_check_permutation(s, places, count);
}

/* Removals, births and places, in the order of their streams. */
static dfcgs_status read_topology(dfcgs_decoder *d, dfcgs_streams *streams) {
    const dfcgs_topology_header *header = &d->frame.topology;
    uint32_t *kept;
    DFCGS_GET(kept, &d->arena, uint32_t, d->gof.count);
    if (header->num_removals) {
        DFCGS_TRY(read_removals(d, streams, kept));
        DFCGS_TRY(dfcgs_keep_survivors(&d->arena, &d->gof, kept, d->gof.count - header->num_removals));
    }
    if (header->num_births) {
        DFCGS_TRY(read_births(d, streams));
        DFCGS_TRY(dfcgs_place_births(&d->arena, &d->gof, &d->frame.births));
    }
    if (header->has_permutation) DFCGS_TRY(read_places(d, streams));
    return dfcgs_close_streams(streams);
}

dfcgs_status dfcgs_put_topology(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_frame *f = &d->frame;
    const dfcgs_topology_header *header = &f->topology;
    dfcgs_streams streams;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    DFCGS_TRY(dfcgs_read_topology(r, &d->sequence, d->gof.count, &f->topology));
    f->num_gaussians = d->gof.count - header->num_removals + header->num_births;
    if (header->num_births)
        DFCGS_TRY(dfcgs_charge_births(&d->budget, f->index, header->num_births, f->num_gaussians));
    int births = header->num_births ? d->gof.num_attributes + 2 : 0;
    int num_streams = (header->num_removals > 0) + births + header->has_permutation;
    DFCGS_TRY(dfcgs_open_part(d, r, num_streams, lengths, &streams));
    DFCGS_TRY(read_topology(d, &streams));
    f->has_topology = 1;
    return DFCGS_OK;
}

/* The end of a frame in which Gaussians come or have other places. */
dfcgs_status dfcgs_finish_topology(dfcgs_decoder *d) {
    dfcgs_frame *f = &d->frame;
    dfcgs_gof *gof = &d->gof;
    if (f->topology.num_births) DFCGS_TRY(dfcgs_insert_births(&d->arena, gof, &f->births));
    if (!f->places) return DFCGS_OK;
    memcpy(gof->order, f->places, gof->count * sizeof *gof->order);
    gof->has_order = 1;
    dfcgs_touch(gof, DFCGS_ORDER_BIT);
    return DFCGS_OK;
}
